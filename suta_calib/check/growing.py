"""A file of samples that somebody else goes on writing: its complete lines, as they come."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from suta_calib.errors import InputError, SamplesError


def growing(file: Path, seconds: float | None) -> Iterator[tuple[Path, bool]]:
    """A copy of the file with its complete lines, each time there are more of them.

    A last line without an end is still being written, and waits. The file may be yet to come, or be
    put aside and begun anew, as programs do that keep one file for each day: of each copy it is
    said whether it is the first of such a file.

    Args:
        file: that grows.
        seconds: how long it is looked at; None for ever.

    Raises:
        InputError: rows that were there have changed, or it was begun anew with other columns.
    """
    began, complete, header, fresh = time.monotonic(), b"", b"", True
    with TemporaryDirectory(prefix="suta-calib-") as folder:
        copy = Path(folder) / file.name
        while True:
            last = seconds is not None and time.monotonic() - began >= seconds
            content = file.read_bytes() if file.is_file() else b""
            lines = content[: content.rfind(b"\n") + 1]
            if lines and not lines.startswith(complete):
                if len(lines) >= len(complete):
                    expected = "the rows that were there, and more"
                    raise SamplesError("other rows than before", expected, file=file)
                if not lines.startswith(header):
                    expected = "the columns that it had"
                    raise SamplesError("a new file with other columns", expected, file=file)
                complete, fresh = b"", True
            # The first line has the columns.
            if len(lines) > len(complete) and lines.count(b"\n") > 1:
                complete, header = lines, lines[: lines.find(b"\n") + 1]
                copy.write_bytes(lines)
                yield copy, fresh
                fresh = False
            if last:
                return
            # Seconds between two looks: sooner than anybody notices.
            time.sleep(0.2)


def about_file(error: InputError, copy: Path, file: Path) -> InputError:
    """An error about the copy as one about the file."""
    if error.file != copy:
        return error
    return type(error).of(error, file, error.line)
