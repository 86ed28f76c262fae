"""Whose noise turns the residuals of a hand-eye calibration: the hand's or the eye's."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.geometry import FloatArray

# Before the data are asked: anything from none to all.
EXPECTED: Final = 0.5
SPREAD: Final = 0.29
UNKNOWNS: Final = 12


def estimate_hand_share(position: FloatArray, swept: FloatArray) -> float:
    """Part of the rotational noise, as a variance, that is the hand's; between 0 and 1.

    A turn of the hand moves the target by turn x lever, seen from the eye; a turn of what the eye
    sees does not. The regression of one on the other is the share, shrunk towards one half where
    few poses tell little.

    Args:
        position: (n, 3) residuals of the target's position in the eye.
        swept: (n, 3) turn in each residual times the lever from hand to target, the same unit.
    """
    told, against = float(np.sum(swept**2)), float(np.sum(swept * position))
    if told == 0.0:
        return EXPECTED
    share = against / told
    numbers = position.size
    freedom = max(numbers - UNKNOWNS / 2, 1.0)
    noise = float(np.sum((position - share * swept) ** 2)) / freedom
    prior = noise / SPREAD**2
    return float(np.clip((against + EXPECTED * prior) / (told + prior), 0.0, 1.0))
