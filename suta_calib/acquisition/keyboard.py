"""Keys as they are pressed, without waiting for them: the stream must be read meanwhile.

On a terminal a key counts at once. From a pipe, or over a connection without a terminal, each line
counts as its first letter, an empty one as Enter, and the end of the input as ``q``.
"""

from __future__ import annotations

import contextlib
import os
import select
import termios
import tty
from typing import Any, Final, Self

_END: Final = "q"


class Keyboard:
    """Standard input, or another file descriptor, as a source of keys.

    Args:
        descriptor: to read from.

    Attributes:
        terminal: whether somebody sits at it.
    """

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        self.terminal = os.isatty(descriptor)
        self._before: list[Any] | None = None
        self._line = b""
        self._ended = False

    def __enter__(self) -> Self:
        if self.terminal:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    def key(self) -> str | None:
        """The next key that was pressed, in lower case, a line feed for Enter; None for none."""
        if self._ended:
            return _END
        if b"\n" not in self._line and not self._fill():
            return None
        return self._from_terminal() if self.terminal else self._from_line()

    def _fill(self) -> bool:
        """Read what is there; whether that makes a key."""
        if not select.select([self._descriptor], [], [], 0)[0]:
            return False
        data = os.read(self._descriptor, 1 if self.terminal else 1024)
        self._ended = not data
        self._line += data + (b"\n" if self._ended and self._line else b"")
        return self.terminal or self._ended or b"\n" in self._line

    def _from_terminal(self) -> str:
        data, self._line = self._line, b""
        return _letter(data) if data else _END

    def _from_line(self) -> str:
        if not self._line:
            return _END
        line, _, self._line = self._line.partition(b"\n")
        return _letter(line.strip()[:1])


def _letter(data: bytes) -> str:
    text = data.decode("utf-8", "replace").lower()
    return "\n" if text in ("", "\n", "\r", " ") else text
