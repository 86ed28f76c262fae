"""Files that are read, with a bound: a pipe or a device may never end, or never begin."""

from __future__ import annotations

import errno
import os
import select
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from suta_calib.display import Displayable

# Of a file; what is larger does not fit into memory several times over, as its parts do.
MOST_OF_FILE: Final = 1_000_000_000
# How long nothing may come from a pipe or a device, s.
PATIENCE: Final = 5.0
_AT_ONCE: Final = 1 << 16


@dataclass(frozen=True)
class XacroFile(Displayable, os.PathLike[str]):
    """A ``.xacro`` file and values of its arguments: stands where the path of a URDF may.

    Attributes:
        path: of the file.
        arguments: values by name; others have their defaults.
    """

    path: Path
    arguments: Mapping[str, str] = field(hash=False)

    def __fspath__(self) -> str:
        return str(self.path)

    def __str__(self) -> str:
        return str(self.path)


# Where a URDF comes from.
UrdfFile = Path | XacroFile


def read_input(path: Path, most: int = MOST_OF_FILE) -> bytes:
    """Every byte of a file, or of a pipe that another program writes into.

    Args:
        path: of it.
        most: bytes that are read.

    Returns:
        The content; of a device that gives zeros, such as ``/dev/zero``, some of them.

    Raises:
        OSError: it cannot be read, holds more than ``most``, or nothing comes from it.
        ValueError: a name that no file can have.
    """
    status = path.stat()
    if stat.S_ISREG(status.st_mode) or not hasattr(os, "O_NONBLOCK"):
        if status.st_size > most:
            raise OSError(errno.EFBIG, f"more than {most / 1e6:.0f} MB")
        return path.read_bytes()
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, "a folder")
    # Without O_NONBLOCK, to open a pipe waits for whoever writes into it.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY)
    try:
        # Nothing says the size of a pipe or a device.
        return _read_stream(descriptor, min(most, 64_000_000))
    finally:
        os.close(descriptor)


def _read_stream(descriptor: int, most: int) -> bytes:
    parts, size = list[bytes](), 0
    while size <= most:
        if not select.select([descriptor], [], [], PATIENCE)[0]:
            reason = f"nothing comes from this pipe or device for {PATIENCE:g} s"
            raise OSError(errno.ETIMEDOUT, reason)
        part = os.read(descriptor, _AT_ONCE)
        parts.append(part)
        size += len(part)
        if not part or (size == len(part) == _AT_ONCE and not part.strip(b"\0")):
            return b"".join(parts)
    raise OSError(errno.EFBIG, f"a pipe or device of more than {most / 1e6:.0f} MB")
