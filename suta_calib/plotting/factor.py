"""Factors by which pictures enlarge what is small."""

from __future__ import annotations

import numpy as np


def round_down(value: float) -> float:
    """1, 2 or 5 times a power of ten, no larger than ``value``: a factor that can be told.

    Args:
        value: positive.
    """
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in (1, 2, 5) if step * decade <= value * (1 + 1e-9)))
