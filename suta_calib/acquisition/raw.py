"""The stream as it came, to Parquet: one row per reading, nothing averaged or left out."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from suta_calib.errors import InputError, MissingExtraError, OutputError

if TYPE_CHECKING:
    from suta_calib.device.reading import Reading

_ROWS: Final = 4096


class RawRecorder:
    """Writes readings under a temporary name; the file gets its own name when it is complete.

    Columns: ``sequence``, ``time`` and ``arrival`` (s), one per joint (rad), and the names of the
    joints with a raised error flag in ``errors``.

    Args:
        path: the file; must not exist.
        joints: names of the device's joints.

    Raises:
        InputError: there is a file of this name.
        MissingExtraError: pyarrow is not installed.
        OutputError: it cannot be written.
    """

    def __init__(self, path: Path, joints: Sequence[str]) -> None:
        if path.exists():
            hint = "choose another name with --raw"
            raise InputError("a file that exists", "the name of a new file", file=path, hint=hint)
        self._path, self._joints = path, tuple(joints)
        self._temporary = path.parent / f".{path.name[:40]}.{secrets.token_hex(6)}.tmp"
        self._readings: list[Reading] = []
        self._arrow = _arrow()
        self._schema = self._arrow.schema(
            [("sequence", self._arrow.int64()), ("time", self._arrow.float64())]
            + [("arrival", self._arrow.float64())]
            + [(joint, self._arrow.float64()) for joint in self._joints]
            + [("errors", self._arrow.string())]
        )
        self._writer = self._open()

    def _open(self) -> Any:
        from pyarrow import parquet

        try:
            return parquet.ParquetWriter(self._temporary, self._schema)
        except OSError as error:
            raise OutputError(f"{self._path}: not written: {error.strerror or error}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # Also after an error: what came before it may explain it.
        try:
            self._flush()
            self._writer.close()
            os.replace(self._temporary, self._path)  # noqa: PTH105
        finally:
            with contextlib.suppress(OSError):
                self._temporary.unlink(missing_ok=True)

    def write(self, readings: Sequence[Reading]) -> None:
        """Take readings, whole ones with all the device's joints."""
        self._readings += readings
        if len(self._readings) >= _ROWS:
            self._flush()

    def _flush(self) -> None:
        rows, self._readings = self._readings, []
        if not rows:
            return
        angles = np.array([row.angles for row in rows])
        columns: list[Any] = [[row.sequence for row in rows], [row.time for row in rows]]
        columns += [[row.arrival for row in rows], *angles.T, [self._flags(row) for row in rows]]
        arrays = [
            self._arrow.array(values, type=field.type)
            for values, field in zip(columns, self._schema, strict=True)
        ]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))

    def _flags(self, reading: Reading) -> str:
        raised = zip(self._joints, reading.error, strict=True)
        return " ".join(joint for joint, error in raised if error)


def _arrow() -> Any:
    try:
        import pyarrow
    except ImportError:
        raise MissingExtraError(
            "found no package pyarrow; expected it for --raw; pip install 'suta_calib[parquet]'"
        ) from None
    return pyarrow
