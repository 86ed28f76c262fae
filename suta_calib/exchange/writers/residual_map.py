"""A residual map that ``suta-calib residual-map`` wrote beside a result: Python, and a table."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, Final

from suta_calib.analysis.residual_map.export import python_text, table_text
from suta_calib.errors import InputError
from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.tracking.uncertainty import read_json_object

MAP: Final = "residual_map.json"


class BesideWriter(Writer):
    """A correction that stands beside a calibration, so that nothing of this one is lost."""

    holds_covariance = True
    holds_everything = True
    notes = ("The file corrects what the calibration leaves. It does not contain the calibration.",)

    @abstractmethod
    def text(self, record: Mapping[str, Any]) -> str:
        """The file's text, of the correction's record."""

    def content(self, result: Result, _given: Given) -> bytes:
        """The text of the correction beside a result."""
        return self.text(_record(result, self.name)).encode()


class ResidualMapWriter(BesideWriter):
    """A module without any import of this package, which corrects readings or the tip."""

    name = "residual-map"
    summary = "Python function that corrects what the calibration leaves (see residual-map)"
    example = "results --format residual-map --out residual_map.py"
    file = "exported_residual_map.py"

    def text(self, record: Mapping[str, Any]) -> str:
        """The module's text."""
        return python_text(record)


class ResidualTableWriter(BesideWriter):
    """The same correction as rows of numbers."""

    name = "residual-table"
    summary = "CSV table of the correction that residual-map found"
    example = "results --format residual-table --out residual_map.csv"
    file = "exported_residual_map.csv"

    def text(self, record: Mapping[str, Any]) -> str:
        """The table's text."""
        return table_text(record)


def _record(result: Result, form: str) -> dict[str, Any]:
    """The correction beside a result, if it was made after this calibration.

    Raises:
        InputError: there is none, nothing was left, or it belongs to another calibration.
    """
    arm = result.need_arm(form)
    path = result.path.with_name(MAP)
    if not path.is_file():
        raise InputError(
            "no residual map",
            f"{MAP} beside {result.path.name}",
            file=path,
            hint="run suta-calib residual-map on the job first",
        )
    record = read_json_object(path).get("correction")
    if record is None:
        raise InputError(
            "a residual map without a correction: nothing was left to correct",
            "one with a correction",
            file=path,
        )
    if not isinstance(record, dict) or not isinstance(record.get("parameters"), dict):
        raise InputError("a correction that cannot be read", "as residual-map writes it", file=path)
    for name, value in record["parameters"].items():
        if not math.isclose(arm.values.get(name, 0.0), value, rel_tol=1e-6, abs_tol=1e-9):
            raise InputError(
                f"a residual map of another calibration: {name} is {value:.9g} there",
                f"{arm.values.get(name, 0.0):.9g}, as {result.path.name} has it",
                file=path,
                hint="run suta-calib residual-map again",
            )
    return record
