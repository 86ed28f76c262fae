"""Points of which every one has a covariance of its own, as a term."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol
from suta_calib.terms.block import Block, Pose, flat, pose_of
from suta_calib.terms.tracked_point import TrackedPoint


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
        return replace(
            self, poses=self.poses.take(rows), whitening=self.whitening[np.asarray(rows)]
        )
