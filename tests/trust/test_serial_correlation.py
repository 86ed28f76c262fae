"""Errors that neighbours share: a stream is no better known for being sampled faster."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from spread import is_as_predicted

from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.pose_calibration.pivot import calibrate_pivot
from suta_calib.trust.serial_correlation import blocks, correlation_length

TIP = np.array([0.02, 0.03, 0.15])


def coloured(rng: np.random.Generator, n: int, rho: float) -> np.ndarray:
    """(n, 3) first-order autoregressive noise of unit variance."""
    white = rng.standard_normal((n + 500, 3))
    return np.asarray(lfilter([np.sqrt(1 - rho**2)], [1.0, -rho], white, axis=0)[500:])


@pytest.mark.parametrize("rho", [0.5, 0.9])
def test_the_correlation_length_of_a_known_process(rho: float) -> None:
    found = [correlation_length(coloured(np.random.default_rng(k), 3000, rho)) for k in range(10)]
    assert np.mean(found) == pytest.approx((1 + rho) / (1 - rho), rel=0.15)


def test_white_rows_are_clusters_of_their_own() -> None:
    alone = 0
    for seed in range(50):
        rows = np.random.default_rng(seed).standard_normal((100, 3))
        alone += np.array_equal(blocks(rows), np.arange(100))
    assert alone >= 48


def test_exact_rows_have_no_length() -> None:
    assert correlation_length(np.zeros((50, 3))) == 1.0


def test_there_are_always_enough_blocks_to_tell_a_variance() -> None:
    assert blocks(np.cumsum(np.ones((60, 3)), axis=0)).max() + 1 >= 12


@pytest.mark.parametrize("rho", [0.0, 0.95])
def test_a_stream_s_tip_scatters_as_predicted(rho: float) -> None:
    """At 0.95 a standard deviation that takes rows as independent is six times too small."""
    n, trials = 400, 15
    t = np.linspace(0.0, 12 * np.pi, n)
    turns = np.stack([0.5 * np.cos(t), 0.5 * np.sin(1.37 * t), 0.3 * np.sin(0.3 * t)], axis=1)
    R = rotation_from_vector(turns)
    tips, variances = [], []
    for seed in range(trials):
        p = -R @ TIP + 0.5e-3 * coloured(np.random.default_rng(seed), n, rho)
        found = calibrate_pivot(R, p)
        tips.append(found.tip)
        variances.append(found.tip_std**2)
    ratio = np.sqrt(np.mean(np.var(tips, axis=0, ddof=1)) / np.mean(variances))
    assert is_as_predicted(float(ratio), 3 * (trials - 1))
