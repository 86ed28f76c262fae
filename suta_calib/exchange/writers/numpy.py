"""NumPy's ``.npz``: values, covariance and poses as arrays."""

from __future__ import annotations

import io
from typing import Any, ClassVar

import numpy as np

from suta_calib.exchange.option import Given
from suta_calib.exchange.record import record
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer


class NumpyWriter(Writer):
    """All of `record`, read back by ``numpy.load`` without pickles."""

    name: ClassVar[str] = "numpy"
    summary: ClassVar[str] = ".npz with values, covariance, origins and poses, m and rad"
    example: ClassVar[str] = "results --format numpy --out arm.npz"
    file: ClassVar[str] = "exported.npz"
    holds_covariance: ClassVar[bool] = True
    holds_everything: ClassVar[bool] = True

    def content(self, result: Result, given: Given) -> bytes:
        """The archive."""
        del given
        stream = io.BytesIO()
        arrays: dict[str, Any] = {key: np.asarray(value) for key, value in record(result).items()}
        np.savez(stream, **arrays)
        return stream.getvalue()
