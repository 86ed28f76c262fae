"""Clouds of planes, as a depth camera sees them: it looks along z, and errs along its rays."""

from __future__ import annotations

import numpy as np

NORMAL = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
DISTANCE = 0.55


def cloud(
    normal: np.ndarray = NORMAL,
    distance: float = DISTANCE,
    *,
    seed: int = 0,
    noise: float = 2e-3,
    smooth: int = 0,
    radius: float = np.inf,
    behind: float = np.inf,
    size: tuple[int, int] = (90, 120),
) -> np.ndarray:
    """(h, w, 3) organised points of a plane ``normal · p = distance``, NaN where there is none.

    Args:
        normal: unit vector, away from the camera.
        distance: m.
        seed: of the noise.
        noise: at 1 m, along z; it grows with the square of the distance.
        smooth: pixels to each side that err together.
        radius: of the plate about where the camera looks, m.
        behind: depth of a wall behind it, m.
        size: height and width, pixels.
    """
    rng, (height, width) = np.random.default_rng(seed), size
    v, u = np.meshgrid(
        np.linspace(-0.35, 0.35, height), np.linspace(-0.45, 0.45, width), indexing="ij"
    )
    ray = np.stack([u, v, np.ones(u.shape)], axis=-1)
    slope = ray @ normal
    z = np.where(slope > 0.05, distance / np.maximum(slope, 0.05), 1e3)
    off = np.linalg.norm(ray * z[..., None] - [0.0, 0.0, distance / normal[2]], axis=-1)
    z = np.where((z < 1e3) & (off < radius), z, behind)
    white = rng.standard_normal((height + 2 * smooth, width + 2 * smooth))
    wide = 2 * smooth + 1
    windows = np.lib.stride_tricks.sliding_window_view(white, (wide, wide))
    error = windows.sum(axis=(2, 3)) / wide
    there = np.isfinite(z)
    z = np.where(there, z, 0.0)
    seen = ray * (z + noise * z**2 * error)[..., None]
    return np.where(there[..., None], seen, np.nan)


def points_of(seen: np.ndarray) -> np.ndarray:
    """(n, 3) those that have a place."""
    rows = seen.reshape(-1, 3)
    return np.asarray(rows[np.isfinite(rows).all(axis=1)])
