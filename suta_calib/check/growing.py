"""A file of samples that somebody else goes on writing: its complete lines, as they come."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from suta_calib.check.checking import Check
from suta_calib.check.follow import Follow, FollowStep
from suta_calib.errors import InputError, SamplesError
from suta_calib.terms.term import Term

# Seconds between two looks: sooner than anybody notices.
LOOKS: Final = 0.2


class GrowingFile:
    """A file of samples that somebody else goes on writing.

    A last line without an end is still being written, and waits. The file may be yet to come, or be
    put aside and begun anew, as programs do that keep one file for each day.

    Args:
        file: that grows.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self._seen: tuple[int, ...] = ()
        self._complete = self._header = b""

    def look(self) -> tuple[bytes, bool] | None:
        """All its complete lines, if there are more; and whether it is the first time of them.

        Raises:
            InputError: rows that were there have changed, or it was begun anew with other columns.
        """
        try:
            status = self.file.stat()
        except OSError:
            return None
        seen = status.st_ino, status.st_size, status.st_mtime_ns
        if seen == self._seen or not self.file.is_file():
            return None
        content, self._seen = self.file.read_bytes(), seen
        lines = content[: content.rfind(b"\n") + 1]
        if lines and not lines.startswith(self._complete):
            if len(lines) >= len(self._complete):
                expected = "the rows that were there, and more"
                raise SamplesError("other rows than before", expected, file=self.file)
            if not lines.startswith(self._header):
                expected = "the columns that it had"
                raise SamplesError("a new file with other columns", expected, file=self.file)
            self._complete = b""
        # The first line has the columns.
        if len(lines) <= len(self._complete) or lines.count(b"\n") < 2:
            return None
        fresh = not self._complete
        self._complete, self._header = lines, lines[: lines.find(b"\n") + 1]
        return lines, fresh


def growing(file: Path, seconds: float | None) -> Iterator[tuple[bytes, bool]]:
    """The complete lines of a file, each time there are more of them.

    Args:
        file: that grows (`GrowingFile`).
        seconds: how long it is looked at; None for ever.

    Yields:
        The lines, and whether they are the first of a file that was begun.

    Raises:
        InputError: rows that were there have changed, or it was begun anew with other columns.
    """
    began, grown = time.monotonic(), GrowingFile(file)
    while True:
        last = seconds is not None and time.monotonic() - began >= seconds
        found = grown.look()
        if found is not None:
            yield found
        if last:
            return
        time.sleep(LOOKS)


class FollowedFile:
    """Rows of a file that grows, as its lines come.

    Args:
        file: that they stand in; errors name it.
        read: makes terms of files.
        follow: decides after every row.
    """

    def __init__(
        self, file: Path, read: Callable[[Sequence[Path]], list[Term]], follow: Follow
    ) -> None:
        self.file, self.read, self.follow = file, read, follow

    def take(self, lines: bytes, first: int, last: int) -> FollowStep:
        """Decide about the rows in some lines.

        Args:
            lines: of the file, all that are complete.
            first: how many of them were taken before.
            last: how many are taken then.

        Raises:
            InputError: a row that cannot be used; those before it have been looked at, and show no
                change.
        """
        with TemporaryDirectory(prefix="suta-calib-") as folder:
            copy = Path(folder) / self.file.name
            copy.write_bytes(_last_lines(lines, first, last))
            try:
                (term,) = self.read([copy])
            except InputError as error:
                if error.file != copy:
                    raise
                broken = error.line or 0
                if first < broken - 1 and 1 < broken - 1 < last:
                    step = self.take(lines, first, broken - 1)
                    if step.changed:
                        return step
                raise type(error).of(error, self.file, error.line) from None
        numbers = [int(row.rpartition(":")[2]) for row in term.poses.samples.origin]
        return self.follow.add(term, sum(number <= first for number in numbers))

    def check(self) -> Check:
        """What is known so far.

        Raises:
            SamplesError: no rows yet.
        """
        try:
            return self.follow.check()
        except SamplesError as error:
            if not self.file.exists():
                raise SamplesError(
                    "no such file from the beginning to the end",
                    "a file that somebody writes rows to",
                    file=self.file,
                    hint="check its name, and whether what measures runs and writes there",
                ) from None
            raise SamplesError.of(error, self.file, None) from None


def _last_lines(lines: bytes, first: int, last: int) -> bytes:
    """Lines of a file from one to another, those of its head, and empty ones for all between them.

    So every line keeps its number, and no row costs more than those before it. Some rows before the
    first stay, for what two rows say together.
    """
    head, before = 20, 300
    every = lines.split(b"\n")[:last]
    kept = first - before
    if kept > head:
        every[head:kept] = [b""] * (kept - head)
    return b"\n".join(every) + b"\n"
