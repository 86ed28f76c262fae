"""Errors that all rows of a sample share, such as the corners of a picture.

Where a hand is not quite where its joints say, as with play, all corners of a picture move
together: their errors have the covariance

    C = σ² (I + G Gᵀ)

with G the derivative of a picture's rows by these errors, in units of σ. With G = U S Vᵀ the rows

    W r = r - U (1 - (1 + S²)^(-½)) Uᵀ r,   W C Wᵀ = σ² I

are white (generalised least squares; Aitken 1936, doi:10.1017/S0370164600014346). What a picture
says apart from where the hand is, such as of the lens, then counts as exactly as corners are found.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.sparse import csr_array

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.measurements.fields import keyed, quantity

# Of the largest singular value, one that is rounding.
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class HandError:
    """How far a hand is from where its readings say, anew at every rest: the key ``hand_error``.

    Attributes:
        shift: standard deviation along each axis, m.
        turn: of the turn about each axis, rad.
    """

    shift: float = keyed(quantity("m", "positive"), "Along each axis, mm.", name="mm")
    turn: float = keyed(quantity("rad", "positive"), "About each axis, deg.", name="deg")


@dataclass(frozen=True, eq=False)
class SampleErrors:
    """The part of rows that is not white, and by how much it is to be shortened.

    Attributes:
        basis: (n·d, k) orthonormal columns U, each of one sample's rows.
        excess: (k,) 1 - (1 + S²)^(-½), the share of it that goes.
    """

    basis: Any
    excess: FloatArray

    @classmethod
    def of(cls, by_error: FloatArray, sample: IntArray) -> SampleErrors:
        """Of the derivatives (n, d, e) of rows by the errors, in units of both deviations.

        ``sample`` (n,) is which sample each row is of; rows of one sample follow one another.

        Raises:
            SamplesError: rows of a sample that do not follow one another.
        """
        n, size, _ = by_error.shape
        first = np.flatnonzero(np.diff(sample, prepend=-1))
        if len(first) != len(np.unique(sample)):
            raise SamplesError("rows of a sample here and there", "one after the other")
        rows, columns, values, excess = (list[Any]() for _ in range(4))
        count = 0
        for begin, end in zip(first, [*first[1:], n], strict=True):
            vectors, sizes, _ = np.linalg.svd(
                by_error[begin:end].reshape((end - begin) * size, -1), full_matrices=False
            )
            kept = sizes > _ROUNDING * max(float(sizes[0]), 1e-300)
            vectors = vectors[:, kept]
            at = np.arange(size * begin, size * end)
            places = np.arange(count, count + vectors.shape[1])
            rows.append(np.repeat(at, len(places)))
            columns.append(np.tile(places, len(at)))
            values.append(vectors.reshape(-1))
            excess.append(1.0 - 1.0 / np.sqrt(1.0 + sizes[kept] ** 2))
            count += len(places)
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        return cls(csr_array(entries, shape=(n * size, count)), np.concatenate(excess))

    def whitened(self, rows: FloatArray) -> FloatArray:
        """Rows (n, d, …), residuals or their derivatives, as W has them."""
        flat = rows.reshape(self.basis.shape[0], -1)
        taken = self.basis @ (self.excess[:, None] * (self.basis.T @ flat))
        return np.asarray(flat - taken).reshape(rows.shape)
