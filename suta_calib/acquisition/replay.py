"""A recording in place of a device: what ``measure --raw`` wrote, or any table of readings."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from suta_calib.acquisition.raw import recorded_batches
from suta_calib.analysis.repeatability.at_rest import NO_JOINTS, read_parquet
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.device.description import FRAME_COUNTS_PER_TURN, DeviceSpec, JointSpec
from suta_calib.device.reading import Reading, Statistics
from suta_calib.errors import SamplesError
from suta_calib.measurements import CsvTable, read_csv_table
from suta_calib.optional_packages import load


class RecordingEnded(Exception):  # noqa: N818 (the end of a file is no error)
    """Everything in a recording has been read."""


class RecordedStream:
    """Readings of a file, in its order, as a `Bus` gives those of a device.

    Cells that are no number, and angles that no joint can have, are the recording's: readings with
    them are handed on as they are, for whoever reads them to leave out.

    Args:
        path: CSV, Parquet, or the ``.part`` of a recording that was interrupted: a column ``time``,
            s, and one per joint, rad (m). ``errors`` names joints with a raised error flag.
        sent: columns that are no joints, and are averaged at each rest.

    Raises:
        SamplesError: it cannot be read, has no column ``time`` or none of joints, or is mostly in
            another unit.
        MissingExtraError: it is Parquet, and pyarrow is not installed.
    """

    def __init__(self, path: Path, sent: Collection[str] = ()) -> None:
        table = self._table = _read(path)
        names = tuple(name for name in table.columns if name not in NO_JOINTS)
        if "time" not in table.columns or not names:
            columns = f"only the columns {', '.join(table.columns)}"
            raise SamplesError(columns, "a column time, in s, and one per joint, in rad", file=path)
        angles = np.column_stack([_numbers(table.columns[name]) for name in names])
        # Largest angle, rad: beyond it, a cable spoilt the reading.
        angles[np.abs(angles) > 8 * np.pi] = np.nan
        specs = tuple(JointSpec(name) for name in names)
        extra = tuple(name for name in names if name in sent)
        self.spec = DeviceSpec(
            *(path, "", 1, "frames", "counts", FRAME_COUNTS_PER_TURN, specs), extra_columns=extra
        )
        self.statistics = Statistics(names)
        self._time = _numbers(table.columns["time"])
        self._angles = angles
        self._error = _raised(table, names)
        self._extra = np.zeros((len(angles), 0))
        self._next = 0

    def use(self, joints: Sequence[str]) -> None:
        """Refuse columns of these joints that are mostly no angles; none of them is another number.

        Raises:
            SamplesError: one is.
        """
        for name, column in zip(self.spec.names, self._angles.T, strict=True):
            # A cable may have spoilt some readings, but not half of them.
            if name in joints and np.mean(np.isnan(column)) > 0.5:
                raise SamplesError(
                    f"{np.mean(np.isnan(column)):.0%} of the readings are no angles in rad",
                    "rad (m for a joint that slides)",
                    file=self.spec.path,
                    where=f"column {name!r}",
                    hint="if they are degrees or counts, suta-calib import converts them",
                )
        extra = tuple(name for name in self.spec.extra_columns if name not in joints)
        self.spec = replace(self.spec, extra_columns=extra)
        numbers = [_numbers(self._table.columns[name]) for name in extra]
        self._extra = np.array(numbers).reshape(len(extra), len(self._time)).T

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Nothing is open."""

    def read(self, timeout: float = 0.1) -> list[Reading]:
        """The next readings.

        Raises:
            RecordingEnded: there are none left.
        """
        del timeout
        # Readings that are handed over at once.
        first, self._next = self._next, min(self._next + 400, len(self._time))
        if first == self._next:
            raise RecordingEnded
        none = np.zeros(self._angles.shape[1], dtype=np.bool_)
        rows = range(first, self._next)
        self.statistics.frames += len(rows)
        self.statistics.error_flags += np.sum(self._error[first : self._next], axis=0)
        times = self._time.tolist()
        q, error, extra = self._angles, self._error, self._extra
        return [Reading(k, times[k], q[k], error[k], none, times[k], extra[k]) for k in rows]


def _read(path: Path) -> CsvTable:
    if path.suffix == ".part":
        parts = [batch.to_pydict() for batch in recorded_batches(path)]
        if not parts:
            raise SamplesError("a recording without readings", "a second of it or more", file=path)
        columns = {name: sum((list(p[name]) for p in parts), list[Any]()) for name in parts[0]}
        texts = {n: tuple("" if v is None else str(v) for v in vs) for n, vs in columns.items()}
        return CsvTable(path, texts, 1, tuple(range(1, len(texts["time"]) + 1)))
    return read_parquet(path) if _is_parquet(path) else read_csv_table(path)


def _is_parquet(path: Path) -> bool:
    if path.suffix.lower() in (".parquet", ".pq"):
        load("pyarrow.parquet", "parquet")
        return True
    return False


def _numbers(cells: tuple[str, ...]) -> FloatArray:
    """(n,) NaN where a cell is none."""
    numbers = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        try:
            numbers[k] = float(cell)
        except ValueError:
            continue
    return numbers


def _raised(table: CsvTable, names: tuple[str, ...]) -> BoolArray:
    """(n, joints) whether an error flag is raised: of all joints where the row is not valid."""
    raised = np.zeros((len(table), len(names)), dtype=np.bool_)
    for k, cell in enumerate(table.columns.get("errors", ())):
        if cell:
            raised[k] = np.isin(names, cell.split())
    for k, cell in enumerate(table.columns.get("valid", ())):
        raised[k] |= cell.lower() in ("0", "false")
    return raised
