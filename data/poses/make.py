"""Make the simulated example files of this folder again: ``python data/poses/make.py``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.measurements import write_text

FOLDER = Path(__file__).resolve().parent
TIP = np.array([-0.0143, 0.0021, 0.1587])
POSTS = {"P1": np.array([0.11, -0.06, -1.42]), "P2": np.array([0.02, 0.09, -1.47])}
X = Rotation.from_euler("xyz", [4.0, -3.0, 91.0], degrees=True), np.array([0.031, -0.062, 0.094])
Z = Rotation.from_euler("xyz", [0.5, 0.8, -30.0], degrees=True), np.array([0.62, 0.08, 0.015])
B_A = Rotation.from_euler("xyz", [12.0, -35.0, 140.0], degrees=True), np.array([0.25, -0.4, 1.1])
POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")


def main() -> None:
    """Write all files."""
    write("pivot", POSE_COLUMNS, *pivot(np.random.default_rng(1), ["P1"] * 60, [7, 23, 41]))
    labels = ["P1"] * 40 + ["P2"] * 40
    random = np.random.default_rng(2)
    poses = pivot(random, labels, [5, 52])
    write("pivot_two_posts", (*POSE_COLUMNS, "point"), *poses, np.array(labels)[:, None])
    columns = [f"{prefix}_{name}" for prefix in "ab" for name in POSE_COLUMNS]
    write("hand_eye", columns, *hand_eye(np.random.default_rng(3), 30, [4, 17]))
    a, b = register(np.random.default_rng(4), 12, [8])
    write("register_a", POSE_COLUMNS[:3], a)
    write("register_b", POSE_COLUMNS[:3], b)


def pivot(
    random: np.random.Generator, labels: list[str], outliers: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Poses of a tool within 45° of upright, its tip on a post; it slipped in the outliers."""
    n = len(labels)
    R = tilted(random, n, 45.0)
    post = np.array([POSTS[label] for label in labels])
    post[outliers] += random.uniform(4e-3, 12e-3, (len(outliers), 3))
    measured = R * noise(random, n, 0.05)
    return post - R.apply(TIP) + 0.15e-3 * random.standard_normal((n, 3)), measured.as_quat()


def hand_eye(
    random: np.random.Generator, n: int, outliers: list[int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A camera on a hand looks at a target on the table; the outliers are misread targets."""
    R_hand = tilted(random, n, 35.0, down=True)
    p_hand = np.array([0.6, 0.0, 0.5]) + random.uniform(-0.15, 0.15, (n, 3))
    R_eye, p_eye = R_hand * X[0], R_hand.apply(X[1]) + p_hand
    R_seen = R_eye.inv() * Z[0] * noise(random, n, 0.05)
    p_seen = R_eye.inv().apply(Z[1] - p_eye) + 0.3e-3 * random.standard_normal((n, 3))
    p_seen[outliers] += random.uniform(10e-3, 30e-3, (len(outliers), 3))
    return p_hand, R_hand.as_quat(), p_seen, R_seen.as_quat()


def register(
    random: np.random.Generator, n: int, outliers: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Points of a plan, and the same points touched; a wrong one was touched in the outliers."""
    a = random.uniform([-0.09, -0.06, -0.04], [0.09, 0.06, 0.04], (n, 3))
    b = B_A[0].apply(a) + B_A[1] + 0.2e-3 * random.standard_normal((n, 3))
    b[outliers] += random.uniform(5e-3, 9e-3, (len(outliers), 3))
    return a, b


def tilted(random: np.random.Generator, n: int, limit: float, *, down: bool = False) -> Rotation:
    """Turns by up to ``limit`` degrees about horizontal axes, after any turn about z."""
    heading, tilt = random.uniform(0, 2 * np.pi, n), np.radians(limit) * np.sqrt(random.random(n))
    axes = np.stack([np.cos(heading), np.sin(heading), np.zeros(n)], axis=1)
    upright = Rotation.from_euler("x", 180.0 if down else 0.0, degrees=True)
    about_z = Rotation.from_euler("z", random.uniform(-60.0, 60.0, (n, 1)), degrees=True)
    return Rotation.from_rotvec(axes * tilt[:, None]) * about_z * upright


def noise(random: np.random.Generator, n: int, sigma: float) -> Rotation:
    """Small turns of ``sigma`` degrees about every axis."""
    return Rotation.from_rotvec(np.radians(sigma) * random.standard_normal((n, 3)))


def write(name: str, columns: object, *parts: np.ndarray) -> None:
    """Columns of numbers with seven decimals, of words as they are."""
    texts = [np.char.mod("%.7f", p) if p.dtype.kind == "f" else p for p in parts]
    rows = [",".join(row) for row in np.hstack(texts)]
    write_text(FOLDER / f"{name}.csv", "\n".join([",".join(columns), *rows]) + "\n")


if __name__ == "__main__":
    main()
