"""Clouds of balls before a wall, as a depth camera sees them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

RADIUS = 0.03
CENTRE = np.array([0.05, -0.04, 0.6])


def cloud(
    *balls: tuple[np.ndarray, float], seed: int = 0, noise: float = 1e-3, behind: float = 1.0
) -> np.ndarray:
    """(h, w, 3) organised points of balls before a tilted wall, by a camera with noise z²."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.linspace(-0.3, 0.3, 160), np.linspace(-0.25, 0.25, 130))
    ray = np.stack([u, v, np.ones(u.shape)], axis=-1)
    z = behind + 0.1 * u
    for centre, radius in balls:
        a, b = np.sum(ray**2, axis=2), ray @ centre
        inside = b**2 - a * (centre @ centre - radius**2)
        z = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0.0))) / a, z)
    z = z + noise * z**2 * rng.standard_normal(z.shape)
    return np.asarray(ray * z[..., None])


def write_pcd(path: Path, points: np.ndarray) -> None:
    """A cloud (n, 3) in text."""
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\nDATA ascii\n"
    )
    path.write_text(header + "".join(f"{x:.5f} {y:.5f} {z:.5f}\n" for x, y, z in points))
