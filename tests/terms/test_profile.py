"""A line scanner that sees a ball or a plane: what is particular to it, from files to an answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import answer, cli
from moving_arm import MovingArm
from simulated import SUTA_URDF, Spread
from terms_cases import scene

from suta_calib.errors import SamplesError, SutaCalibWarning
from suta_calib.geometry.numbers import random_rotations, rotation_from_vector
from suta_calib.measurements import Samples
from suta_calib.measurements.profiles import Profiles, profiles_of
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, GivenPose, MeasuredPoses, Noise, Profile, TimeOffset
from suta_calib.terms.external_frame import pose_named
from suta_calib.terms.profile_start import scanner_by_ball, scanner_by_plane

pytestmark = pytest.mark.usefixtures("undrawn")

BALL, PLANE = "profile of a ball", "profile of a plane"
SIZED = "profile of a ball of unknown radius"
SIMULATION = """\
arm: {urdf: arm.urdf, tip: tip}
seed: 3
errors: [{select: ["joint_[2-5].offset"], std_deg: 0.5}]
noise: {instrument_mm: 0.05}
sets:
  calibration: &set
    kind: profile
    plane: true
    samples: 15
    points: 20
    scanner_in_tip: {position_mm: [20, -30, 40], rotation_rpy_deg: [5, 10, 90]}
    target_in_base: {position_mm: [350, 100, -100], rotation_rpy_deg: [10, 0, 20]}
  validation: *set
"""
ROW = "{{kind: profile, profiles: profiles/{0}.csv, plane: true, samples: '{0}/*.csv'}}"
JOB = f"""\
arm: {{urdf: arm.urdf, tip: tip}}
parameters: [{{select: ["joint_[2-5].offset"], bound_deg: 5}}]
observations: [{ROW.format("calibration")}]
validation: [{ROW.format("validation")}]
"""


def over_known_poses(name: str, sigma: float = 0.0, seed: int = 0) -> Profile:
    """The term of a scene over its true poses."""
    s = scene(name)
    samples = s.samples(Spread(position=sigma), seed)[0]
    term = s.term(samples)
    poses = term.poses.at(s.truth)
    known = term.over_poses(MeasuredPoses(*poses, term.poses.samples))
    assert isinstance(known, Profile)
    return known


def profiles_in(term: Profile) -> Profiles:
    """The points of a term as they would be in a file."""
    scan, point = np.nonzero(np.isfinite(term.pixels).all(axis=2))
    return profiles_of(term.poses.samples.labels["scan"][scan], term.pixels[scan, point])


def test_profiles_of_a_job_are_simulated_and_tell_the_arm(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_bytes(SUTA_URDF.read_bytes())
    (tmp_path / "simulation.yaml").write_text(SIMULATION)
    (tmp_path / "job.yaml").write_text(JOB)
    assert cli("simulate", tmp_path / "simulation.yaml", "--out", tmp_path) == 0
    found = answer("calibrate", tmp_path / "job.yaml", "--out", tmp_path / "results")
    for data in ("calibration", "validation"):
        metrics = found["metrics"][data]
        assert metrics["after"]["rms_mm"] < 0.07 < 1.0 < metrics["before"]["rms_mm"]
    x = [found["parameters"][f"hand_eye.{key}"] for key in "xyz"]
    for entry, true in zip(x, (0.02, -0.03, 0.04), strict=True):
        assert abs(entry["value"] - true) < 5 * entry["std"]


@pytest.mark.parametrize("name", [BALL, PLANE, SIZED])
def test_standard_deviations_hold(name: str) -> None:
    """Of five measurements over known poses no unknown is farther off than chance has it."""
    truth = solve(Problem([over_known_poses(name)], ParameterSet())).values
    off = []
    for seed in range(5):
        solution = solve(Problem([over_known_poses(name, 5e-5, seed)], ParameterSet()))
        estimates = solution.estimates.values()
        off.append([(e.value - truth[e.name]) / e.std for e in estimates if e.std])
    rms = np.sqrt(np.mean(np.square(off)))
    assert 0.6 < rms < 1.5


@pytest.mark.parametrize("known", [True, False])
def test_the_start_from_a_ball_needs_no_signs(known: bool) -> None:
    random, n, radius = np.random.default_rng(5), 10, 0.02
    X = random_rotations(random, 1)[0], random.uniform(-0.1, 0.1, 3)
    R = random_rotations(random, 1)[0] @ rotation_from_vector(random.uniform(-0.6, 0.6, (n, 3)))
    centre = np.column_stack(
        [
            random.uniform(-0.02, 0.02, n),
            random.uniform(-0.7, 0.7, n) * radius,
            random.uniform(0.08, 0.12, n),
        ]
    )
    ball = np.array([0.6, 0.1, 0.2])
    p = ball - np.einsum("nij,nj->ni", R, centre @ X[0].T + X[1])
    section = np.sqrt(radius**2 - centre[:, 1] ** 2)
    arcs = np.column_stack([centre[:, 0], centre[:, 2], section])
    # One scan is of something else: it decides nothing.
    arcs[3, :2] += 0.03
    found, place, size = scanner_by_ball((R, p), arcs, radius if known else None)
    np.testing.assert_allclose(found[0], X[0], atol=1e-3)
    np.testing.assert_allclose(found[1], X[1], atol=1e-4)
    np.testing.assert_allclose(place, ball, atol=1e-4)
    assert size == pytest.approx(radius, abs=1e-4)


def test_the_start_from_a_plane() -> None:
    random, n = np.random.default_rng(6), 14
    X = random_rotations(random, 1)[0], random.uniform(-0.1, 0.1, 3)
    normal, z = np.array([0.1, -0.2, 0.9746794]), 0.15
    eye = rotation_from_vector(random.uniform(-0.6, 0.6, (n, 3))) @ np.diag([1.0, -1.0, -1.0])
    at = np.column_stack([random.uniform(-0.2, 0.2, (n, 2)), random.uniform(0.3, 0.4, n)])
    R = eye @ X[0].T
    height, x = z - at @ normal, np.array([-0.03, 0.03])
    along = (height[:, None] - np.outer(eye[:, :, 0] @ normal, x)) / (eye[:, :, 2] @ normal)[
        :, None
    ]
    ends = np.stack([np.tile(x, (n, 1)), along], axis=2)
    found, towards, distance = scanner_by_plane((R, at - R @ X[1]), ends)
    np.testing.assert_allclose(found[0], X[0], atol=1e-3)
    np.testing.assert_allclose(found[1], X[1], atol=1e-3)
    np.testing.assert_allclose(towards, normal, atol=1e-3)
    assert distance == pytest.approx(z, abs=1e-3)


def test_over_measured_poses_the_scanner_is_found() -> None:
    term = over_known_poses(BALL, 2e-5)
    R, p = term.poses.at({})
    samples = Samples.from_arrays(
        [], np.zeros((len(R), 0)), labels={"scan": term.poses.samples.labels["scan"]}
    )
    alone = Profile.of_profiles(MeasuredPoses(R, p, samples), profiles_in(term), radius=0.04)
    values = solve(Problem([alone], ParameterSet())).values
    np.testing.assert_allclose(pose_named(values, "hand_eye")[1], [0.02, -0.05, 0.08], atol=2e-4)


def test_a_profile_without_the_ball_is_left_out_with_a_word() -> None:
    term = over_known_poses(BALL)
    profiles = profiles_in(term)
    of_last = profiles.scan == "3"
    flat = np.where(of_last[:, None], profiles.point * [1.0, 0.0] + [0.0, 0.2], profiles.point)
    with pytest.warns(SutaCalibWarning, match=r"no ball of 1 of 20 scans \(3\): they are left out"):
        fewer = Profile.of_profiles(term.poses, profiles_of(profiles.scan, flat), radius=0.04)
    assert "3" not in fewer.poses.samples.labels["scan"]
    assert len(fewer.poses) == 19


def test_what_cannot_be_used_is_refused() -> None:
    term = over_known_poses(BALL)
    profiles, poses = profiles_in(term), term.poses
    other = replace(profiles, scan=np.char.add("scan_", profiles.scan))
    with pytest.raises(SamplesError, match="in the samples and scan_0"):
        Profile.of_profiles(poses, other, radius=0.04)
    with pytest.raises(SamplesError, match="too large for this ball: sphere_radius_mm is 10"):
        Profile.of_profiles(poses, profiles, radius=0.01)
    with pytest.raises(SamplesError, match="a ball or a plane"):
        Profile(poses, radius=0.04, plane=True)
    with pytest.raises(SamplesError, match="greater than 0"):
        Profile(poses, radius=-0.04)
    with pytest.raises(SamplesError, match="3 profiles of the ball; expected at least 4"):
        term.take(np.arange(3)).check_enough()
    with pytest.raises(SamplesError, match="one ball per target"):
        replace(term, radius=0.05).check_beside(term)


def test_a_diameter_for_a_radius_is_read_again_as_it_is() -> None:
    term = over_known_poses(BALL, 5e-5)
    wrong = replace(term, radius=0.08)
    sentences = dict(wrong.misread)
    (sentence,) = (s for s in sentences if "diameter" in s)
    assert sentence == "80 mm is the diameter of the ball, not its radius."
    read_again = sentences[sentence]
    assert isinstance(read_again, Profile)
    assert read_again.radius == pytest.approx(0.04)


def test_a_noise_that_is_said_is_taken() -> None:
    term = replace(over_known_poses(BALL), noise=Noise(1e-4))
    assert term.blocks[0].noise.sigma == 1e-4


@pytest.mark.parametrize("late", [-0.03, 0.05])
def test_a_scanner_whose_clock_is_off_over_a_moving_arm(late: float) -> None:
    moving, random = MovingArm(rows=150), np.random.default_rng(2)
    arm = moving.arm

    def readings(time: np.ndarray) -> np.ndarray:
        return np.asarray(0.5 + 0.3 * moving.readings(time))

    (turn,), (place,) = arm.forward(readings(moving.time[:1]))
    shift = np.array([0.02, -0.05, 0.08])
    at = GivenPose(turn @ [0.0, 0.0, 0.3] + place, turn @ rotation_from_vector([3.0, 0.2, 0.0]))
    blank = ArmPoses(arm, Samples.from_arrays(arm.joints, readings(moving.time + late)))
    term = Profile(blank, plane=True, reach=(0.0, 5.0))
    own = dict.fromkeys((p.name for p in term.own_parameters), 0.0)
    own |= dict(zip(("hand_eye.x", "hand_eye.y", "hand_eye.z"), shift.tolist(), strict=True))
    own |= {n: prior.value for n, prior in term.prior_from_pose("target_in_base", at).items()}
    pixels = term.observed(own, blank).pixels
    assert pixels is not None
    assert np.isfinite(pixels).all()
    pixels = pixels + [0.0, 5e-5] * random.standard_normal(pixels.shape)
    names = [str(k) for k in range(len(pixels))]
    late_term = Profile.from_arrays(
        arm,
        readings(moving.time),
        pixels=pixels,
        scan=names,
        time=moving.time,
        plane=True,
        time_offset=TimeOffset(bound=0.1),
    )
    solution = solve(Problem([late_term], ParameterSet()))
    found = solution.estimates["time_offset[default]"]
    assert found.std is not None
    assert abs(found.value - late) < 4.0 * found.std < 5e-3


def test_what_is_wrong_with_the_scans_of_a_job_is_a_doubt() -> None:
    term = over_known_poses(BALL, 2e-5)
    seen = term.pixels.copy()
    seen[4, :, 0] *= -1.0
    samples = replace(term.poses.samples, pixels=seen)
    wrong = term.over_poses(term.poses.with_samples(samples))
    ((sentence, level),) = wrong.doubts.items()
    assert sentence.startswith("Scan 4 fits the others with x reversed")
    assert level == "bad"
    assert not term.doubts
