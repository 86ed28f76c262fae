"""Standard deviations that instruments state: a check of them, and weights from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol
from suta_calib.terms.block import Block, Pose, flat, pose_of
from suta_calib.terms.tracked_point import TrackedPoint


@dataclass(frozen=True, eq=False)
class StatedSpread:
    """Standard deviations of corresponding points, each along the axes of its own frame.

    The residual ``R a + p - b`` of a row has the covariance ``R diag(σa²) Rᵀ + diag(σb²)``.

    Attributes:
        of_source: (n, 3) of a, m; zeros where they are taken for exact.
        of_target: (n, 3) of b, m; likewise.
    """

    of_source: FloatArray
    of_target: FloatArray

    @classmethod
    def of(cls, source: FloatArray | None, target: FloatArray | None) -> StatedSpread | None:
        """What is stated of the points (n, 3) of either frame; None where nothing is."""
        stated = source if source is not None else target
        if stated is None:
            return None
        exact = np.zeros_like(stated)
        return cls(exact if source is None else source, exact if target is None else target)

    @cached_property
    def per_point(self) -> FloatArray:
        """(n,) root mean square standard deviation of one component of each row's residual, m."""
        return np.asarray(np.sqrt(np.mean(self.of_source**2 + self.of_target**2, axis=1)))

    @cached_property
    def typical(self) -> float:
        """The geometric mean of them, m: in units of it rows weigh."""
        return float(np.exp(np.mean(np.log(self.per_point))))

    def take(self, rows: ArrayLike) -> StatedSpread:
        """Of some of the points."""
        return StatedSpread(self.of_source[np.asarray(rows)], self.of_target[np.asarray(rows)])

    def whitening(self, rotation: FloatArray) -> FloatArray:
        """(n, 3, 3) what makes residuals scatter by `typical`, by the turn from a to b."""
        turned = rotation * self.of_source[:, None, :]
        covariance = turned @ np.swapaxes(turned, 1, 2)
        covariance[:, range(3), range(3)] += self.of_target**2
        values, axes = np.linalg.eigh(covariance)
        scaled = self.typical * axes / np.sqrt(values)[:, None, :]
        return np.asarray(scaled @ np.swapaxes(axes, 1, 2))


@dataclass(frozen=True)
class Agreement:
    """Residuals beside the standard deviations that were stated of them.

    Attributes:
        factor: how many times larger they are, but for what the unknowns took up.
        chance: of a factor as far from one, in either direction, where what is stated is true.
    """

    factor: float
    chance: float

    @classmethod
    def of(cls, squared: float, freedom: float) -> Agreement:
        """From squared residuals in units of what is stated, summed, and their freedom (χ²)."""
        larger = float(chdtrc(freedom, squared))
        chance = min(1.0, 2.0 * min(larger, 1.0 - larger))
        return cls(float(np.sqrt(squared / freedom)), chance)

    @property
    def contradicted(self) -> bool:
        """Whether the residuals contradict the stated standard deviations."""
        return self.chance < 0.01

    @property
    def too_large(self) -> bool:
        """Whether the residuals are larger than what was stated allows."""
        return self.contradicted and self.factor > 1.0

    @property
    def note(self) -> str:
        """A note if residuals and stated standard deviations contradict each other."""
        # The least that a chance is shown as.
        least = 1e-6
        because = (
            "points moved, or the σ do not include every error; ± follows the residuals"
            if self.too_large
            else "the σ are too large, or include errors that all points share; ± follows the σ"
        )
        chance = f"{max(self.chance, least):.0e}{' or less' if self.chance < least else ''}"
        return (
            f"The residuals are {self.factor:.2g} times as large as the stated σ predict "
            f"(probability {chance} by chance): {because}."
        )


def _whitened(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    base = pose_of(unknowns)
    return ca.reshape(data[3:], 3, 3) @ (base.R @ poses[0].p + base.p - data[:3])


@dataclass(frozen=True, eq=False, kw_only=True)
class WeighedPoint(TrackedPoint):
    """`TrackedPoint` of which every row has a covariance of its own.

    Attributes:
        whitening: (n, 3, 3) that makes residuals scatter alike in every row and direction.
    """

    whitening: FloatArray

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Positions, weighed."""
        (block,) = super().blocks
        data = np.hstack([block.data, flat(self.whitening)])
        return (replace(block, residual=_whitened, data=data),)

    def take(self, rows: ArrayLike) -> Self:
        """The term over some of its samples."""
        whitening = self.whitening[np.asarray(rows)]
        return replace(self, poses=self.poses.take(rows), whitening=whitening)
