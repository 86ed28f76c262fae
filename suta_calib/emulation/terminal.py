"""A pseudo-terminal that stands for a serial port."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import select
import sys
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from suta_calib.errors import OutputError, SutaCalibError

if sys.platform != "win32":
    import fcntl
    import termios
    import tty


class PseudoTerminal:
    """The emulated end of a pseudo-terminal; programs open the other end by its name.

    What is written while nobody has the other end open is lost, as on a USB port: nothing from
    before lies in wait for whoever opens it.

    Args:
        link: a symbolic link to keep to the other end; replaces an older link.

    Raises:
        SutaCalibError: this system has no pseudo-terminals.
        OutputError: the link cannot be made, or something that is no link is in its place.
    """

    def __init__(self, link: Path | None = None) -> None:
        if sys.platform == "win32":
            raise SutaCalibError(
                "found Windows, which has no pseudo-terminals; expected Linux, macOS or WSL"
            )
        self.link = None if link is None else Path(link)
        self.name = ""
        self._master = -1
        self._rest = b""
        self._heard = False
        self.open()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def port(self) -> str:
        """What to open: the link if there is one, the other end's own name otherwise."""
        return self.name if self.link is None else str(self.link)

    def open(self) -> None:
        """Make a pseudo-terminal; it need not have the name of the last one."""
        self._master, slave = os.openpty()
        self.name = os.ttyname(slave)
        tty.setraw(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)
        if self.link is not None:
            try:
                _point(self.link, self.name)
            except OutputError:
                self.close()
                raise

    def close(self) -> None:
        """Take the port away, as if the cable were pulled out: readers see its end."""
        if self._master < 0:
            return
        if self.link is not None:
            with contextlib.suppress(OSError):
                if str(self.link.readlink()) == self.name:
                    self.link.unlink()
        os.close(self._master)
        self._master, self._rest, self._heard = -1, b"", False

    def heard(self) -> bool:
        """Whether anybody has the other end open."""
        if self._master < 0:
            return False
        events = dict(self._poll.poll(0)).get(self._master, 0)
        if events & select.POLLIN:
            with contextlib.suppress(OSError):
                os.read(self._master, 4096)  # a device that takes no orders
        heard = not events & select.POLLHUP
        if self._heard and not heard:
            self._forget()
        self._heard = heard
        return heard

    @property
    def unread(self) -> int:
        """How many bytes nobody has read yet."""
        waiting = array("i", [0])
        with contextlib.suppress(OSError), self._other_end(os.O_RDONLY) as slave:
            fcntl.ioctl(slave, termios.FIONREAD, waiting)
        return waiting[0]

    def write(self, data: bytes) -> bool:
        """Send bytes, all or none of them.

        Returns:
            Whether they went out: not where nobody listens, nor where whoever listens has not
            read for so long that the buffer is full.
        """
        if not self.heard():
            return False
        self._rest = self._rest[self._send(self._rest) :] if self._rest else b""
        if self._rest:
            return False
        sent = self._send(data)
        # What is begun is finished: a reader that lags misses whole frames only.
        self._rest = data[sent:] if sent else b""
        return sent > 0

    def _send(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except OSError as problem:
            if problem.errno not in (errno.EAGAIN, errno.EIO):
                raise
            return 0

    def _forget(self) -> None:
        """Drop what the last reader left unread."""
        self._rest = b""
        with contextlib.suppress(OSError, termios.error), self._other_end(os.O_RDWR) as slave:
            # A reader may have changed modes; the next one finds a fresh port.
            tty.setraw(slave)
            termios.tcflush(slave, termios.TCIFLUSH)

    @contextlib.contextmanager
    def _other_end(self, mode: int) -> Iterator[int]:
        slave = os.open(self.name, mode | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            yield slave
        finally:
            os.close(slave)


def _point(link: Path, target: str) -> None:
    """Make or replace a symbolic link in one step; nothing else of that name is replaced."""
    if os.path.lexists(link) and not link.is_symlink():
        raise OutputError(
            f"{link}: found a file that is not a link; expected nothing, or an older link"
        )
    temporary = link.with_name(f".{link.name[:40]}.{secrets.token_hex(6)}.tmp")
    try:
        temporary.symlink_to(target)
        os.replace(temporary, link)  # noqa: PTH105
    except OSError as problem:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise OutputError(f"{link}: link not created: {problem.strerror or problem}") from problem
