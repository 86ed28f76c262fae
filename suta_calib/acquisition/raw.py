"""The stream as it came, to Parquet: one row per reading, nothing averaged or left out."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import Any, Self

import numpy as np

from suta_calib.device.reading import Reading
from suta_calib.errors import InputError, OutputError
from suta_calib.optional_packages import load


class RawRecorder:
    """Writes readings to ``FILE.part``; they become the Parquet file when it is complete.

    A Parquet file without its end cannot be read, so the part is an Arrow stream: who kills the
    program loses a second of it, and the next recording under this name recovers the rest first.

    Columns: ``sequence``, ``time`` and ``arrival`` (s), one per joint (rad), and the names of the
    joints with a raised error flag in ``errors``. Those of `DeviceSpec.extra_columns` follow.

    Raises:
        InputError: there is a file of this name.
        MissingExtraError: pyarrow is not installed.
        OutputError: it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        joints: Sequence[str],
        say: Callable[[str], None] = lambda _: None,
        extra: Sequence[str] = (),
    ) -> None:
        if path.exists():
            hint = "choose another name with --raw"
            raise InputError("an existing file", "the name of a new file", file=path, hint=hint)
        self._path, self._joints = path, tuple(joints)
        self._part = path.with_name(f"{path.name}.part")
        self._readings: list[Reading] = []
        self._flushed = time.monotonic()
        self._arrow = load("pyarrow", "parquet")
        numbers = [(name, self._arrow.float64()) for name in ("time", "arrival", *joints)]
        fields = [("sequence", self._arrow.int64()), *numbers, ("errors", self._arrow.string())]
        fields += [(name, self._arrow.float64()) for name in extra]
        self._schema = self._arrow.schema(fields)
        with self._telling():
            if self._part.exists():
                say(self._recovered())
            self._sink = self._part.open("xb")
            self._writer = self._arrow.ipc.new_stream(self._sink, self._schema)

    def _recovered(self) -> str:
        """What became of the part that a run left that was killed."""
        stem, suffix = self._path.stem, self._path.suffix
        names = (self._path.with_name(f"{stem}-recovered-{k}{suffix}") for k in count(1))
        name = next(name for name in names if not name.exists())
        if rows := _to_parquet(self._part, name):
            return f"{rows} readings of an interrupted run were saved in {name}"
        name.unlink(missing_ok=True)
        return f"{self._part}, left by an interrupted run, contained no readings and was removed"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # Also after an error: what came before it may explain it.
        with self._telling():
            self._flush()
            self._writer.close()
            self._sink.close()
            _to_parquet(self._part, self._path)

    def write(self, readings: Sequence[Reading]) -> None:
        """Take readings of all the device's joints; an OutputError says that the disk is full."""
        self._readings += readings
        if len(self._readings) >= 4096 or time.monotonic() - self._flushed > 1.0:
            with self._telling():
                self._flush()

    @contextlib.contextmanager
    def _telling(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = error.strerror or error
            raise OutputError(f"{self._path}: not written: {reason}") from error

    def _flush(self) -> None:
        rows, self._readings = self._readings, []
        self._flushed = time.monotonic()
        if not rows:
            return
        names = np.array(self._joints, dtype=object)
        heads = zip(*((row.sequence, row.time, row.arrival) for row in rows), strict=True)
        errors = [" ".join(names[row.error]) for row in rows]
        angles, extra = (
            np.array([getattr(row, name) for row in rows]).T for name in ("angles", "extra")
        )
        columns = [*heads, *angles, errors, *extra]
        batch = self._arrow.RecordBatch.from_arrays(
            [self._arrow.array(c, type=f.type) for c, f in zip(columns, self._schema, strict=True)],
            schema=self._schema,
        )
        self._writer.write_batch(batch)
        self._sink.flush()


def _to_parquet(part: Path, path: Path) -> int:
    """Turn as much of an Arrow stream as is whole into a Parquet file; how many rows it has."""
    from pyarrow import parquet

    rows, written = 0, path.with_name(f"{path.name}.tmp")
    try:
        with contextlib.ExitStack() as stack:
            batches = _schema_and_batches(stack.enter_context(part.open("rb")))
            schema = next(batches, None)
            if schema is not None:
                writer = stack.enter_context(parquet.ParquetWriter(written, schema))
                for batch in batches:
                    writer.write_batch(batch)
                    rows += batch.num_rows
        if schema is not None:
            os.replace(written, path)  # noqa: PTH105
        elif part.stat().st_size:
            hint = "move it away, or choose another name with --raw"
            raise InputError("a file that is not a recording", "nothing", file=part, hint=hint)
        part.unlink()
    finally:
        with contextlib.suppress(OSError):
            written.unlink(missing_ok=True)
    return rows


def recorded_batches(part: Path) -> list[Any]:
    """What is whole of a recording that was interrupted, as record batches of its columns."""
    load("pyarrow", "parquet")
    try:
        with part.open("rb") as file:
            _, *batches = [*_schema_and_batches(file)] or [None]
    except OSError as error:
        raise InputError(str(error.strerror), "a recording", file=part) from error
    return batches


def _schema_and_batches(file: Any) -> Iterator[Any]:
    """The schema of an Arrow stream, and its batches up to where it was cut off."""
    import pyarrow

    # Of a stream that is cut off, pyarrow says either of these.
    with contextlib.suppress(pyarrow.ArrowInvalid, OSError):
        reader = pyarrow.ipc.open_stream(file)
        yield reader.schema
        yield from reader
