"""What held-out errors say of the standard deviations, and how much wider these must be.

What a model lacks is in the residuals of the fitted rows only as far as these show it. Rows that
were held out, of other postures or another day, err by more: then the covariance of the estimates
is too small to predict them. It is multiplied by one factor, squared, such that the held-out errors
are as large as it predicts, noise taken off (an overdispersion factor; McCullagh and Nelder,
Generalized Linear Models, section 4.5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from suta_calib.diagnostics.held_out import HeldOutErrors, normal_squared

# Widest factor: where it would be larger, the errors are of the held-out rows and not of the
# estimates.
MOST: Final = 5.0


def widening(held_out: Sequence[HeldOutErrors]) -> float:
    """Factor on the standard deviations of an answer that makes them predict held-out errors.

    Args:
        held_out: of a converged answer, with its own standard deviations.

    Returns:
        1 where nothing was held out, where the errors are as predicted, or where wider standard
        deviations do not explain them.
    """
    factor = max((_factor(errors) for errors in held_out), default=1.0)
    return factor if factor <= MOST else 1.0


def _factor(errors: HeldOutErrors) -> float:
    """By which the parameters' standard deviations must be wider; 1 where they need not be."""
    # Times what is predicted from which on a model that lacks something is no explanation.
    unexplained = 3.0
    excess = math.log(max(errors.ratio, 1e-9))
    # Standard errors that held-out errors must be above what is predicted: as for a contradiction.
    if excess < 4.0 * errors.ratio_std or errors.ratio > unexplained:
        return 1.0
    # What fitting the instrument or artefact to the held-out rows removes is no error of the arm.
    if errors.placed_anew < errors.level / unexplained:
        return 1.0
    squared = np.einsum("nd,nd->n", errors.residual, errors.residual)
    by_parameters = errors.by_parameters**2
    by_noise = np.maximum(errors.predicted**2 - by_parameters, 0.0)
    expected = normal_squared(errors.residual.shape[1])

    def median(factor: float) -> float:
        return float(np.median(squared / (by_noise + factor**2 * by_parameters)))

    low, high = 1.0, MOST
    if median(high) > expected:
        return math.inf
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if median(middle) > expected else (low, middle)
    return high
