"""Simulated scenes with known truth for the commands on poses, and their CSV files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
PAIR = tuple(f"{prefix}_{name}" for prefix in "ab" for name in POSE)
TIP = np.array([0.012, -0.034, 0.21])
POSTS = {"left": np.array([0.3, -0.2, -1.1]), "right": np.array([0.1, 0.25, -1.3])}
X = Rotation.from_rotvec([0.4, -1.1, 0.3]), np.array([0.05, 0.02, -0.11])
Z = Rotation.from_rotvec([-0.2, 0.3, 1.4]), np.array([0.7, -0.1, 0.05])
# Beside the robot the eye is far off, and the target on the hand.
X_AND_Z = {"eye-in-hand": (X, Z), "eye-to-hand": (Z, X)}
B_A = Rotation.from_rotvec([1.0, 0.5, -0.7]), np.array([0.2, 0.9, -0.4])
NOISE = 0.1e-3
TURN_NOISE = np.radians(0.03)


def write_csv(path: Path, columns: Sequence[str], numbers: np.ndarray, *extra: list[str]) -> Path:
    """A CSV file of numbers; ``extra`` are further cells of each row."""
    rows = [",".join(map(repr, row)) for row in np.asarray(numbers, dtype=float).tolist()]
    rows = [",".join((row, *cells)) for row, *cells in zip(rows, *extra, strict=True)]
    path.write_text("\n".join([",".join(columns), *rows]) + "\n", encoding="utf-8")
    return path


def turns(random: np.random.Generator, n: int, size: float = 0.6) -> Rotation:
    return Rotation.from_rotvec(random.uniform(-size, size, (n, 3)))


def pivot_numbers(labels: Sequence[str], seed: int = 0, noise: float = NOISE) -> np.ndarray:
    """(n, 7) poses ``T_tracker_tool`` whose tip is on the posts."""
    random = np.random.default_rng(seed)
    R = turns(random, len(labels))
    post = np.array([POSTS[label] for label in labels])
    position = post - R.apply(TIP) + noise * random.standard_normal((len(labels), 3))
    return np.hstack([position, R.as_quat()])


def pair_numbers(n: int, setup: str, seed: int = 0, noise: float = NOISE) -> np.ndarray:
    """(n, 14) pairs ``T_base_hand``, ``T_eye_target`` with X and Z of this set-up."""
    X, Z = X_AND_Z[setup]
    random = np.random.default_rng(seed)
    R, p = turns(random, n, 0.8), random.uniform(-0.3, 0.3, (n, 3))
    # A X B = Z, with A the hand's pose, or its inverse where the eye stands beside the robot.
    A, a = (R, p) if setup == "eye-in-hand" else (R.inv(), -R.inv().apply(p))
    loop, at = A * X[0], A.apply(X[1]) + a
    B, b = loop.inv() * Z[0], loop.inv().apply(Z[1] - at)
    b = b + noise * random.standard_normal((n, 3))
    B = B * Rotation.from_rotvec(TURN_NOISE * random.standard_normal((n, 3)))
    return np.hstack([p, R.as_quat(), b, B.as_quat()])


def point_numbers(n: int, seed: int = 0, noise: float = NOISE) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) points in frame a and the same in frame b."""
    random = np.random.default_rng(seed)
    a = random.uniform(-0.1, 0.1, (n, 3))
    return a, B_A[0].apply(a) + B_A[1] + noise * random.standard_normal((n, 3))


def matrix(pose: tuple[Rotation, np.ndarray]) -> np.ndarray:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = pose[0].as_matrix(), pose[1]
    return found


def angle_deg(found: np.ndarray, true: np.ndarray) -> float:
    """Angle between the rotations of two 4x4 poses."""
    return float(np.degrees(Rotation.from_matrix(found[:3, :3].T @ true[:3, :3]).magnitude()))
