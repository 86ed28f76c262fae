"""What an artefact contributes to residuals, and with which uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.measurements import Artefact
from suta_calib.terms.term import grouped


@dataclass(frozen=True, eq=False)
class Certified:
    """Coordinates that somebody else measured once and that every touch of a landmark shares.

    Attributes:
        keys: what identifies a landmark, also in another term over the same artefact.
        sigma: (marks,) standard deviation of each coordinate, m.
        marks: (n, k) which landmarks each row looks at.
        derivative: (n, d, k, 3) of the residual by their coordinates in the artefact.
    """

    keys: tuple[tuple[Any, ...], ...]
    sigma: FloatArray
    marks: IntArray
    derivative: FloatArray


def certified_rows(artefact: Artefact, touched: NDArray[Any], derivative: FloatArray) -> Certified:
    """The artefact's part in a block.

    Args:
        artefact: certified landmarks.
        touched: (n, k) names of the landmarks each row looks at.
        derivative: (n, d, k, 3) of the residual by their coordinates.
    """
    names, marks = grouped(touched.reshape(-1))
    found = [artefact.landmark(name) for name in names]
    keys = tuple((artefact.name, mark.name, *mark.position.tolist()) for mark in found)
    sigma = np.array([mark.sigma for mark in found])
    return Certified(keys, sigma, marks.reshape(touched.shape), derivative)
