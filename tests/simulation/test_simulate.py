"""Simulated measurements are what the model says, with noise and errors as asked for."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated import arm_named
from simulation_scenes import EXACT, Folder, with_noise

from suta_calib.geometry.numbers import homogeneous, vector_from_rotation
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import read_artefact
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import (
    InverseKinematics,
    NoiseLevels,
    Simulation,
    Targets,
    inverse_kinematics,
    read_simulation,
    true_values,
)
from suta_calib.simulation.noise import encoder_readings, wrapped


@pytest.fixture
def folder(tmp_path: Path, suta_urdf: Path) -> Folder:
    return Folder(tmp_path, suta_urdf)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Simulation:
    """Without noise."""
    return Folder(tmp_path_factory.mktemp("exact"), suta_urdf).simulate()


def seats(made: Simulation, path: str) -> tuple[np.ndarray, np.ndarray]:
    """True tip positions of a file, and the places of the landmarks touched, both in the base."""
    file = next(file for file in made.files if file.path == path)
    plan = next(plan for plan in made.spec.sets if plan.name == path.split("/")[0])
    pose = plan.places[Path(path).stem]
    truth = made.artefacts[plan.name].position_of(file.samples.labels["landmark"])
    tip = made.arm.forward(file.samples.q, made.values)[1]
    return tip, truth @ pose.rotation.T + pose.position


# ── What is simulated is what the model says ─────────────────────────────────────────────────
def test_without_noise_the_true_tip_is_seated_in_the_landmark(made: Simulation) -> None:
    assert [file.path for file in made.files][:2] == ["calibration/P1.csv", "calibration/P2.csv"]
    for path in ("calibration/P1.csv", "calibration/P2.csv"):
        tip, landmark = seats(made, path)
        np.testing.assert_allclose(tip, landmark, atol=1e-10, rtol=0)
    samples, plan = made.files[0].samples, made.spec.sets[0]
    assert np.abs(made.arm.forward(samples.q)[1] - tip).max() > 1e-3
    rotation = made.arm.forward(samples.q, made.values)[0]
    marks = made.artefacts["calibration"].landmarks
    for row, name in enumerate(samples.labels["landmark"]):
        seat = marks[str(name)].rotation
        if seat is not None:
            expected = plan.places["P1"].rotation @ seat
            np.testing.assert_allclose(rotation[row], expected, atol=1e-10, rtol=0)


def test_the_fixed_point_is_touched_from_directions_within_the_cone(made: Simulation) -> None:
    samples = made.files[2].samples
    rotation, tip = made.arm.forward(samples.q, made.values)
    np.testing.assert_allclose(tip, np.tile([0.4, 0.0, 0.1], (12, 1)), atol=1e-10, rtol=0)
    angles = np.degrees(np.arccos(-rotation[:, 2, 2]))
    assert angles.max() <= 40 + 1e-6
    assert np.ptp(angles) > 15
    assert set(samples.labels["point"]) == {"F1"}


def test_the_instrument_sees_the_true_tip(made: Simulation) -> None:
    samples = made.files[3].samples
    base = made.spec.sets[2].frames["base_in_instrument"]
    rotation, tip = made.arm.forward(samples.q, made.values)
    T = homogeneous(base.rotation, base.position)
    np.testing.assert_allclose(samples.position, tip @ T[:3, :3].T + T[:3, 3], atol=1e-12)
    np.testing.assert_allclose(samples.rotation, T[:3, :3] @ rotation, atol=1e-12)


def test_readings_stay_within_the_encoders_turn(folder: Folder) -> None:
    for file in folder.simulate(with_noise("{encoder_deg: 30}")).files:
        assert (np.abs(file.samples.q) <= np.pi).all()


# ── The truth ────────────────────────────────────────────────────────────────────────────────
def test_later_rows_win_and_values_are_exact(made: Simulation) -> None:
    values = made.values
    assert values["joint_2.offset"] == pytest.approx(math.radians(4.1), abs=1e-15)
    assert values["joint_4.z"] != 0.571


def test_drawn_errors_have_the_size_asked_for(folder: Folder, suta_urdf: Path) -> None:
    spec = read_simulation(folder.file())
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    drawn = [true_values(arm, spec, seed) for seed in range(100)]
    offsets = np.degrees([[v[f"joint_{k}.offset"] for k in (1, 3, 4, 5, 6)] for v in drawn])
    assert offsets.std() == pytest.approx(1.0, rel=0.1)
    twists = np.degrees([[v[f"joint_{k}.rx"] for k in range(1, 7)] for v in drawn])
    assert twists.std() == pytest.approx(0.1, rel=0.1)


def test_a_changed_row_leaves_other_parameters_as_they_were(
    made: Simulation, folder: Folder
) -> None:
    before = made.values
    after = folder.simulate(EXACT.replace("value_deg: 4.1", "value_deg: -2")).values
    assert {n for n in before if before[n] != after[n]} == {"joint_2.offset"}


def test_the_true_artefact_is_one_for_all_sets(folder: Folder) -> None:
    second = EXACT.replace(
        "  fixed_point:\n    kind",
        """  validation:
    kind: landmark
    artefact: artefact.yaml
    placements: {V1: {position_mm: [437.5, 12.5, 0], rotation_rpy_deg: [0, 0, -105]}}
  fixed_point:\n    kind""",
    )
    made = folder.simulate(second.replace("sets:\n", "noise: {artefact: true}\nsets:\n", 1))
    names = ["A", "B", "C"]
    one, other = (made.artefacts[n].position_of(names) for n in ("calibration", "validation"))
    np.testing.assert_array_equal(one, other)
    certified = read_artefact(folder.path / "artefact.yaml").position_of(names)
    assert 1e-5 < np.abs(one - certified).max() < 2.5e-3


# ── Noise ────────────────────────────────────────────────────────────────────────────────────
def test_seating_noise_has_the_size_asked_for(folder: Folder) -> None:
    text = with_noise("{seating_mm: 0.2, seating_deg: 0.3}").replace("repeats: 2", "repeats: 150")
    made, exact = (
        folder.simulate(text),
        folder.simulate(EXACT.replace("repeats: 2", "repeats: 150")),
    )
    tip, landmark = seats(made, "calibration/P1.csv")
    away = 1e3 * (tip - landmark)
    np.testing.assert_allclose(away.std(axis=0), 0.2, rtol=0.1)
    np.testing.assert_allclose(away.mean(axis=0), 0, atol=0.04)
    tilted, straight = (m.arm.forward(m.files[0].samples.q, m.values)[0] for m in (made, exact))
    oriented = made.files[0].samples.labels["landmark"] != "C"
    turn = vector_from_rotation(np.swapaxes(straight, 1, 2) @ tilted)[oriented]
    np.testing.assert_allclose(np.degrees(turn).std(axis=0), 0.3, rtol=0.1)


def test_encoder_noise_and_resolution(suta_urdf: Path) -> None:
    arm, rng = ArmModel.from_urdf(suta_urdf, "tip"), np.random.default_rng(0)
    q = rng.uniform(-3, 3, (2000, 6))
    noisy = encoder_readings(rng, NoiseLevels(encoder_angle=0.01), arm, q)
    assert (noisy - q).std() == pytest.approx(0.01, rel=0.1)
    coarse = encoder_readings(rng, NoiseLevels(encoder_bits=10), arm, q)
    steps = coarse / (2 * np.pi / 1024)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.abs(coarse - q).max() <= np.pi / 1024 * (1 + 1e-9)


def test_instrument_noise_has_the_size_asked_for(folder: Folder) -> None:
    text = EXACT.replace("samples: 30", "samples: 600")
    exact = folder.simulate(text).files[3].samples
    noise = "noise: {instrument_mm: 0.1, instrument_deg: 0.2}\nsets:\n"
    noisy = folder.simulate(text.replace("sets:\n", noise, 1)).files[3].samples
    assert 1e3 * (noisy.position - exact.position).std() == pytest.approx(0.1, rel=0.1)
    turn = vector_from_rotation(np.swapaxes(exact.rotation, 1, 2) @ noisy.rotation)
    assert np.degrees(turn.std()) == pytest.approx(0.2, rel=0.1)


def test_outliers_listed_are_the_outliers_present(folder: Folder) -> None:
    outliers = "    outliers: {fraction: 0.4, size_mm: [3, 8]}\n    repeats: 2"
    made = folder.simulate(EXACT.replace("    repeats: 2", outliers))
    for file in made.files[:2]:
        tip, landmark = seats(made, file.path)
        away = np.linalg.norm(tip - landmark, axis=1)
        np.testing.assert_array_equal(np.flatnonzero(away > 1e-9), file.outliers)
        assert len(file.outliers) == round(0.4 * 6)
        assert ((away[file.outliers] > 3e-3) & (away[file.outliers] < 8e-3)).all()
    assert not any(len(file.outliers) for file in made.files[2:])


# ── Inverse kinematics ───────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("name", ["suta", "panda"])
@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1))
def test_reachable_poses_are_reached_within_the_limits(name: str, seed: int) -> None:
    """By a redundant arm, too."""
    arm, rng = arm_named(name), np.random.default_rng(seed)
    values = {n: p.nominal + 0.002 * rng.standard_normal() for n, p in arm.parameters.items()}
    kinematics = InverseKinematics(arm, values)
    rotation, position = arm.forward(kinematics.random_readings(rng, 4), values)
    found = kinematics.solve(Targets(position, rotation), kinematics.middle, rng, starts=200)
    assert found.reached.all()
    R, p = arm.forward(found.q, values)
    np.testing.assert_allclose(p, position, atol=1e-10, rtol=0)
    np.testing.assert_allclose(R, rotation, atol=1e-10, rtol=0)
    lower, upper = np.array([(joint.lower, joint.upper) for joint in arm.chain.moving]).T
    assert ((found.q >= lower) & (found.q <= upper)).all()


def test_matching_says_what_of_the_orientation_counts(suta_urdf: Path) -> None:
    arm, rng = ArmModel.from_urdf(suta_urdf, "tip"), np.random.default_rng(5)
    kinematics = InverseKinematics(arm, {})
    rotation, position = arm.forward(kinematics.random_readings(rng, 6))
    for matching, columns in (("axis", [2]), ("position", [])):
        targets = Targets(position, rotation, matching)
        found = kinematics.solve(targets, kinematics.middle, rng)
        assert found.reached.all()
        R, p = arm.forward(found.q)
        np.testing.assert_allclose(p, position, atol=1e-10)
        np.testing.assert_allclose(R[:, :, columns], rotation[:, :, columns], atol=1e-10)
        assert np.abs(R - rotation).max() > 0.1


def test_out_of_reach_is_reported_with_the_distance_that_is_left(suta_urdf: Path) -> None:
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    far = Targets(np.array([[3.0, 0.0, 0.047]]), np.eye(3)[None], "position")
    found = InverseKinematics(arm, {}).solve(far, np.full(6, 0.3), np.random.default_rng(0), 3)
    assert not found.reached[0]
    reach = 0.571 + math.hypot(0.371, 0) + 0.253
    assert found.distance[0] == pytest.approx(3.0 - reach, abs=1e-3)


def test_nothing_depends_on_how_many_starts_are_searched_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Neither what is found, nor what is drawn afterwards."""
    arm, rng = arm_named("panda"), np.random.default_rng(11)
    kinematics = InverseKinematics(arm, {})
    rotation, position = arm.forward(kinematics.random_readings(rng, 40))
    answers = []
    for at_once in (1, 16):
        monkeypatch.setattr(inverse_kinematics, "_AT_ONCE", at_once)
        random, found = np.random.default_rng(2), []
        for k in range(13):
            target = Targets(position[[k]], rotation[[k]])
            answer = kinematics.solve(target, kinematics.middle, random, 12)
            found.append([*answer.q[0] * answer.reached, random.random()])
        answers.append(np.array(found))
    one_by_one, together = answers
    np.testing.assert_array_equal(together[:, -1], one_by_one[:, -1])
    # Where the arm is singular, joints tell of an error of the tip by its square root.
    singular = math.sqrt(inverse_kinematics._TOLERANCE)
    np.testing.assert_allclose(together, one_by_one, rtol=0, atol=singular)


def test_targets_that_count_together_are_given_up_together(suta_urdf: Path) -> None:
    """The same postures as one by one, but where one of a group fails from all starts."""
    arm, rng = ArmModel.from_urdf(suta_urdf, "tip"), np.random.default_rng(3)
    kinematics = InverseKinematics(arm, {})
    rotation, position = arm.forward(kinematics.random_readings(rng, 12))
    position[7] += [0.0, 0.0, 3.0]
    targets, together = Targets(position, rotation), np.repeat(np.arange(4), 3)
    alone, found = (
        kinematics.solve(targets, kinematics.middle, np.random.default_rng(0), 8, groups)
        for groups in (None, together)
    )
    assert not alone.reached[7]
    kept = together != together[7]
    np.testing.assert_array_equal(found.q[kept], alone.q[kept])
    np.testing.assert_array_equal(found.reached[kept], alone.reached[kept])
    np.testing.assert_array_equal(np.flatnonzero(found.failed), np.flatnonzero(alone.failed))
    assert not found.reached[6:9].all()


def test_full_turns_are_taken_off_exactly(suta_urdf: Path) -> None:
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    q = np.array([[np.pi, -np.pi, 3 * np.pi, 0.1, -4.0, 4.0]])
    expected = [np.pi, np.pi, np.pi, 0.1, 2 * np.pi - 4, 4 - 2 * np.pi]
    np.testing.assert_allclose(wrapped(arm, q)[0], expected, atol=1e-15)
    assert wrapped(arm, q)[0, 3] == 0.1


# ── Play ─────────────────────────────────────────────────────────────────────────────────────
PLAY = EXACT.replace(
    "sets:\n", "  - {select: [joint_2.backlash, joint_5.backlash], value_deg: 0.4}\nsets:\n", 1
)


def test_an_arm_with_backlash_says_which_way_its_joints_came(folder: Folder) -> None:
    """In every kind of set the model is exact at the truth, with the directions of the file."""
    made, plain = folder.simulate(PLAY), folder.simulate()
    for path in ("calibration/P1.csv", "calibration/P2.csv"):
        file = next(file for file in made.files if file.path == path)
        plan = next(plan for plan in made.spec.sets if plan.name == "calibration")
        pose, told = plan.places[Path(path).stem], file.samples.conditions
        truth = made.artefacts["calibration"].position_of(file.samples.labels["landmark"])
        _, tip = made.arm.forward(file.samples.q, made.values, told)
        seat = truth @ pose.rotation.T + pose.position
        np.testing.assert_allclose(tip, seat, atol=1e-10, rtol=0)
        # Without them the tip is off by what the play turns it.
        away = made.arm.forward(file.samples.q, made.values)[1] - seat
        assert np.abs(away).max() > 0.5e-3
    for file in made.files:
        sides = file.samples.direction
        assert set(np.unique(sides)) <= {-1.0, 1.0}
        steps = np.diff(file.samples.q, axis=0)
        moved = np.abs(steps) > 0.02  # farther than any play
        assert (np.sign(steps) == sides[1:])[moved].all()
    assert all(file.samples.direction is None for file in plain.files)


def test_backlash_comes_back_from_simulated_samples(folder: Folder) -> None:
    text = PLAY.replace("sets:\n", "noise: {instrument_mm: 0.02, encoder_deg: 0.001}\nsets:\n", 1)
    assert cli("simulate", folder.file(text), "--out", folder.path / "out") == 0
    header = (folder.path / "out/tracked/samples.csv").read_text().splitlines()[0].split(",")
    assert {f"joint_{k}.direction" for k in range(1, 7)} <= {*header}
    job = folder.path / "out" / "calibration.yaml"
    job.write_text(
        f"arm: {{urdf: '{folder.urdf}', tip: tip}}\n"
        "parameters: [{select: ['*.offset'], bound_deg: 15},"
        " {select: [joint_2.backlash, joint_5.backlash], bound_deg: 2},"
        " {select: [geometric], prior_mm: 1, prior_deg: 0.1}]\n"
        "observations: [{kind: tracked_point, samples: 'tracked/*.csv', sigma_mm: 0.02,"
        " sigma_deg: 0.002}]\n"
    )
    found = CalibrationJob.load(job).run().solution.estimates
    for name in ("joint_2.backlash", "joint_5.backlash"):
        assert found[name].std is not None
        assert abs(found[name].value - np.radians(0.4)) < 4 * found[name].std
        assert found[name].std < np.radians(0.02)
