"""Poses that are known beforehand, exactly or roughly: what they tell, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli, write_simulated_job
from simulated import dh_parameters
from terms_cases import CASES, SIGMA, each_case, given_as_it_is, noises, scene

from suta_calib.errors import ParameterError
from suta_calib.geometry.numbers import (
    rotation_from_rpy,
    rotation_from_vector,
    rpy_from_rotation,
    vector_from_rotation,
    vector_turning_z_to,
)
from suta_calib.job.calibration import CalibrationJob
from suta_calib.model.parameters import POSITION
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import GivenPose, Term
from suta_calib.trust.rereading import explaining_reading

SURE = GivenPose(np.array([0.1, -0.2, 0.3]), rotation_from_rpy([0.3, -2.0, 1.0]))


@each_case
def test_what_stands_where_it_is_known_to_tells_where_the_arm_stands(name: str) -> None:
    s = scene(name)
    term = s.exact(*noises(SIGMA, False))
    if not term.outside or name == "gravity":
        pytest.skip("distances and gravity do not see where anything stands")
    if {p.key for p in term.own_parameters} in ({"z", "rx", "ry"}, {"x", "y", "rx", "ry"}):
        term = replace(term, given=axes_as_they_are(term, s.truth))
    else:
        term = given_as_it_is(term, s.truth)
    term.check_given()
    solution = solve(Problem([term], dh_parameters(s.arm)))
    assert solution.converged
    # Parallel pillars still hide the tool's length, now against the base's height.
    assert len(solution.unidentified) < len(CASES[name].unidentified)
    estimate = solution.estimates["joint_1.offset"]
    assert (estimate.state, estimate.given) == ("identified", ())
    assert estimate.value == pytest.approx(s.truth["joint_1.offset"], abs=1e-9)
    states = {p.name: solution.estimates[p.name].state for p in term.unknowns if not p.free}
    assert states
    assert set(states.values()) == {"fixed"}


def axes_as_they_are(term: Term, truth: dict[str, float]) -> dict[str, GivenPose]:
    """Planes by their z axis and lines by their x axis, each at any point of it."""
    values, given = term.start_values(truth), {}
    for label in term.places[0]:
        owner = f"{term.place_unknown}[{label}]"
        frame = rotation_from_vector([values[f"{owner}.rx"], values[f"{owner}.ry"], 0.0])
        at = frame @ [values.get(f"{owner}.{key}", 0.07) for key in POSITION]
        turned = frame if f"{owner}.z" in values else frame[:, [2, 0, 1]]
        given[label] = GivenPose(at, turned)
    return given


def test_a_rough_pose_counts_as_much_as_it_is_worth() -> None:
    """The instrument's pose drawn as its priors say: the base scatters as predicted."""
    s, rng, trials = scene("tracked_point"), np.random.default_rng(0), 40
    truth = s.exact().start_values(s.truth)
    names = ("joint_1.offset", "joint_2.z")
    off = []
    for samples in s.samples(SIGMA, seed=5, trials=trials):
        term = s.term(samples, *noises(SIGMA, False))
        true = rotation_from_vector([truth[f"base.{k}"] for k in ("rx", "ry", "rz")])
        position = np.array([truth[f"base.{k}"] for k in POSITION])
        said = GivenPose(
            position + 1e-3 * rng.standard_normal(3),
            true @ rotation_from_vector(3e-3 * rng.standard_normal(3)),
            np.full(3, 1e-3),
            3e-3,
        )
        term = replace(term, given={"base_in_instrument": said})
        estimates = solve(Problem([term], dh_parameters(s.arm))).estimates
        assert estimates["base.x"].state in ("prior", "identified")
        off.append([(estimates[n].value - s.truth[n]) / estimates[n].std for n in names])
    ratio = np.sqrt(np.mean(np.square(off), axis=0))
    # Four standard deviations of the root mean square of so many.
    assert np.abs(ratio - 1.0).max() < 4.0 / np.sqrt(2.0 * trials)


@pytest.mark.parametrize("rpy", [[0.0, 0.0, 0.0], [0.3, -2.0, 1.0], [np.pi, 0.0, 0.4]])
def test_the_priors_are_the_marginal_ones(rpy: list[float]) -> None:
    """Against draws of poses: as a pose, as its inverse, and as a plane's or a line's axis."""
    rng, n, tilt = np.random.default_rng(1), 4000, 1e-3
    R, p = rotation_from_rpy(rpy), np.array([0.8, -0.5, 0.3])
    given = GivenPose(p, R, np.full(3, 2e-4), tilt)
    turned = rotation_from_vector(tilt * rng.standard_normal((n, 3))) @ R
    moved = p + 2e-4 * rng.standard_normal((n, 3))
    drawn = {
        "pose": np.hstack([moved, near(vector_from_rotation(turned), vector_from_rotation(R))]),
        "inverse": np.hstack(
            [
                -np.einsum("nij,ni->nj", turned, moved),
                near(vector_from_rotation(np.swapaxes(turned, 1, 2)), vector_from_rotation(R.T)),
            ]
        ),
    }
    known = {"pose": given.of_pose("a"), "inverse": given.inverse.of_pose("a")}
    for what, values in drawn.items():
        std = [each.std for each in known[what].values()]
        np.testing.assert_allclose(values.std(axis=0), std, rtol=0.08, err_msg=what)
        means = [each.value for each in known[what].values()]
        np.testing.assert_allclose(values.mean(axis=0), means, atol=1e-4, err_msg=what)
    for axis in (0, 2):
        up = np.sign(R[2, axis]) or 1.0
        turns = vector_turning_z_to(up * turned[:, :, axis])
        if np.ptp(np.sign(turned[:, 2, axis])) > 0:
            continue  # about the horizontal a draw may be described from either side
        found = given.of_axis("a", axis, ())
        std = [each.std for each in found.values()]
        np.testing.assert_allclose(turns[:, :2].std(axis=0), std, rtol=0.08)


def near(vectors: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """The description of each turn, of the two, that is nearer the middle one."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    other = vectors * (1.0 - 2.0 * np.pi / np.maximum(length, 1e-12))
    far = np.linalg.norm(vectors - middle, axis=1) > np.pi
    return np.where(far[:, None], other, vectors)


def test_of_two_rows_one_says_where_it_stands() -> None:
    s = scene("tracked_point")
    term = s.exact()
    given = replace(term, given={"base_in_instrument": SURE})
    for terms in ((term, given), (given, term)):
        problem = Problem(terms, dh_parameters(s.arm))
        assert not problem.parameters["base.x"].free
        assert problem.values(problem.start())["base.x"] == pytest.approx(0.1)
    other = replace(SURE, position=SURE.position + 0.01)
    with pytest.raises(ParameterError, match=r"two given poses that differ in base\.x"):
        Problem([given, replace(term, given={"base_in_instrument": other})], dh_parameters(s.arm))


POSE = "pose: {position_mm: [-310, 870, -890], rotation_rpy_deg: [0, 0, 10], "


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("pose: {position_mm: [1, 2]}", "position_mm: found"),
        ("pose: {rotation_rpy_deg: [0, 0, 1]}", "position_mm"),
        ("pose: {position_mm: [1, 2, 3]}", "only partly known"),
        (POSE + "prior_mm: 1}", "both prior_mm and prior_deg or with neither"),
        (POSE + "prior_mm: 0}", "prior_mm: found 0"),
        (POSE + "prior: 1}", "prior"),
        ("pose: {A: {position_mm: [1, 2, 3]}}", "a pose of target 'A'"),
        ("pose: {}", "an empty mapping"),
        ("base_in_instrument: {position_mm: [1, -0.5, 0.3]}", "looks like metres"),
        ("base_in_instrument: {position_mm: [1, 2, 3], prior_deg: 1}", "without an orientation"),
        ("eye_in_tip: {position_mm: [1, 2, 3]}", "a key that tracked_point does not use"),
        (POSE + "}, base_in_instrument: {position_mm: [1, 2, 3]}", "one or the other"),
    ],
)
def test_what_makes_no_sense_is_refused(
    tmp_path: Path, suta_urdf: Path, row: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = write_simulated_job(tmp_path / "job", suta_urdf)
    job.write_text(job.read_text().replace("sigma_mm: 0.05", row, 1))
    assert cli("observe", job) == 2
    error = capsys.readouterr().err
    assert message in error
    assert f"{job}:" in error


@pytest.mark.parametrize("fitted", ["", POSE + "}, "])
def test_a_held_out_row_says_no_other_pose(
    tmp_path: Path, suta_urdf: Path, fitted: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = write_simulated_job(tmp_path / "job", suta_urdf)
    other = POSE.replace("-310", "-320") + "}, "
    text = job.read_text().replace("samples: 'cal", f"{fitted}samples: 'cal")
    job.write_text(text.replace("samples: 'val", f"{other}samples: 'val"))
    assert cli("observe", job) == 2
    message = "a given pose that differs from that of the observations in base.x"
    assert message in capsys.readouterr().err


def test_an_instruments_pose_is_that_in_the_base(tmp_path: Path, suta_urdf: Path) -> None:
    """The simulated instrument, said as it stands in the base rather than the other way round."""
    job = write_simulated_job(tmp_path / "job", suta_urdf)
    turn = rotation_from_vector([0.1, -0.4, 1.2])
    given = GivenPose(np.array([1.0, -0.5, 0.3]), turn).inverse
    rpy = np.degrees(np.array([*map(float, _rpy(given))]))
    at = ", ".join(f"{v:.9f}" for v in 1e3 * given.position)
    row = f"pose: {{position_mm: [{at}], rotation_rpy_deg: [{', '.join(map(str, rpy))}]}}"
    job.write_text(job.read_text().replace("sigma_mm: 0.05", row, 1))
    loaded = CalibrationJob.load(job)
    solution = loaded.run().solution
    np.testing.assert_allclose(solution.values["base.x"], 1.0, atol=1e-9)
    assert solution.estimates["joint_1.offset"].state == "identified"
    assert abs(solution.values["joint_1.offset"]) < 5.0 * solution.estimates["joint_1.offset"].std


def _rpy(pose: GivenPose) -> np.ndarray:
    assert pose.rotation is not None
    return rpy_from_rotation(pose.rotation)


def test_a_pose_that_is_wrong_is_named(tmp_path: Path, suta_urdf: Path) -> None:
    """An instrument five centimetres from where it was surveyed."""
    job = write_simulated_job(tmp_path / "job", suta_urdf)
    turn = np.degrees(rpy_from_rotation(rotation_from_vector([0.1, -0.4, 1.2])))
    row = (
        "base_in_instrument: {position_mm: [1000, -450, 300], "
        f"rotation_rpy_deg: [{', '.join(map(str, turn))}]}}"
    )
    job.write_text(job.read_text().replace("sigma_mm: 0.05", row, 1))
    found = CalibrationJob.load(job).run().assessment
    assert not found.usable
    assert any("base_in_instrument is not where its given pose states" in n for n in found.notes)


@pytest.mark.parametrize("axis", [0, 1])
def test_positions_from_a_left_handed_survey_are_named(axis: int) -> None:
    """All anchors of a draw-wire sensor with the wrong sign of one coordinate, and only then."""
    s = scene("range")
    right = given_as_it_is(s.exact(*noises(SIGMA, False)), s.truth)
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)
    mirrored = {
        label: replace(pose, position=pose.position * sign) for label, pose in right.given.items()
    }
    assert len(mirrored) > 1
    parameters = dh_parameters(s.arm)
    solution = solve(Problem([replace(right, given=mirrored)], parameters))
    cause = explaining_reading(solution)
    assert cause is not None
    assert cause.description == (
        f"the given positions are mirrored: their {'xyz'[axis]} has the wrong sign"
    )
    assert cause.after < 0.01 * cause.before
    assert explaining_reading(solve(Problem([right], parameters))) is None
