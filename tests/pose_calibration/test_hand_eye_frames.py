"""Hand-eye calibration with noisy orientations: what frames are chosen cannot matter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from camera_scenes import X as EYE
from camera_scenes import pictures, solved
from hand_eye_scenes import calibrate, errors, simulate, slides
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from studies import of_size

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import homogeneous, skew
from suta_calib.measurements import Chessboard
from suta_calib.measurements.pose_files import read_pose_pairs
from suta_calib.pose_calibration.hand_eye import (
    HandEyeCalibration,
    calibrate_hand_eye,
    hand_eye_from_pairs,
)
from suta_calib.terms.hand_eye_start import Poses, inverse_poses
from suta_calib.terms.synthetic import PoseNoise

CASE = Path(__file__).parents[3] / "shared/cases/tag-orientation-noise"
KUKA = Path(__file__).parents[3] / "shared/data/poses/handeye_kuka_1.csv"


@dataclass(frozen=True, eq=False)
class Pairs:
    """Simulated pairs: 25 turns of the hand by up to 40° about all axes, a tag that is seen badly.

    Attributes:
        hand, seen: exact poses of the hand, and noisy ones of the tag in the eye.
        X, Z: the truth.
        noise: of a component of the tag's position, m, and of its turn, rad.
    """

    hand: Poses
    seen: Poses
    X: Poses
    Z: Poses
    noise: tuple[float, float]


def tag(seed: int, distance: float, degrees: float, millimetres: float, count: int = 25) -> Pairs:
    random = np.random.default_rng([seed, round(10 * distance), round(10 * degrees)])
    X = Rotation.random(random_state=random.integers(1 << 30)), random.uniform(-0.1, 0.1, 3)
    Z = Rotation.random(random_state=random.integers(1 << 30)), random.uniform(-0.6, 0.6, 3)
    axes = random.standard_normal((count, 3))
    axes *= np.radians(random.uniform(0, 40, count) / np.linalg.norm(axes, axis=1))[:, None]
    A = Rotation.random(random_state=random.integers(1 << 30)) * Rotation.from_rotvec(axes)
    ahead = random.uniform([-0.1, -0.1, -0.15], [0.1, 0.1, 0.15], (count, 3))
    ahead[:, 2] += distance
    p = Z[1] - (A * X[0]).apply(ahead) - A.apply(X[1])
    noise = 1e-3 * millimetres, float(np.radians(degrees))
    turned = Rotation.from_rotvec(noise[1] * random.standard_normal((count, 3)))
    return Pairs(
        (A.as_matrix(), p),
        (
            (turned * (A * X[0]).inv() * Z[0]).as_matrix(),
            ahead + noise[0] * random.standard_normal((count, 3)),
        ),
        (X[0].as_matrix(), X[1]),
        (Z[0].as_matrix(), Z[1]),
        noise,
    )


def off(X: FloatArray, true: Poses) -> FloatArray:
    """Displacement (m, outer axes) and turn (rad, eye's axes) of X against the truth, (6,)."""
    turn = Rotation.from_matrix(true[0].T @ X[:3, :3]).as_rotvec()
    return np.concatenate([X[:3, 3] - true[1], turn])


def weighted_least_squares(pairs: Pairs) -> FloatArray:
    """What least squares weighted by the two noises, from the truth, gets wrong: (6,)."""
    A, B = (Rotation.from_matrix(R) for R in (pairs.hand[0], pairs.seen[0]))

    def residuals(step: FloatArray) -> FloatArray:
        X = Rotation.from_matrix(pairs.X[0]) * Rotation.from_rotvec(step[3:6])
        Z = Rotation.from_matrix(pairs.Z[0]) * Rotation.from_rotvec(step[9:])
        eye = (A * X).inv()
        place = eye.apply(pairs.Z[1] + step[6:9] - pairs.hand[1] - A.apply(pairs.X[1] + step[:3]))
        turn = (eye * Z * B.inv()).as_rotvec()
        slid = (place - pairs.seen[1]) / pairs.noise[0]
        return np.concatenate([slid.ravel(), turn.ravel() / pairs.noise[1]])

    return np.asarray(least_squares(residuals, np.zeros(12)).x[:6])


def lengths(step: FloatArray) -> FloatArray:
    return np.linalg.norm(step.reshape(2, 3), axis=1)


# ── Good data are solved ─────────────────────────────────────────────────────────────────────
@pytest.mark.skipif(not CASE.exists(), reason="without the shared cases")
@pytest.mark.parametrize("name", ["poses", "poses_target_origin_moved_300mm"])
def test_a_tag_whose_turns_are_noisy_is_solved_wherever_its_origin_is(name: str) -> None:
    found = hand_eye_from_pairs(read_pose_pairs(CASE / f"{name}.csv"))
    truth = np.array(
        [
            [0.058307, -0.995842, -0.069999, 0.03],
            [0.979393, 0.070643, -0.189207, -0.06],
            [0.193365, -0.057525, 0.979439, 0.09],
        ]
    )
    wrong = lengths(off(found.X, (truth[:, :3], truth[:, 3])))
    assert wrong[0] < 1.5e-3
    assert np.degrees(wrong[1]) < 0.1
    assert np.linalg.norm(found.std["X"][:3]) < 3e-3
    assert found.assessment.level == "care"
    assert any("Add poses" in note for note in found.assessment.notes)


def sweep(seeds: range, *, distances: tuple[float, ...], noises: list[tuple[float, float]]) -> None:
    """Solved everywhere, as good as weighted least squares, and as sure as it says."""
    ours, plain, squares, worst = [], [], [], 0.0
    for seed, distance, (degrees, millimetres) in product(seeds, distances, noises):
        pairs = tag(seed, distance, degrees, millimetres)
        found = calibrate_hand_eye(pairs.hand, pairs.seen)
        wrong, covariance = off(found.X, pairs.X), found.covariance[:6, :6]
        ours.append(lengths(wrong))
        plain.append(lengths(weighted_least_squares(pairs)))
        squares.append(wrong @ np.linalg.solve(covariance, wrong) / 6.0)
        std = lengths(found.std["X"])
        worst = max(worst, float((lengths(wrong) / std).max()))
        assert std[0] < 0.03
    assert worst < 3.0
    relative = np.log(np.array(ours) / np.array(plain)).mean(axis=0)
    assert (np.exp(relative) < 1.2).all(), np.exp(relative)
    rms = [np.sqrt(np.mean(np.square(each), axis=0)) for each in (ours, plain)]
    assert (rms[0] < 1.2 * rms[1]).all(), rms
    # A chi-squared with 6 per case, and few cases share a ±.
    spread = np.sqrt(2.0 / 6.0 / len(squares))
    assert abs(np.mean(squares) - 1.0) < 0.1 + 3.0 * spread, np.mean(squares)


def test_noisy_tags_are_as_well_solved_as_by_weighted_least_squares() -> None:
    sweep(range(2), distances=(0.4, 0.8), noises=[(0.2, 5.0), (0.5, 1.0), (1.0, 2.0), (2.0, 5.0)])


@pytest.mark.slow
def test_noisy_tags_are_as_well_solved_as_by_weighted_least_squares_closely() -> None:
    noises = [*product((0.2, 0.5, 1.0, 2.0), (1.0, 2.0, 5.0))]
    sweep(range(10), distances=(0.4, 0.8), noises=noises)


# ── Frames ───────────────────────────────────────────────────────────────────────────────────
def after(outer: Poses, inner: Poses) -> Poses:
    """``T_a_c = T_a_b T_b_c``, of one pose or of many."""
    return outer[0] @ inner[0], (outer[0] @ inner[1][..., None])[..., 0] + outer[1]


def in_other_frames(pairs: Pairs, frames: list[Poses]) -> tuple[Poses, Poses]:
    """Hand and seen poses with base, hand, eye and target called by other frames."""
    base, hand, eye, target = frames
    return (
        after(after(inverse_poses(base), pairs.hand), hand),
        after(after(inverse_poses(eye), pairs.seen), target),
    )


def mapped_back(found: HandEyeCalibration, frames: list[Poses]) -> tuple[FloatArray, FloatArray]:
    """X in the first frames, and the standard deviations (2,) of its place and turn there."""
    _, hand, eye, _ = frames
    R, p = after(after(hand, (found.X[:3, :3], found.X[:3, 3])), inverse_poses(eye))
    to = np.zeros((6, 6))
    to[:3, :3], to[3:, 3:] = hand[0], eye[0]
    to[:3, 3:] = -hand[0] @ found.X[:3, :3] @ skew(inverse_poses(eye)[1])
    covariance = to @ found.covariance[:6, :6] @ to.T
    return homogeneous(R, p), lengths(np.sqrt(np.diag(covariance)))


@cache
def as_seen(noise: tuple[float, float, float]) -> tuple[Pairs, HandEyeCalibration]:
    """Pairs of a tag, and what they tell in the frames in which they are."""
    pairs = tag(0, *noise)
    return pairs, calibrate_hand_eye(pairs.hand, pairs.seen)


@pytest.mark.parametrize("which", ["base", "hand", "eye", "target", "all"])
@pytest.mark.parametrize("noise", [(0.8, 1.0, 1.0), (0.4, 0.2, 5.0), (0.8, 2.0, 2.0)])
def test_frames_that_are_chosen_on_either_side_do_not_count(
    which: str, noise: tuple[float, float, float]
) -> None:
    (pairs, found), random = as_seen(noise), np.random.default_rng(1)
    frames = []
    for side, far in (("base", 2.0), ("hand", 0.3), ("eye", 0.2), ("target", 0.3)):
        turn, shift = Rotation.random(random_state=random), far * random.standard_normal(3)
        same = which not in (side, "all")
        frames.append((np.eye(3), np.zeros(3)) if same else (turn.as_matrix(), shift))
    moved = calibrate_hand_eye(*in_other_frames(pairs, frames))
    X, std = mapped_back(moved, frames)
    # What noise two points have in common is estimated: not exactly the same one.
    close = 5e-3 if which in ("base", "eye") else 0.8
    stated = lengths(found.std["X"])
    assert (lengths(off(X, (found.X[:3, :3], found.X[:3, 3]))) < close * stated).all()
    np.testing.assert_allclose(std, stated, rtol=0.01 if close < 0.1 else 0.3)
    assert moved.assessment.level == found.assessment.level
    assert moved.outliers == found.outliers


@pytest.mark.parametrize("eye", [PoseNoise(1e-3, 0.0175), PoseNoise(5e-3, 0.0035)])
@pytest.mark.parametrize("turns", ["none", "one axis"])
def test_what_only_noise_tells_is_refused_in_all_frames(turns: str, eye: PoseNoise) -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    more = {"turn": 0.0} if turns == "none" else {"turn": np.pi / 4, "axes": axis}
    data = simulate(30, hand=PoseNoise(1e-4, 3e-4), eye=eye, **more)
    pairs = Pairs(data.poses, data.seen, data.poses, data.seen, (0.0, 0.0))
    random = np.random.default_rng(2)
    for far in (0.0, 0.3):
        frames = [(np.eye(3), far * random.standard_normal(3)) for _ in range(4)]
        with pytest.raises(SamplesError, match="do not determine X") as problem:
            calibrate_hand_eye(*in_other_frames(pairs, frames))
        named = slides(problem.value)
        assert np.linalg.matrix_rank(named) == (3 if turns == "none" else 1)
        assert turns == "none" or abs(named[0] @ axis) > 0.99


@pytest.mark.skipif(not KUKA.exists(), reason="without the shared data")
@pytest.mark.parametrize("noise", [(0.0, 0.0), (3e-4, 1e-3), (1e-3, 4e-3), (1e-3, 0.0175)])
def test_a_hand_that_hardly_turned_is_refused_also_with_noise(noise: tuple[float, float]) -> None:
    """The first five rows are displacements."""
    pairs, random = read_pose_pairs(KUKA), np.random.default_rng(0)
    (RA, pA), (RB, pB) = ((R[:5], p[:5]) for R, p in (pairs.hand, pairs.target))
    shake = [Rotation.from_rotvec(noise[1] * random.standard_normal((5, 3))) for _ in range(2)]
    slid = noise[0] * random.standard_normal((2, 5, 3))
    with pytest.raises(SamplesError, match=r"do not determine X: it may be anywhere"):
        calibrate_hand_eye(
            (RA @ shake[0].as_matrix(), pA + slid[0]), (RB @ shake[1].as_matrix(), pB + slid[1])
        )


def test_weak_turns_are_answered_with_a_large_standard_deviation() -> None:
    """Turns of 5° say little: the answer is within what is stated, and says that it is little."""
    for seed in range(3):
        noise = PoseNoise(3e-4, 2e-3)
        data = simulate(30, hand=noise, eye=noise, turn=np.radians(5.0), seed=seed)
        found = calibrate(data)
        std = float(np.linalg.norm(found.std["X"][:3]))
        assert 3e-3 < std < 0.03
        assert errors(found, data)[1] < 3.0 * std
        assert any("Add poses" in note for note in found.assessment.notes)


# ── Pairs and pictures ───────────────────────────────────────────────────────────────────────
def test_pictures_of_a_small_tag_are_solved_as_its_pairs_are() -> None:
    """A tag of 36 mm at half a metre is turned by degrees from picture to picture by noise."""
    for seed in range(2):
        found = solved(pictures(20, seed=seed, pixel=1.0, board=Chessboard(4, 3, 0.012)))
        (camera,) = found.cameras
        assert not len(found.solution.identification.fixed)
        assert np.linalg.norm(camera.X[:3, 3] - EYE[1]) < 3.0 * np.linalg.norm(camera.std["X"][:3])


def test_with_fixed_intrinsics_nothing_of_x_is_held_in_silence() -> None:
    """Noise of the hand's turns, 0.5°, once held X's distance where it began."""
    scene = pictures(20, pixel=0.2, robot=(1e-3, 9e-3))
    found = solved(scene, intrinsics="fixed")
    assert not len(found.solution.identification.fixed)


@pytest.mark.parametrize("seeds", of_size(3, 6))
@pytest.mark.parametrize("distance", [0.3, 0.8])
def test_one_distance_is_no_error_that_grows_with_it(distance: float, seeds: int) -> None:
    """Depths that change by their noise alone are no depths to regress residuals on."""
    for seed in range(seeds):
        random = np.random.default_rng(seed)
        X, Z = ((Rotation.random(random_state=random), random.uniform(-0.1, 0.1, 3)) for _ in "XZ")
        axes = random.standard_normal((25, 3))
        axes *= np.radians(random.uniform(10, 40, 25) / np.linalg.norm(axes, axis=1))[:, None]
        A = Rotation.random(random_state=random) * Rotation.from_rotvec(axes)
        B = (A * X[0]).inv() * Z[0]
        ahead = np.column_stack([random.uniform(-0.05, 0.05, (25, 2)), np.full(25, distance)])
        position = Z[1] - (A * X[0]).apply(ahead) - A.apply(X[1])
        seen = (
            (B * Rotation.from_rotvec(np.radians(random.normal(0, 0.2, (25, 3))))).as_matrix(),
            ahead + random.normal(0, 1e-3, (25, 3)),
        )
        found = calibrate_hand_eye((A.as_matrix(), position), seen)
        assert found.far_sight is None
        off = np.linalg.norm(found.X[:3, 3] - X[1])
        assert off < 3 * np.sqrt(np.trace(found.covariance[:3, :3])) < 0.01
