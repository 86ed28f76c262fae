"""Rows that err alike: what an estimate's covariance grows by, and by which of its components."""

from __future__ import annotations

import numpy as np
import pytest
from hand_eye_scenes import simulate
from spread import is_as_predicted

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import extent, rotation_from_vector, vector_from_rotation
from suta_calib.pose_calibration.correlation import common_covariance, embedded
from suta_calib.pose_calibration.hand_eye import calibrate_hand_eye
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.synthetic import PoseNoise

ROWS = 60
# Standard deviations of what a hand's poses share, m and rad, beside what they scatter.
SHARED = (0.5e-3, float(np.radians(0.15)))
HAND = PoseNoise(0.1e-3, float(np.radians(0.02)))
EYE = PoseNoise(0.3e-3, float(np.radians(0.05)))


def alike(place: FloatArray, reach: float) -> FloatArray:
    """Factor (n, n) of the covariance of errors that change smoothly over places (n, k)."""
    apart = np.sqrt(3.0) * np.linalg.norm(place[:, None] - place[None], axis=2) / reach
    return np.linalg.cholesky((1.0 + apart) * np.exp(-apart) + 1e-9 * np.eye(len(place)))


def means(residual: FloatArray, place: FloatArray, sizes: list[int]) -> FloatArray:
    """What comes to the covariance of the mean of every column (n, d), over that of white rows."""
    n, d = residual.shape
    jacobian = np.tile(np.eye(d), (n, 1, 1))
    left = residual - residual.mean(axis=0)
    left /= left.std(axis=0)
    each = np.arange(n, dtype=np.intp)
    bread = np.eye(d) / n
    found = common_covariance(jacobian, left, np.ones(d), bread, [place], each, each, sizes)
    return np.diag(found) * n


def scene(seed: int) -> tuple[np.random.Generator, FloatArray]:
    """What is random, and places of rows."""
    random = np.random.default_rng(seed)
    return random, random.uniform(-1.0, 1.0, (ROWS, 2))


def test_white_rows_add_next_to_nothing() -> None:
    random, place = scene(1)
    added = means(random.standard_normal((ROWS, 6)), place, [3, 3])
    assert (added >= 0.0).all()
    assert added.max() < 0.5


def test_each_group_of_components_is_asked_for_itself() -> None:
    """Turns that are alike beside places that scatter: one answer for both is wrong for either."""
    random, place = scene(2)
    smooth = alike(place, 2.0) @ random.standard_normal((ROWS, 3))
    residual = np.hstack([random.standard_normal((ROWS, 3)), smooth])
    apart, together = means(residual, place, [3, 3]), means(residual, place, [6])
    assert apart[:3].max() < 0.5
    assert apart[3:].min() > 5.0
    assert together[:3].min() > apart[:3].max()


def test_unknowns_that_a_group_does_not_tell_change_nothing() -> None:
    """A displacement moves no turn: its column of the turns' rows is empty."""
    (random, place), each = scene(3), np.arange(ROWS, dtype=np.intp)
    residual = alike(place, 2.0) @ random.standard_normal((ROWS, 3))
    few = np.tile(np.eye(3), (ROWS, 1, 1))
    more = np.concatenate([few, np.zeros((ROWS, 3, 2))], axis=2)
    found = [
        common_covariance(each_jacobian, residual, np.ones(3), np.eye(k), [place], each, each, [3])
        for each_jacobian, k in ((few, 3), (more, 5))
    ]
    np.testing.assert_allclose(found[1][:3, :3], found[0], rtol=1e-9)
    assert not found[1][3:].any()


def test_what_is_alike_in_another_frame_is_found_there() -> None:
    """A base's error, seen by a tool that is turned anew in every row, scatters like noise."""
    (random, place), each = scene(4), np.arange(ROWS, dtype=np.intp)
    error = alike(place, 2.0) @ random.standard_normal((ROWS, 3))
    error = (error - error.mean(axis=0)) / error.std(axis=0)
    to_base = rotation_from_vector(2.0 * random.standard_normal((ROWS, 3)))
    jacobian = np.swapaxes(to_base, 1, 2)
    residual = np.einsum("nij,nj->ni", jacobian, error)
    weight, bread = np.ones(3), np.eye(3) / ROWS
    blind, found = (
        common_covariance(jacobian, residual, weight, bread, [place], each, each, [3], frames)
        for frames in ((), [to_base])
    )
    assert np.diag(blind).max() * ROWS < 1.0
    assert np.diag(found).min() * ROWS > 5.0


def test_no_unknowns_have_no_covariance() -> None:
    each, rows = np.arange(4, dtype=np.intp), np.ones((4, 3))
    nothing = np.zeros((0, 0))
    found = common_covariance(np.zeros((4, 3, 0)), rows, rows[0], nothing, [], each, each, [3])
    assert found.shape == (0, 0)


# ── Hands whose poses share their errors ─────────────────────────────────────────────────────
def sharing(poses: Poses, reach: float, seed: int) -> Poses:
    """Poses with errors that change smoothly from one to its neighbours."""
    R, p = poses
    space = embedded(R, (p - p.mean(axis=0)) / extent(p))
    error = alike(space, reach) @ np.random.default_rng(seed).standard_normal((len(p), 6))
    slide, turn = SHARED
    return R @ rotation_from_vector(turn * error[:, 3:]), p + slide * error[:, :3]


def over_prediction(reach: float, count: int, trials: int) -> tuple[float, float]:
    """Root mean square error of X's place and turn along each axis, in its standard deviations."""
    ratios = []
    for seed in range(trials):
        data = simulate(count, hand=HAND, eye=EYE, seed=seed)
        found = calibrate_hand_eye(sharing(data.poses, reach, 99 + seed), data.seen)
        R, p = data.true_pose("hand_eye")
        turn = vector_from_rotation(R.T @ found.X[:3, :3])
        ratios.append(np.concatenate([found.X[:3, 3] - p, turn]) / found.std["X"])
    places, turns = np.sqrt(np.mean(np.square(ratios).reshape(trials, 2, 3), axis=(0, 2)))
    return float(places), float(turns)


def test_turns_that_hand_poses_share_are_in_what_x_is_known_to() -> None:
    _, turns = over_prediction(1.0, 40, 8)
    assert is_as_predicted(turns, 3 * 8)


@pytest.mark.slow
@pytest.mark.parametrize("count", [15, 40])
def test_turns_that_hand_poses_share_are_in_what_x_is_known_to_closely(count: int) -> None:
    places, turns = over_prediction(1.0, count, 80)
    assert 0.8 < turns < 1.25
    assert 0.8 < places < 1.25
