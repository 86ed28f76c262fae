"""Files that replace others together, also where the process is killed while it does so.

They are written into a hidden folder beside their places first, `PREFIX`…`SUFFIX`. Where there are
several, a journal there names them all; from the moment it stands, the exchange is as good as done:
whoever looks into the folder next carries it out to its end (`recover`). Without a journal nothing
was replaced, and what was written is thrown away.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Final

PREFIX: Final = ".suta-calib-"
SUFFIX: Final = ".tmp"
JOURNAL: Final = "journal.json"
# How long another process may take to exchange files of the same folder, s: a few files take
# milliseconds, a slow network drive seconds.
_PATIENCE_S: Final = 5.0
_LOOK_S: Final = 0.02
# Where a folder cannot be locked (Windows, some network drives), nobody still writes after so long.
_SURELY_OVER_S: Final = 3600.0


def exchange(folder: Path, contents: Mapping[str, bytes], stale: Collection[str]) -> None:
    """Replace files of a folder together; see `atomic.exchange_files`.

    Raises:
        OSError, ValueError: with the file's path as ``filename2`` where it is known.
    """
    stage = folder / f"{PREFIX}{os.urandom(6).hex()}{SUFFIX}"
    with _alone_in(folder) as alone:
        _recover(folder, alone=alone)
        try:
            stage.mkdir()
            for number, (name, data) in enumerate(contents.items()):
                try:
                    _write(stage / str(number), data)
                except OSError as error:
                    error.filename2 = str(folder / name)
                    raise
            names = [*contents]
            if len(names) > 1 or stale:
                journal = json.dumps({"files": names, "stale": [*stale]})
                _write(stage / f"{JOURNAL}.part", journal.encode())
                (stage / f"{JOURNAL}.part").replace(stage / JOURNAL)
            try:
                _carry_out(folder, stage, names, stale)
            except KeyboardInterrupt:
                _carry_out(folder, stage, names, stale)
                raise
        finally:
            shutil.rmtree(stage, ignore_errors=True)


def recover(folder: Path) -> None:
    """Finish what a process began to exchange in a folder and was killed over, or throw it away.

    What cannot be done, for the folder is write-protected, is left as it is.
    """
    if _left_behind(folder):
        with _alone_in(folder) as alone:
            _recover(folder, alone=alone)


def _write(path: Path, data: bytes) -> None:
    # Not tempfile: it makes files only their owner may read, and the rename would keep that.
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        # Without this a power cut after the rename can leave a name on an empty file.
        os.fsync(file.fileno())


def _carry_out(
    folder: Path, stage: Path, names: Sequence[str], stale: Collection[str] = ()
) -> None:
    """Put staged files in their places, as far as that is not done; the last one is the record.

    The record of the run before goes first, and that of this one comes last: whoever finds one
    finds the files it tells of.
    """
    staged = {stage / str(number): folder / name for number, name in enumerate(names)}
    record = stage / str(len(names) - 1)
    if len(names) > 1 or stale:
        gone = [folder / name for name in stale]
        for path in (*([staged[record]] if record.exists() else []), *gone):
            path.unlink(missing_ok=True)
            if path.parent != folder:
                with contextlib.suppress(OSError):
                    path.parent.rmdir()
    for source, path in staged.items():
        if source.exists():
            if path.parent != folder:
                path.parent.mkdir(exist_ok=True)
            os.replace(source, path)  # noqa: PTH105


def _left_behind(folder: Path) -> list[Path]:
    """Folders of exchanges that are going on, or were broken off."""
    try:
        with os.scandir(folder) as entries:
            return [
                Path(entry.path)
                for entry in entries
                if entry.name.startswith(PREFIX)
                and entry.name.endswith(SUFFIX)
                and entry.is_dir(follow_symlinks=False)
            ]
    except OSError:
        return []


def _recover(folder: Path, *, alone: bool) -> None:
    for stage in _left_behind(folder):
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            if not alone and time.time() - stage.stat().st_mtime < _SURELY_OVER_S:
                continue
            if (journal := stage / JOURNAL).is_file():
                record = json.loads(journal.read_bytes())
                names, stale = list(record["files"]), list(record["stale"])
                if all(_is_inside(folder, name) for name in (*names, *stale)):
                    _carry_out(folder, stage, names, stale)
            shutil.rmtree(stage, ignore_errors=True)


def _is_inside(folder: Path, name: str) -> bool:
    """Whether a name of a journal, which anybody may have written, is of a file in the folder."""
    path = PurePath(name)
    if path.is_absolute() or not path.parts or ".." in path.parts or path.drive:
        return False
    return (folder / path).parent.resolve().is_relative_to(folder.resolve())


@contextlib.contextmanager
def _alone_in(folder: Path) -> Iterator[bool]:
    """Be the only process that exchanges files of a folder; gives whether that is sure."""
    if sys.platform == "win32":
        yield False
        return
    import fcntl

    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        # Whoever writes into it says what is wrong.
        yield False
        return
    try:
        end, alone = time.monotonic() + _PATIENCE_S, False
        while not alone and time.monotonic() < end:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                alone = True
            except BlockingIOError:
                time.sleep(_LOOK_S)
            except OSError:
                break
        yield alone
    finally:
        os.close(descriptor)
