"""A samples file that grows by one confirmed row at a time and is complete at every moment.

Each row means the whole file written under another name and renamed: whoever is killed in the
middle leaves the file as it was before. Rows of other placements in it are kept as they stand.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import OutputError, SamplesError
from suta_calib.measurements import read_csv_table, read_text, write_text


class SamplesFile:
    """The rows of one run in a samples CSV.

    Args:
        path: the file; made with its folder when the first row comes.
        joints: columns of the readings.
        labels: label columns.
        key: labels all rows of this run share.
        resume: go on with rows of this run that are already there.

    Attributes:
        rows: labels and readings (n,), rad, of this run's rows, in the file's order.

    Raises:
        SamplesError: the file is there and is no samples file with these columns, or holds rows of
            this run although it is not to be resumed.
        OutputError: the folder cannot be made.
    """

    def __init__(
        self,
        path: Path,
        joints: Sequence[str],
        labels: Sequence[str],
        key: Mapping[str, str],
        *,
        resume: bool = False,
    ) -> None:
        self.path, self._joints, self._labels, self._key = path, joints, labels, key
        self.rows: list[tuple[Mapping[str, str], FloatArray]] = []
        self._header: list[str] = [*joints, *labels]
        # Everything that is not this run's, the header first, as it stands.
        self._kept = _line(self._header)
        if path.exists():
            self._read(resume)

    def _read(self, resume: bool) -> None:
        table = read_csv_table(self.path)
        readings = np.stack([table.numbers(j, "a column per joint") for j in self._joints], axis=1)
        labels = {name: table.labels(name, "a label column") for name in self._labels}
        text = read_text(self.path, SamplesError).splitlines()
        self._header = [cell.strip() for cell in next(csv.reader([text[table.header_line - 1]]))]
        ours: set[int] = set()
        for index, line in enumerate(table.lines):
            own = {name: str(values[index]) for name, values in labels.items()}
            if any(own[name] != value for name, value in self._key.items()):
                continue
            if not resume:
                raise self._taken(line)
            ours.add(line)
            self.rows.append((own, readings[index]))
        self._kept = "".join(f"{x}\n" for n, x in enumerate(text, 1) if n not in ours and x)

    def _taken(self, line: int) -> SamplesError:
        run = ", ".join(f"{name} {value}" for name, value in self._key.items())
        return SamplesError(
            f"samples of {run} that are already there",
            "a file without them: what was measured is never overwritten",
            file=self.path,
            line=line,
            hint="go on with --resume, or give another --repeat or --out",
        )

    def put(self, labels: Mapping[str, str], angles: FloatArray, at: int | None = None) -> int:
        """Write one row, in place of this run's row number ``at`` if that is given.

        Returns:
            Its number among this run's rows. When this returns, the row is on the disk.

        Raises:
            OutputError: it could not be written; the file is as it was.
        """
        rows = list(self.rows)
        index = len(rows) if at is None else at
        rows[index : index + 1] = [(labels, angles)]
        self._write(rows)
        self.rows = rows
        return index

    def put_all(self, rows: Sequence[tuple[Mapping[str, str], FloatArray]]) -> None:
        """Write several rows at once after those there are.

        Raises:
            OutputError: they could not be written; the file is as it was.
        """
        together = [*self.rows, *rows]
        self._write(together)
        self.rows = together

    def relabel(self, labels: Sequence[Mapping[str, str]]) -> None:
        """Give all rows of this run other labels, in their order, at once.

        Raises:
            OutputError: they could not be written; the file is as it was.
        """
        rows = [(new, angles) for new, (_, angles) in zip(labels, self.rows, strict=True)]
        self._write(rows)
        self.rows = rows

    def _write(self, rows: Sequence[tuple[Mapping[str, str], FloatArray]]) -> None:
        text = self._kept
        for labels, angles in rows:
            cells = dict(labels) | dict(zip(self._joints, angles.tolist(), strict=True))
            text += _line([str(cells.get(name, "")) for name in self._header])
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.path}: not written: {error.strerror}") from error
        write_text(self.path, text)


def _line(cells: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()
