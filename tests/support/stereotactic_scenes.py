"""Points of a body, spoilt or not."""

from __future__ import annotations

import numpy as np

TRIANGLE = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.07, 0], [0, 0, 0.05], [0.06, 0.05, 0.0]])


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Mean distance of points, mm."""
    return 1e3 * float(np.linalg.norm(np.asarray(a) - b, axis=-1).mean())


def spoilt(points: np.ndarray, count: int, size: float, seed: int = 0) -> np.ndarray:
    """The same with ``count`` points somewhere else, by up to ``size`` in every coordinate."""
    random, points = np.random.default_rng(seed), points.copy()
    flat = points.reshape(-1, 3)
    chosen = random.choice(len(flat), count, replace=False)
    flat[chosen] += size * random.uniform(0.5, 1, (count, 3)) * random.choice([-1, 1], (count, 3))
    return points
