"""Files that are either complete or not there: no reader ever sees half of one."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path

from suta_calib.errors import OutputError


def write_bytes_atomically(path: str | Path, data: bytes) -> None:
    """Write ``data`` under a temporary name in the same folder, then rename it to ``path``.

    Args:
        path: the file to create or replace; its folder must exist.
        data: the whole content.

    Raises:
        OutputError: the file could not be written. What was at ``path`` before is untouched, and
            no temporary file is left.
    """
    path = Path(path)
    # Not tempfile: it makes files only their owner may read, and the rename would keep that.
    temporary = path.parent / f".{path.name[:40]}.{secrets.token_hex(6)}.tmp"
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            # Without this a power cut after the rename can leave a complete name on an empty file.
            os.fsync(file.fileno())
        os.replace(temporary, path)  # noqa: PTH105
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        if not path.parent.is_dir():
            reason = f"there is no folder {path.parent}"
        raise OutputError(
            f"{path}: not written: {reason}; nothing half-written was left"
        ) from error
    finally:
        with contextlib.suppress(OSError, ValueError):
            temporary.unlink(missing_ok=True)


def check_folder(folder: Path) -> None:
    """Refuse an output folder that cannot be written, before any work is done.

    Raises:
        OutputError: it, or the nearest folder above it that exists, is a file or write-protected.
    """
    existing = Path(os.path.abspath(folder))  # noqa: PTH100 (resolve() would follow links)
    while not os.path.lexists(existing):
        existing = existing.parent
    if existing.is_dir() and os.access(existing, os.W_OK | os.X_OK):
        return
    problem = " write-protected" if existing.is_dir() else ", which is no folder"
    raise OutputError(
        f"{folder}: found {existing}{problem}; expected a folder to write into; "
        "choose another with --out"
    )
