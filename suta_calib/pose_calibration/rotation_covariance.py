"""From the covariance of a rotation vector to that of a small turn."""

from __future__ import annotations

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import skew


def tangent_of_vector(vector: FloatArray) -> FloatArray:
    """Right Jacobian J of SO(3): ``exp(v + dv) = exp(v) exp(J dv)``.

    Args:
        vector: (3,) rotation vector, rad.

    Returns:
        (3, 3). Chirikjian (2012), Stochastic Models, Information Theory, and Lie Groups 2, eq.
        10.86.
    """
    angle = float(np.linalg.norm(vector))
    k = skew(vector)
    if angle < 1e-6:
        return np.asarray(np.eye(3) - k / 2)
    first = (1.0 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) - first * k + second * k @ k)
