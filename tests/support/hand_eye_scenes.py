"""Simulated pairs of poses of a hand and of what its eye sees."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector, vector_from_rotation
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration, calibrate_hand_eye
from suta_calib.terms import HandEye
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.synthetic import PoseNoise, Simulated

NOISE = PoseNoise(3e-4, float(np.radians(0.1)))
NATURES = ("wrong", "slipped", "swapped")
SKEW_AXIS = np.array([1.0, 2.0, -2.0]) / 3.0


def simulate(count: int, **more: Any) -> Simulated[HandEye]:
    return HandEye.simulate(count, **more)


def noisy(count: int, **more: Any) -> Simulated[HandEye]:
    """Noise of a good robot and of a good camera."""
    return simulate(count, hand=NOISE, eye=NOISE, **more)


def calibrate(data: Simulated[HandEye], **more: Any) -> HandEyeCalibration:
    """Of the same poses the same answer, found once for all tests that look at it."""
    (RA, pA), (RB, pB) = data.poses, data.seen
    flat = np.hstack([RA.reshape(-1, 9), pA, RB.reshape(-1, 9), pB])
    return _calibrated(flat.tobytes(), tuple(sorted(more.items())))


@lru_cache(maxsize=64)
def _calibrated(flat: bytes, more: tuple[tuple[str, Any], ...]) -> HandEyeCalibration:
    RA, pA, RB, pB = np.split(np.frombuffer(flat).reshape(-1, 24), [9, 12, 21], axis=1)
    hand, seen = (RA.reshape(-1, 3, 3), pA), (RB.reshape(-1, 3, 3), pB)
    return calibrate_hand_eye(hand, seen, **dict(more))


def bent_hand(data: Simulated[HandEye], seed: int) -> Poses:
    """The hand off by some 4 mm and 0.4°, alike where it is alike: a geometry that errs."""
    (R, p), random = data.poses, np.random.default_rng([seed, 7])
    where = np.hstack([p, vector_from_rotation(R)])
    shift, turn = (np.sin(2.0 * where @ random.standard_normal((6, 3))) for _ in range(2))
    return R @ rotation_from_vector(np.radians(0.4) * turn), p + 4e-3 * shift


def angle(first: FloatArray, second: FloatArray) -> float:
    """Angle between two rotations, rad."""
    return float(np.linalg.norm(vector_from_rotation(first.T @ second)))


def errors(found: HandEyeCalibration, data: Simulated[HandEye]) -> FloatArray:
    """Of X: angle (rad) and distance (m)."""
    R, p = data.true_pose("hand_eye")
    return np.array([angle(found.X[:3, :3], R), np.linalg.norm(found.X[:3, 3] - p)])


def rows_of(poses: Poses, rows: FloatArray) -> Poses:
    return poses[0][rows], poses[1][rows]


def assert_pose(matrix: FloatArray, pose: Poses, tolerance: float = 1e-8) -> None:
    np.testing.assert_allclose(matrix[:3, :3], pose[0], atol=tolerance)
    np.testing.assert_allclose(matrix[:3, 3], pose[1], atol=tolerance)
    np.testing.assert_array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0])


# ── Whose noise it is ────────────────────────────────────────────────────────────────────────
WHOSE: dict[str, tuple[Callable[..., Simulated[HandEye]], float, float]] = {
    "hand": (lambda n, **k: simulate(n, hand=NOISE, **k), 0.9, 1.0),
    "eye": (lambda n, **k: simulate(n, eye=NOISE, **k), 0.0, 0.1),
    "both": (noisy, 0.35, 0.65),
}


def slides(problem: SamplesError) -> FloatArray:
    """The directions (k, 3) along which the message says that an unknown may slide."""
    if "be anywhere" in str(problem):
        return np.eye(3)
    found = re.findall(r"slide along \(([^)]*)\)", str(problem))
    return np.array([[float(v) for v in numbers.split(",")] for numbers in found])
