from __future__ import annotations

import json
import math
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from suta_calib.cli.simulate import simulate as command
from suta_calib.errors import InputError, JobError, OutputError
from suta_calib.geometry import homogeneous, vector_from_rotation
from suta_calib.measurements import read_artefact
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import (
    InverseKinematics,
    NoiseLevels,
    Simulation,
    Targets,
    read_simulation,
    simulate,
    true_values,
    write_simulation,
)
from suta_calib.simulation.noise import encoder_readings, wrapped

ROBOTS = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
PANDA = ROBOTS / "panda_description/urdf/panda.urdf"

ARTEFACT = """
landmarks:
  A: {position_mm: [0, 0, 40], rotation_rpy_deg: [180, 0, 20], sigma_mm: 0.5}
  B: {position_mm: [60, 10, 60], rotation_rpy_deg: [180, 0, 100], sigma_mm: 0.5}
  C: {position_mm: [-20, 70, 20], sigma_mm: 0.5}
"""
EXACT = """
arm: {urdf: URDF, tip: tip}
seed: 3
errors:
  - {select: [geometric], std_mm: 1, std_deg: 0.1}
  - {select: ["*.offset"], std_deg: 1}
  - {select: [joint_2.offset], value_deg: 4.1}
sets:
  calibration:
    kind: pairwise_distance
    artefact: artefact.yaml
    repeats: 2
    placements:
      P1: {position_mm: [437.5, 12.5, 0], rotation_rpy_deg: [0, 0, -105]}
      P2: {position_mm: [412.5, 37.5, 0], rotation_rpy_deg: [0, 0, 30]}
  fixed_point:
    kind: fixed_point
    points: {F1: {position_mm: [400, 0, 100]}}
    directions: 12
    cone_deg: 40
  tracked:
    kind: tracked_point
    samples: 30
    orientation: true
    base_in_instrument: {position_mm: [1000, 2000, 300], rotation_rpy_deg: [10, 20, 30]}
"""


class Folder:
    """A folder with an artefact and a simulation file that can be changed."""

    def __init__(self, path: Path, urdf: Path) -> None:
        self.path, self.urdf = path, urdf
        (path / "artefact.yaml").write_text(ARTEFACT)

    def file(self, text: str = EXACT) -> Path:
        file = self.path / "simulation.yaml"
        file.write_text(text.replace("URDF", str(self.urdf)))
        return file

    def simulate(self, text: str = EXACT, seed: int | None = None) -> Simulation:
        return simulate(read_simulation(self.file(text)), seed)


@pytest.fixture
def folder(tmp_path: Path, suta_urdf: Path) -> Folder:
    return Folder(tmp_path, suta_urdf)


def with_noise(noise: str) -> str:
    return EXACT.replace("sets:\n", f"noise: {noise}\nsets:\n", 1)


def seats(made: Simulation, path: str) -> tuple[np.ndarray, np.ndarray]:
    """True tip positions of a file, and the places of the landmarks touched, both in the base."""
    file = next(file for file in made.files if file.path == path)
    plan = next(plan for plan in made.spec.sets if plan.name == path.split("/")[0])
    pose = (plan.placements or {})[Path(path).stem]
    truth = made.artefacts[plan.name].position_of(file.samples.labels["landmark"])
    tip = made.arm.forward(file.samples.q, made.values)[1]
    return tip, truth @ pose.rotation.T + pose.position


# ── What is simulated is what the model says ─────────────────────────────────────────────────
def test_without_noise_the_true_tip_is_at_the_landmark(folder: Folder) -> None:
    made = folder.simulate()
    assert [file.path for file in made.files][:2] == ["calibration/P1.csv", "calibration/P2.csv"]
    for path in ("calibration/P1.csv", "calibration/P2.csv"):
        tip, landmark = seats(made, path)
        np.testing.assert_allclose(tip, landmark, atol=1e-10, rtol=0)
    nominal = made.arm.forward(made.files[0].samples.q)[1]
    assert np.abs(nominal - tip).max() > 1e-3


def test_without_noise_the_true_tip_has_the_landmarks_orientation(folder: Folder) -> None:
    made = folder.simulate()
    samples, plan = made.files[0].samples, made.spec.sets[0]
    rotation = made.arm.forward(samples.q, made.values)[0]
    marks = made.artefacts["calibration"].landmarks
    for row, name in enumerate(samples.labels["landmark"]):
        seat = marks[str(name)].rotation
        if seat is not None:
            expected = (plan.placements or {})["P1"].rotation @ seat
            np.testing.assert_allclose(rotation[row], expected, atol=1e-10, rtol=0)


def test_the_fixed_point_is_touched_from_directions_within_the_cone(folder: Folder) -> None:
    made = folder.simulate()
    samples = made.files[2].samples
    rotation, tip = made.arm.forward(samples.q, made.values)
    np.testing.assert_allclose(tip, np.tile([0.4, 0.0, 0.1], (12, 1)), atol=1e-10, rtol=0)
    angles = np.degrees(np.arccos(-rotation[:, 2, 2]))
    assert angles.max() <= 40 + 1e-6
    assert np.ptp(angles) > 15
    assert set(samples.labels["point"]) == {"F1"}


def test_the_instrument_sees_the_true_tip(folder: Folder) -> None:
    made = folder.simulate()
    samples = made.files[3].samples
    base = made.spec.sets[2].base_in_instrument
    rotation, tip = made.arm.forward(samples.q, made.values)
    assert base is not None
    assert samples.position is not None
    assert samples.rotation is not None
    T = homogeneous(base.rotation, base.position)
    np.testing.assert_allclose(samples.position, tip @ T[:3, :3].T + T[:3, 3], atol=1e-12)
    np.testing.assert_allclose(samples.rotation, T[:3, :3] @ rotation, atol=1e-12)


def test_readings_stay_within_the_encoders_turn(folder: Folder) -> None:
    for file in folder.simulate(with_noise("{encoder_deg: 30}")).files:
        assert (np.abs(file.samples.q) <= np.pi).all()


# ── The truth ────────────────────────────────────────────────────────────────────────────────
def test_later_rows_win_and_values_are_exact(folder: Folder) -> None:
    values = folder.simulate().values
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


def test_a_changed_row_leaves_other_parameters_as_they_were(folder: Folder) -> None:
    before = folder.simulate().values
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
    text = with_noise("{seating_mm: 0.2}").replace("repeats: 2", "repeats: 150")
    tip, landmark = seats(folder.simulate(text), "calibration/P1.csv")
    away = 1e3 * (tip - landmark)
    np.testing.assert_allclose(away.std(axis=0), 0.2, rtol=0.1)
    np.testing.assert_allclose(away.mean(axis=0), 0, atol=0.04)


def test_seating_tilt_has_the_size_asked_for(folder: Folder) -> None:
    text = with_noise("{seating_deg: 0.3}").replace("repeats: 2", "repeats: 150")
    made = folder.simulate(text)
    exact = folder.simulate(EXACT.replace("repeats: 2", "repeats: 150"))
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
    noisy_text = text.replace(
        "sets:\n", "noise: {instrument_mm: 0.1, instrument_deg: 0.2}\nsets:\n", 1
    )
    noisy = folder.simulate(noisy_text).files[3].samples
    assert exact.position is not None
    assert noisy.position is not None
    assert exact.rotation is not None
    assert noisy.rotation is not None
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
@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_reachable_poses_are_reached_by_the_suta(suta_urdf: Path, seed: int) -> None:
    _round_trip(ArmModel.from_urdf(suta_urdf, "tip"), seed)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_reachable_poses_are_reached_by_a_redundant_arm_within_its_limits(seed: int) -> None:
    if not PANDA.is_file():
        pytest.skip("example-robot-data is not installed")
    _round_trip(ArmModel.from_urdf(PANDA, "panda_hand", "panda_link0"), seed)


def _round_trip(arm: ArmModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
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
        targets = Targets(position, rotation, matching)  # type: ignore[arg-type]
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


def test_full_turns_are_taken_off_exactly(suta_urdf: Path) -> None:
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    q = np.array([[np.pi, -np.pi, 3 * np.pi, 0.1, -4.0, 4.0]])
    expected = [np.pi, np.pi, np.pi, 0.1, 2 * np.pi - 4, 4 - 2 * np.pi]
    np.testing.assert_allclose(wrapped(arm, q)[0], expected, atol=1e-15)
    assert wrapped(arm, q)[0, 3] == 0.1


# ── Files ────────────────────────────────────────────────────────────────────────────────────
def bytes_in(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def run(*arguments: object) -> Any:
    result = CliRunner().invoke(command, [str(a) for a in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_the_same_seed_gives_the_same_bytes_and_another_one_others(folder: Folder) -> None:
    file = folder.file(with_noise("{seating_mm: 0.2, encoder_bits: 22, artefact: true}"))
    for name, seed in (("one", 3), ("two", 3), ("three", 4)):
        run(file, "--out", folder.path / name, "--seed", seed)
    one, two, three = (bytes_in(folder.path / name) for name in ("one", "two", "three"))
    assert one == two
    assert one.keys() == three.keys()
    assert not any(one[name] == three[name] for name in one)


def test_json_lists_the_files(folder: Folder) -> None:
    out = folder.path / "out"
    summary = json.loads(run(folder.file(), "--out", out, "--json").stdout)
    assert summary["seed"] == 3
    assert [row["samples"] for row in summary["files"]] == [6, 6, 12, 30]
    assert all((out / row["file"]).is_file() for row in summary["files"])


def test_the_truth_file_gives_the_truth_back(folder: Folder) -> None:
    outliers = "    outliers: {fraction: 0.4, size_mm: [3, 8]}\n    repeats: 2"
    made = folder.simulate(EXACT.replace("    repeats: 2", outliers))
    write_simulation(made, folder.path / "out")
    truth = YAML(typ="safe", pure=True).load((folder.path / "out/truth.yaml").read_text())
    assert truth["simulated"] is True
    for name, row in truth["parameters"].items():
        value = row["value_mm"] / 1e3 if "value_mm" in row else math.radians(row["value_deg"])
        assert value == pytest.approx(made.values[name], abs=1e-14)
    assert truth["parameters"]["joint_2.offset"]["error_deg"] == pytest.approx(4.1)
    for row in truth["outliers"]:
        cells = (folder.path / "out" / row["file"]).read_text().splitlines()[row["line"] - 1]
        assert cells.split(",")[-3:] == [row["placement"], row["repeat"], row["landmark"]]
    assert len(truth["outliers"]) == 4
    assert "simulated" in (folder.path / "out/README.md").read_text()


def test_files_of_another_origin_are_neither_mixed_in_nor_replaced(folder: Folder) -> None:
    made, out = folder.simulate(), folder.path / "out"
    (out / "calibration").mkdir(parents=True)
    (out / "calibration/P9.csv").write_text("old")
    with pytest.raises(OutputError, match=r"calibration: found P9\.csv"):
        write_simulation(made, out)
    (out / "calibration/P9.csv").unlink()
    (out / "README.md").write_text("# My data\n")
    with pytest.raises(OutputError, match=r"README\.md: found a page"):
        write_simulation(made, out)
    assert bytes_in(out) == {"README.md": b"# My data\n"}


def test_an_output_folder_that_cannot_be_made_is_refused(folder: Folder) -> None:
    (folder.path / "out").write_text("a file")
    with pytest.raises(OutputError, match="not created"):
        run(folder.file(), "--out", folder.path / "out")


# ── Refusals ─────────────────────────────────────────────────────────────────────────────────
def test_a_placement_out_of_reach_is_named(folder: Folder) -> None:
    text = EXACT.replace("[412.5, 37.5, 0]", "[1412.5, 37.5, 0]")
    with pytest.raises(JobError) as caught:
        folder.simulate(text)
    message = str(caught.value)
    line = next(k for k, row in enumerate(text.splitlines(), 1) if "P2:" in row)
    assert f"simulation.yaml:{line}: sets.calibration.placements.P2: " in message
    assert "landmark 'A' of placement 'P2' out of the arm's reach (closest: " in message


def test_a_point_out_of_reach_is_named(folder: Folder) -> None:
    with pytest.raises(JobError, match=r"sets\.fixed_point\.points\.F1: found 0 directions"):
        folder.simulate(EXACT.replace("[400, 0, 100]", "[1400, 0, 100]"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("kind: fixed_point", "kind: fixed_pint", r"sets\.fixed_point\.kind: found 'fixed_pint'"),
        ("cone_deg: 40", "cone_deg: 200", r"cone_deg: found 200"),
        ("cone_deg: 40", "cone: 40", r"sets\.fixed_point\.cone: found an unknown key"),
        ("repeats: 2", "repeats: 0", r"repeats: found 0"),
        ("directions: 12", "directions: true", r"directions: found true"),
        ("std_deg: 1}", "std_deg: -1}", r"errors\[1\]\.std_deg: found -1"),
        ("value_deg: 4.1", "value_deg: 4.1, std_deg: 1", r"errors\[2\]: found a value and a std"),
        (", value_deg: 4.1", "", r"errors\[2\]: found no size"),
        ("value_deg: 4.1", "value_mm: 4.1", r"errors\[2\]: found no size .* joint_2\.offset"),
        ('"*.offset"', '"*.ofset"', r"errors\[1\]\.select: found '\*\.ofset'"),
        ("artefact: artefact.yaml", "artefact: none.yaml", r"artefact: found no file"),
        ("seed: 3", "seed: -3", r"seed: found -3"),
        ("seed: 3", "posture_deg: {joint_9: 3}", r":3: posture_deg\.joint_9: found no joint"),
        ("seed: 3", "posture_mm: {joint_1: 3}", r":3: posture_mm\.joint_1: found a reading in m"),
        ("seed: 3", "noise: {encoder_bits: 60}", r"encoder_bits: found 60"),
        ("seed: 3", "noise: {seating_mm: .nan}", r"noise\.seating_mm: found nan"),
        ("P1: {position_mm: [437.5, 12.5, 0]", "../P1: {position_mm: [1, 2, 3]", r"'\.\./P1'"),
        ("tip: tip", "tip: nose", r"found 'nose'"),
        ("samples: 30", "samples: 30\n    artefact: artefact.yaml", r"artefact: found an unknown"),
        ("repeats: 2", "outliers: {fraction: 2, size_mm: [1, 2]}", r"fraction: found 2"),
        ("repeats: 2", "outliers: {fraction: 0.1, size_mm: [3, 2]}", r"size_mm: found \[3, 2\]"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_line(
    folder: Folder, old: str, new: str, message: str
) -> None:
    assert old in EXACT
    with pytest.raises(InputError, match=message) as caught:
        run(folder.file(EXACT.replace(old, new, 1)), "--out", folder.path / "out")
    assert "\n" not in str(caught.value)
    assert not (folder.path / "out").exists()


# ── The SUTA's own data ──────────────────────────────────────────────────────────────────────
def test_the_data_in_the_repository_are_what_the_simulation_makes(
    repository: Path, tmp_path: Path
) -> None:
    data = repository / "data/suta"
    made = simulate(read_simulation(data / "simulation.yaml"))
    for name in ("calibration", "validation"):
        files = [file for file in made.files if file.path.startswith(name)]
        assert [len(file.samples) for file in files] == [45] * 5
    for path in write_simulation(made, tmp_path):
        kept = data / path.relative_to(tmp_path)
        if path.suffix != ".csv":
            assert kept.is_file()
            continue
        assert kept.read_text().splitlines()[0] == path.read_text().splitlines()[0]
        _same_readings(kept, path)


def _same_readings(kept: Path, made: Path) -> None:
    """Equal but for a step of the encoder, which another processor's rounding may tip over."""
    one, other = (
        np.genfromtxt(file, delimiter=",", skip_header=1, usecols=range(6)) for file in (kept, made)
    )
    np.testing.assert_allclose(one, other, atol=1.01 * 2 * np.pi / 2**22, rtol=0)
