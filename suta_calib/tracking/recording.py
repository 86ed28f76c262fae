"""Poses into a file, written beside the tracker so that no disk makes it wait.

While recording the file is called ``NAME.part``; at the end it gets its name. A process that is
killed leaves the part, complete to within a fraction of a second for CSV.
"""

from __future__ import annotations

import os
import threading
from abc import abstractmethod
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, TextIO

import numpy as np

from suta_calib.errors import OutputError
from suta_calib.optional_packages import load
from suta_calib.tracking.publisher import Publisher
from suta_calib.tracking.tracker import TrackedPose

COLUMNS: Final = (
    *("sequence", "time", "host_time", "x", "y", "z", "qx", "qy", "qz", "qw"),
    *("std_x", "std_y", "std_z", "valid", "flags"),
)


def part_of(path: Path) -> Path:
    """What a recording is called until it is complete."""
    return path.with_name(f"{path.name}.part")


class FileRecorder(Publisher):
    """Poses into one file, by a thread of its own.

    Args:
        path: the file; replaced when the recording is complete.
        joints: names of the arm's joints: columns of their own, in rad.

    Raises:
        OutputError: the file cannot be created.
    """

    def __init__(self, path: Path, joints: Sequence[str]) -> None:
        super().__init__()
        self.path = path
        self.part = part_of(path)
        self.columns = (*COLUMNS, *joints)
        self._waiting: deque[TrackedPose] = deque()
        self._failure: OSError | None = None
        self._over = threading.Event()
        if path.is_dir():
            raise OutputError(f"{path}: not written: found a folder; expected a file or nothing")
        try:
            self._open()
        except OSError as error:
            raise OutputError(f"{path}: not written: {error.strerror or error}") from None
        self._thread = threading.Thread(target=self._drain, name=self.name, daemon=True)
        self._thread.start()

    def publish(self, pose: TrackedPose) -> None:
        """Put one pose on the pile; an OutputError says that the disk refused what came before."""
        if self._failure is not None:
            raise self._refusal()
        self._waiting.append(pose)
        self.published += 1

    def close(self) -> None:
        """Write what waits, and give the file its name; without a single pose there is no file.

        Where that is not possible, an OutputError says so, and the part is left.
        """
        if self._over.is_set():
            return
        self._over.set()
        self._thread.join()
        if self._failure is not None:
            raise self._refusal()
        try:
            self._finish()
            if self.published:
                os.replace(self.part, self.path)  # noqa: PTH105
            else:
                self.part.unlink()
        except OSError as error:
            self._failure = error
            raise self._refusal() from None

    @abstractmethod
    def _open(self) -> None:
        """Create the part."""

    @abstractmethod
    def _write(self, poses: Sequence[TrackedPose]) -> None:
        """Append rows."""

    @abstractmethod
    def _finish(self) -> None:
        """Complete the part."""

    def _drain(self) -> None:
        """Write what waits again and again, and once more when it is over."""
        over = False
        while not over and self._failure is None:
            over = self._over.wait(0.1)
            poses = [self._waiting.popleft() for _ in range(len(self._waiting))]
            try:
                if poses:
                    self._write(poses)
            except OSError as error:
                self._failure = error

    def _refusal(self) -> OutputError:
        assert self._failure is not None
        reason = self._failure.strerror or self._failure
        return OutputError(
            f"{self.path}: incomplete: {reason}; the data recorded before are in {self.part}"
        )


class CsvRecorder(FileRecorder):
    """Poses as CSV: m, rad, s; a pose that is not valid has ``valid`` 0 and no numbers."""

    name = "csv"
    _file: TextIO

    def _open(self) -> None:
        joints = len(self.columns) - len(COLUMNS)
        self._row = "%d,%.6f,%.6f" + ",%.9f" * 7 + ",%s,%d,%s" + ",%.9f" * joints + "\n"
        self._no_pose = "%d,%.6f,%.6f,,,,,,,,,,,0,%s" + ",%.9f" * joints + "\n"
        self._file = self.part.open("w", encoding="utf-8", newline="")
        self._file.write(",".join(self.columns) + "\n")
        self._file.flush()

    def _write(self, poses: Sequence[TrackedPose]) -> None:
        self._file.writelines(map(self._text, poses))
        self._file.flush()

    def _finish(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def _text(self, pose: TrackedPose) -> str:
        head = (pose.sequence, pose.time, pose.host_time)
        if not pose.valid:
            return self._no_pose % (*head, flag_text(pose), *pose.angles)
        std = ",," if pose.std is None else ",".join(f"{value:.9f}" for value in pose.std)
        numbers = (*pose.position, *pose.quaternion, std, 1, flag_text(pose), *pose.angles)
        return self._row % (*head, *numbers)


class ParquetRecorder(FileRecorder):
    """The same columns as Parquet; what a pose lacks is null.

    Raises:
        MissingExtraError: pyarrow is not installed.
        OutputError: as `FileRecorder`.
    """

    name = "parquet"

    def _open(self) -> None:
        self._arrow, parquet = load("pyarrow", "parquet"), load("pyarrow.parquet", "parquet")
        types = {"sequence": "int64", "valid": "bool", "flags": "string"}
        fields = [
            (name, self._arrow.type_for_alias(types.get(name, "float64"))) for name in self.columns
        ]
        self._schema = self._arrow.schema(fields)
        self._rest: list[TrackedPose] = []
        self._writer = parquet.ParquetWriter(self.part, self._schema)

    def _write(self, poses: Sequence[TrackedPose]) -> None:
        self._rest.extend(poses)
        if len(self._rest) >= 8192:
            self._write_group()

    def _finish(self) -> None:
        if self._rest:
            self._write_group()
        self._writer.close()

    def _write_group(self) -> None:
        """A row group of what was not written yet."""
        poses, self._rest = self._rest, []
        unknown = np.full(3, np.nan)
        stds = [unknown if p.std is None else p.std for p in poses]
        rows = (
            (p.time, p.host_time, *p.position, *p.quaternion, *std, *p.angles)
            for p, std in zip(poses, stds, strict=True)
        )
        columns: dict[str, Any] = {
            "sequence": [p.sequence for p in poses],
            "valid": [p.valid for p in poses],
            "flags": [flag_text(p) for p in poses],
        }
        names = [name for name in self.columns if name not in columns]
        columns |= dict(zip(names, np.array(list(rows)).T, strict=True))
        arrays = [
            self._arrow.array(columns[field.name], type=field.type, from_pandas=True)
            for field in self._schema
        ]
        self._writer.write_table(self._arrow.table(arrays, schema=self._schema))


def flag_text(pose: TrackedPose) -> str:
    """``joint_3:error joint_2:warning``; empty where all is well."""
    if not (pose.errors or pose.warnings):
        return ""
    flags = [f"{name}:error" for name in pose.errors]
    return " ".join(flags + [f"{name}:warning" for name in pose.warnings])
