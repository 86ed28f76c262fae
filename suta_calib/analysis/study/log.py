"""Finished trials of a study in a CSV file, one line each, so that an interrupted study goes on.

The first line, a comment, says which study it is. Each trial is written in one piece when it is
done; a line that a crash cut off is dropped when the study is resumed. SI units throughout.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from typing import Final, Self

from suta_calib.analysis.study.trial import StudyData, Trial
from suta_calib.atomic import only_writer, write_bytes_atomically
from suta_calib.errors import JobError, OutputError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import CsvTable, read_csv_table, read_text

_MARK: Final = "# suta-calib study: "
Done = dict[tuple[int, int], Trial]


def identity(job: CalibrationJob, data: StudyData) -> dict[str, str]:
    """What makes two studies the same: a job is its file's content and that of all it names."""
    files = [job.spec.path, job.spec.arm.urdf]
    for row in (*job.spec.observations, *job.spec.validation):
        files += [*row.sample_files, *([] if row.artefact is None else [row.artefact])]
        files += [value for value in row.settings.values() if isinstance(value, Path)]
    digests = (hashlib.sha256(path.read_bytes()).digest() for path in files)
    return {
        "kind": data.kind,
        "unit": data.sets.unit,
        "seed": str(data.seed),
        "version": version("suta_calib"),
        "job": hashlib.sha256(b"".join(digests)).hexdigest(),
    }


class StudyLog:
    """Appends trials to a file, which is begun (its folder too) with the first of them.

    Args:
        path: the file.
        identity: what makes two studies the same, by name.
        names: parameters that trials may estimate.
    """

    def __init__(self, path: Path, identity: Mapping[str, str], names: Sequence[str]) -> None:
        self.path, self._identity, self._names = path, identity, tuple(names)
        self._descriptor = -1
        self._goes_on = False
        self._stack = ExitStack()

    def finished(self) -> Done:
        """Trials that a file has already, by (size, number); those to come are added to it."""
        if not self.path.exists():
            return {}
        text = read_text(self.path, JobError)
        complete = text[: text.rfind("\n") + 1]
        lines = complete.splitlines(keepends=True)
        self._refuse_others(lines[0] if lines else "")
        if len(lines) < 2:
            complete = "".join(self._head())
        if complete != text:
            write_bytes_atomically(self.path, complete.encode())
        self._goes_on = True
        if len(lines) <= 2:
            return {}
        table = read_csv_table(self.path)
        done: Done = {}
        for row, problem in enumerate(table.cells("problem")):
            estimates = {}
            for name in self._names:
                value, std = (_number(table, row, column) for column in (name, f"{name}:std"))
                if math.isfinite(value):
                    estimates[name] = (value, std)
            size, number = (int(_number(table, row, name)) for name in ("size", "trial"))
            rms = _number(table, row, "rms_m")
            done[size, number] = Trial(size, number, problem, rms, estimates)
        return done

    def append(self, trial: Trial) -> None:
        """Write one trial; it is in the file when this returns."""
        estimates = [trial.estimates.get(name, (math.nan, math.nan)) for name in self._names]
        numbers = [trial.rms, *(number for pair in estimates for number in pair)]
        numbers_text = (repr(number) if math.isfinite(number) else "" for number in numbers)
        cells = [str(trial.size), str(trial.number), trial.problem, *numbers_text]
        try:
            if self._descriptor < 0:
                if not self._goes_on:
                    self.path.parent.mkdir(parents=True, exist_ok=True)
                    write_bytes_atomically(self.path, "".join(self._head()).encode())
                self._descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND)
                self._stack.callback(os.close, self._descriptor)
            os.write(self._descriptor, _line(cells).encode())
        except OSError as error:
            raise OutputError(f"{self.path}: not written: {error.strerror}") from error

    def __enter__(self) -> Self:
        self._stack.enter_context(only_writer(self.path))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _head(self) -> tuple[str, str]:
        settings = ", ".join(f"{name}={value}" for name, value in self._identity.items())
        columns = [column for name in self._names for column in (name, f"{name}:std")]
        return f"{_MARK}{settings}\n", _line(["size", "trial", "problem", "rms_m", *columns])

    def _refuse_others(self, first: str) -> None:
        """Trials of another study, as the first line of the file says."""
        if first == self._head()[0]:
            return
        parts = first.removeprefix(_MARK).strip().split(", ")
        there = dict(part.split("=", 1) for part in parts if "=" in part)
        differs = [name for name, value in self._identity.items() if there.get(name) != value]
        raise JobError(
            f"trials of another study ({', '.join(differs) or 'another file'} differs)",
            "trials of this job with the same data and options",
            file=self.path,
            line=1,
            hint="leave out --resume to begin anew, or choose another --out",
        )


def _number(table: CsvTable, row: int, name: str) -> float:
    """The number in a cell; NaN for an empty one, which is no count."""
    cell, counts = table.cells(name)[row], name in ("size", "trial")
    if counts and not cell.isdecimal():
        raise table.refuse(row, name, repr(cell), "a whole number, as it was written")
    try:
        return float(cell) if cell else math.nan
    except ValueError:
        raise table.refuse(row, name, repr(cell), "a number, as it was written") from None


def _line(cells: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()
