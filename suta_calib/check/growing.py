"""A file of samples that somebody else goes on writing: its complete lines, as they come."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from suta_calib.errors import InputError, SamplesError


def growing(file: Path, seconds: float | None) -> Iterator[Path]:
    """A copy of the file with its complete lines, each time there are more of them.

    A last line without an end is still being written, and waits. The file may be yet to come.

    Args:
        file: that grows.
        seconds: how long it is looked at; None for ever.

    Raises:
        InputError: it became shorter: another file in its place.
    """
    began, complete = time.monotonic(), b""
    with TemporaryDirectory(prefix="suta-calib-") as folder:
        copy = Path(folder) / file.name
        while True:
            last = seconds is not None and time.monotonic() - began >= seconds
            content = file.read_bytes() if file.is_file() else b""
            lines = content[: content.rfind(b"\n") + 1]
            if not lines.startswith(complete):
                expected = "the rows that were there, and more"
                raise SamplesError("other rows than before", expected, file=file)
            # The first line has the columns.
            if len(lines) > len(complete) and lines.count(b"\n") > 1:
                complete = lines
                copy.write_bytes(lines)
                yield copy
            if last:
                return
            # Seconds between two looks: sooner than anybody notices.
            time.sleep(0.2)


def about_file(error: InputError, copy: Path, file: Path) -> InputError:
    """An error about the copy as one about the file."""
    if error.file != copy:
        return error
    return type(error).of(error, file, error.line)
