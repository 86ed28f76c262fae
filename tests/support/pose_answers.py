"""What the commands on poses answer."""

from __future__ import annotations

from typing import Any

import numpy as np

XYZ = ("x", "y", "z")


def within(found: Any, true: Any, std: Any) -> None:
    """Estimates within five standard deviations of the truth, and these of a sensible size."""
    found, true, std = np.asarray(found), np.asarray(true), np.asarray(std)
    assert (std > 0).all()
    assert (np.abs(found - true) < 5 * std).all()
