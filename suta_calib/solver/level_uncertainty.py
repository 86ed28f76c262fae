"""What an estimate loses by levels that are estimated too: of noise, of priors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from suta_calib.arrays import FloatArray


class Estimate(Protocol):
    """The best step of the unknowns, and its covariance, at some levels."""

    @property
    def step(self) -> FloatArray:
        """(p,) from where one is."""

    @property
    def covariance(self) -> FloatArray:
        """(p, p) of the step."""


def covariance_of_levels(
    at: Callable[[FloatArray], Estimate], best: FloatArray, uncertainty: FloatArray
) -> FloatArray:
    """What the scatter of the levels adds to the covariance of the unknowns, (p, p).

    The mean over levels that are likely (Kass and Steffey 1989,
    doi:10.1080/01621459.1989.10478825), by points whose mean and covariance are theirs.

    Args:
        at: the estimate at some levels (k,).
        best: (k,) levels.
        uncertainty: (k, k) covariance of the levels.
    """
    here = at(best)
    values, vectors = np.linalg.eigh(uncertainty * len(best))
    added = np.zeros_like(here.covariance)
    for offset in (vectors * np.sqrt(np.maximum(values, 0.0))).T:
        for there in (at(best + offset), at(best - offset)):
            moved = there.step - here.step
            added += there.covariance - here.covariance + np.outer(moved, moved)
    values, vectors = np.linalg.eigh(added / (2 * len(best)))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
