"""Huber's loss on the squared norm of a whitened residual, symbolically and numerically.

    ρ(s) = s                      for s ≤ δ²
    ρ(s) = 2 δ √s - δ²            beyond

written without branches, because the derivative of a branch around √s is NaN at zero. δ = ∞ is
least squares. Huber (1964), doi:10.1214/aoms/1177703732.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.special import chdtrc, chdtri

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol


def huber_threshold(size: int) -> float:
    """Threshold on the norm of ``size`` unit normal components at Huber's quantile in one."""
    # 95 % efficiency for Gaussian noise in one dimension (Huber); the same quantile in more.
    return float(np.sqrt(chdtri(size, chdtrc(1, 1.345**2))))


def symbolic_huber(squared: Symbol, threshold: Symbol) -> Symbol:
    """ρ(s) in CasADi symbols, for a finite threshold."""
    inside = ca.fmin(squared, threshold**2)
    return inside + 2 * threshold * (ca.sqrt(ca.fmax(squared, threshold**2)) - threshold)


def huber(squared: FloatArray, threshold: FloatArray) -> FloatArray:
    """ρ(s) for arrays of s and of thresholds (inf allowed)."""
    excess = np.sqrt(squared) - threshold
    with np.errstate(invalid="ignore"):
        linear = threshold**2 + 2 * threshold * excess
    return np.where(excess > 0, linear, squared)


def huber_weight(squared: FloatArray, threshold: FloatArray) -> FloatArray:
    """ρ'(s): one inside the threshold, δ/√s beyond."""
    return np.minimum(1.0, threshold / np.sqrt(np.maximum(squared, 1e-300)))


def radial(residual: FloatArray, derivative: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Which way residuals (n, d) above zero point, (n, d), and how they lengthen, (n, p)."""
    if residual.shape[1] == 1:
        unit = np.sign(residual)
        return unit, unit * derivative[:, 0]
    unit = residual / np.linalg.norm(residual, axis=1, keepdims=True)
    return unit, np.einsum("nd,ndp->np", unit, derivative)


def kept_curvature(share: float) -> float:
    """Curvature kept along the residual of rows in the linear part, which are ``share`` of all.

    None would be Newton's method on Huber's loss, which overshoots while most rows are outliers;
    all of it would be iteratively reweighted least squares, which creeps once few are.
    """
    return max(0.05, float(np.sqrt(share)))
