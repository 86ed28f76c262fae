"""The residual of one kind of row and its derivatives, compiled once and evaluated on all rows.

The derivative of a residual with respect to the unknown geometry is the product of two parts: how
it changes when a tool pose moves (here, from the author's residual), and how the tool pose moves
with each parameter (the forward kinematics). Only the first depends on the kind of term.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from suta_calib.batched import Batched
from suta_calib.geometry import FloatArray
from suta_calib.terms.term import Block, IntArray, Pose, Residual


class Kernel:
    """All rows of one block.

    Attributes:
        pose_columns: (n, c) column of the stacked pose velocities (6 per sample: linear, angular)
            that each stored entry of the pose derivative belongs to.
    """

    def __init__(self, block: Block, first_sample: int) -> None:
        n, self._poses = block.samples.shape
        function, columns = _compiled(
            block.residual, self._poses, block.own.shape[1], block.data.shape[1], block.size
        )
        self._samples = block.samples + first_sample
        self._batch = Batched(function, n)
        self._batch.inputs[-1][:] = block.data
        self._shape = (n, block.size, len(columns))
        which, component = np.divmod(columns, 6)
        self.pose_columns: IntArray = 6 * self._samples[:, which] + component

    def __call__(
        self, rotation: FloatArray, position: FloatArray, own: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residuals and derivatives of all rows.

        Args:
            rotation: (samples, 9) column by column.
            position: (samples, 3), m.
            own: (n, m) the own parameters that each row looks at.

        Returns:
            Residuals (n, d), derivative by the entries of `pose_columns` (n, d, c), and by the
            own parameters (n, d, m). Views of arrays that the next call overwrites.
        """
        n, size, width = self._shape
        for k in range(self._poses):
            np.take(rotation, self._samples[:, k], axis=0, out=self._batch.inputs[2 * k])
            np.take(position, self._samples[:, k], axis=0, out=self._batch.inputs[2 * k + 1])
        self._batch.inputs[-2][:] = own
        residual, by_pose, by_own = self._batch()
        return residual, by_pose.reshape(n, size, width), by_own.reshape(n, size, own.shape[1])


@lru_cache(maxsize=64)
def _compiled(
    residual: Residual, poses: int, own: int, data: int, size: int
) -> tuple[Any, IntArray]:
    """CasADi function (R₁, p₁, …, own, data) → residual, pose derivative, own derivative.

    Derivatives are transposed, so that CasADi's column order is row order per residual component.
    """
    rotations = [ca.SX.sym(f"R{k}", 3, 3) for k in range(poses)]
    positions = [ca.SX.sym(f"p{k}", 3) for k in range(poses)]
    own_symbol, data_symbol = ca.SX.sym("own", own), ca.SX.sym("data", data)
    velocity = ca.SX.sym("velocity", 6 * poses)
    moved = [
        Pose(R + ca.skew(velocity[6 * k + 3 : 6 * k + 6]) @ R, p + velocity[6 * k : 6 * k + 3])
        for k, (R, p) in enumerate(zip(rotations, positions, strict=True))
    ]
    value = residual(moved, own_symbol, data_symbol)
    at_rest = [
        ca.substitute(e, velocity, ca.SX.zeros(6 * poses, 1))
        for e in (value, ca.jacobian(value, velocity), ca.jacobian(value, own_symbol))
    ]
    columns = _nonzero_columns(at_rest[1])
    inputs = [s for pair in zip(rotations, positions, strict=True) for s in pair]
    outputs = [at_rest[0], at_rest[1][:, columns.tolist()].T, at_rest[2].T]
    function = ca.Function(
        residual.__name__.strip("_") or "residual",
        [*inputs, own_symbol, data_symbol],
        [ca.densify(o) for o in outputs],
        {"cse": True},
    )
    if value.shape != (size, 1):
        raise ValueError(f"{residual} gives {value.shape} numbers; its block says {size}")
    return function, columns


def _nonzero_columns(jacobian: Any) -> IntArray:
    pattern = jacobian.sparsity()
    counts = np.diff(np.array(pattern.colind()))
    return np.flatnonzero(counts).astype(np.intp)
