"""Plain JSON: values, covariance and poses."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from suta_calib.exchange.option import Given
from suta_calib.exchange.record import record
from suta_calib.exchange.result import Result, json_bytes
from suta_calib.exchange.writer import Writer


class JsonWriter(Writer):
    """All of `record`, arrays as lists."""

    name: ClassVar[str] = "json"
    summary: ClassVar[str] = "JSON with values, covariance, origins and poses, m and rad"
    example: ClassVar[str] = "results --format json --out arm.json"
    file: ClassVar[str] = "exported.json"
    holds_covariance: ClassVar[bool] = True
    holds_everything: ClassVar[bool] = True

    def content(self, result: Result, given: Given) -> bytes:
        """The object."""
        del given
        return json_bytes(
            {key: np.asarray(value).tolist() for key, value in record(result).items()}
        )
