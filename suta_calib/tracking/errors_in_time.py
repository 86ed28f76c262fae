"""Errors of a record in order of time, what an honest one may err by, and faults beside that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray

Kind = Literal["stuck", "wild", "jump", "step", "rate"]
# Rows and bins without which nothing is told, and a size, m, that is next to nothing.
LEAST: Final = 60
NOTHING: Final = 1e-5
# Of the largest singular value, below which two causes are one.
SAME: Final = 3e-4


@dataclass(frozen=True, eq=False)
class ErrorsInTime:
    """Errors over time, and what they may depend on; along the reference's axes.

    Attributes:
        time: (n,) s.
        error: (n, 3) recorded minus reference, latency taken out, m.
        recorded, reference: (n, 3) where they are, m.
        velocity: (n, 3) of the reference, m/s.
        transform: (n, 3, 6) derivatives by the transform, if one was estimated; else (n, 3, 0).
        known_shapes: (n, 3, k) those by the sizes of known errors that were estimated too.
        honest: (n, 3, j) what else an honest record may err by.
        interval: s between rows of the reference.
        late: positions and velocities (n, 3) of the reference so much earlier, by seconds (n,).
    """

    time: FloatArray
    error: FloatArray
    recorded: FloatArray
    reference: FloatArray
    velocity: FloatArray
    transform: FloatArray
    known_shapes: FloatArray
    honest: FloatArray
    interval: float
    late: Callable[[FloatArray], tuple[FloatArray, FloatArray]]

    @cached_property
    def estimated(self) -> FloatArray:
        """(n, 3, …) all that the alignment has estimated, lateness first."""
        return np.concatenate(
            [-self.velocity[:, :, None], self.transform, self.known_shapes], axis=2
        )

    @cached_property
    def columns(self) -> FloatArray:
        """(n, 3, …) all that is no fault, lateness first."""
        place = self.recorded - self.recorded.mean(axis=0)
        shapes = np.column_stack([np.ones(len(place)), place / max(np.abs(place).max(), 1e-12)])
        # Errors of an arm's geometry have those that grow with the place among them.
        offsets = per_axis(shapes[:, :1] if self.known_shapes.shape[2] else shapes)
        return np.concatenate([self.estimated, offsets, self.honest], axis=2)


def per_axis(shapes: FloatArray) -> FloatArray:
    """(n, 3, 3 k) columns of shapes (n, k) that move each axis by itself."""
    n, k = shapes.shape
    return np.asarray(np.einsum("nk,ij->nikj", shapes, np.eye(3)).reshape(n, 3, 3 * k))


@dataclass(frozen=True, eq=False)
class FaultEstimate:
    """A fault as it is in the rows.

    Attributes:
        kind: what it is.
        size, std: m by which the reference moves on or rows are off; of a rate a number, of a step
            s; NaN where no std is told.
        shape: (n, 3) m, what it adds to the error; NaN in rows that tell nothing.
        count: of stretches or rows.
        first, last: row where it begins, and ends; of wild rows the worst, of stretches the
            longest.
        lateness: s, by how much all of the recording comes later beside it; in ``shape`` too.
    """

    kind: Kind
    size: float
    std: float
    shape: FloatArray
    count: int
    first: int
    last: int
    lateness: float = 0.0


def fitted(columns: FloatArray, error: FloatArray, used: BoolArray | None = None) -> FloatArray:
    """Coefficients (k,) of columns (n, 3, k) by least squares, of some rows."""
    if used is not None:
        columns, error = columns[used], error[used]
    flat = columns.reshape(-1, columns.shape[2])
    scale = np.maximum(np.sqrt(np.mean(flat**2, axis=0)), 1e-300)
    flat = flat / scale
    matrix = flat.T @ flat
    inverse = np.linalg.pinv(matrix, SAME**2, hermitian=True)
    return np.asarray(inverse @ (flat.T @ error.ravel()) / scale)
