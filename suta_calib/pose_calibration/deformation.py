"""What no rigid transform makes up for: points that are larger, or longer along one axis, or skew.

A distance between slices that is not what a file says stretches all points along one axis, a gantry
that was tilted makes two of them other than square, and an instrument whose axes count differently
does either. Every rigid transform then leaves residuals that grow with the distance from the
middle; they do not look like outliers, and the turn and the shift follow them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.pose_calibration.consensus import DIMENSION
from suta_calib.units import text

# Unknowns of a rigid transform with a scale, and of one with a stretch along every axis as well.
UNKNOWNS: Final = 7
# Singular value of centred points, relative to the first, across a plane or a line.
FLAT: Final = 1e-6
# Stretches, in units of the points' own rounding, that are no more than it.
ROUNDING: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Strain:
    """How much farther apart points are in the second set than in the first, by direction.

    Attributes:
        stretch: (3,) factors along three directions at right angles, the greatest last.
        first: (3, 3) the directions in the first set's frame, one a column.
        second: (3, 3) the same in the second set's.
        chance: of residuals of points that are rigid, or all larger by one factor, to be explained
            so much better by stretches.
        displaced: RMS of what the stretches, beyond their mean, displace the points by, m.
        rms: what is left of the residuals with them, root mean square, 3-D, m.
    """

    stretch: FloatArray
    first: FloatArray
    second: FloatArray
    chance: float
    displaced: float
    rms: float

    @property
    def size(self) -> float:
        """By how much the greatest and the least of the factors differ."""
        return float(self.stretch[-1] - self.stretch[0])

    @property
    def note(self) -> str:
        """What a reader is told of it: an axis that is wrong is mostly one of its own frame's."""
        frames = (("first", self.first), ("second", self.second))
        # The other two of a frame with one wrong scale are alike, and might lie anywhere.
        odd = 2 if self.stretch[2] - self.stretch[1] > self.stretch[1] - self.stretch[0] else 0
        which, axes = max(frames, key=lambda frame: float(np.abs(frame[1][:, odd]).max()))

        def along(k: int) -> str:
            # The larger coordinate of a direction is told as positive.
            axis = axes[:, k] * np.sign(axes[np.abs(axes[:, k]).argmax(), k])
            told = ", ".join(f"{value + 0.0:.2f}" for value in np.round(axis, 2))
            return f"{self.stretch[k]:.4f} times along ({told})"

        return (
            "The points are not equally larger or smaller in the second set along every "
            f"direction of the {which}: {along(2)} and {along(0)}. Look for an axis of another "
            "scale, as a wrong distance between slices makes it, or for axes that are not square. "
            "With these scales the rms would be "
            f"{text(self.rms, 'm', with_unit=True)}."
        )


def strain(
    placed: FloatArray, seen: FloatArray, weight: FloatArray, turn: FloatArray
) -> Strain | None:
    """How points were deformed, by weighted least squares; None where too few tell it.

    An affine transform against one with a single scale, by an F test: nothing but the stretches
    differs between the two.

    Args:
        placed: (n, 3) points of the first set, turned into the second set's axes, m.
        seen: (n, 3) the same in the second set, m.
        weight: (n,) what each row counts.
        turn: (3, 3) by which ``placed`` were turned.
    """
    x, y = (v - np.average(v, axis=0, weights=weight) for v in (placed, seen))
    root = np.sqrt(weight)[:, None]
    values, axes = np.linalg.svd(root * x, full_matrices=False)[1:]
    told = axes[values > FLAT * values[0]]
    unknowns = DIMENSION * (len(told) + 1)
    freedom, more = DIMENSION * len(x) - unknowns, unknowns - UNKNOWNS
    if freedom < 1 or more < 1:
        return None
    moved, scale = x @ told.T, common_scale(placed, seen, weight)[0]
    found = np.linalg.lstsq(root * moved, root * y, rcond=None)[0]
    # Across the points' plane or line nothing is told of a stretch: it is taken for the common one.
    affine = found.T @ told + scale * (np.eye(DIMENSION) - told.T @ told)
    left, scaled = y - moved @ found, y - scale * x
    squares, before = float(weight @ np.sum(left**2, axis=1)), weight @ np.sum(scaled**2, axis=1)
    u, stretch, vt = np.linalg.svd(affine)
    beyond = float(rms_length(scaled - left))
    if beyond <= ROUNDING * float(np.abs([placed, seen]).max()):
        return None
    ratio = (float(before) - squares) / more / max(squares / freedom, 1e-300)
    order = np.argsort(stretch)
    return Strain(
        stretch=stretch[order],
        first=turn.T @ vt.T[:, order],
        second=u[:, order],
        chance=float(fdtrc(more, freedom, ratio)),
        displaced=beyond,
        rms=float(rms_length(left)),
    )


def common_scale(
    placed: FloatArray, seen: FloatArray, weight: FloatArray
) -> tuple[float, float, float]:
    """How many times larger points (n, 3) are than they were placed, by weighted least squares.

    Returns:
        The scale, its standard deviation, and the root mean square that is left with it, m.
    """
    placed, seen = (v - np.average(v, axis=0, weights=weight) for v in (placed, seen))
    power = float(weight @ np.sum(placed**2, axis=1))
    scale = float(weight @ np.sum(placed * seen, axis=1)) / power
    left = np.sum((seen - scale * placed) ** 2, axis=1)
    std = np.sqrt(weight @ left / max(placed.size - UNKNOWNS, 1) / power)
    return scale, float(std), float(np.sqrt(left.mean()))
