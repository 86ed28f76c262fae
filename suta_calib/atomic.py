"""Files that are either complete or not there: no reader ever sees half of one.

Files that replace others together are written into a hidden folder beside their places first,
`PREFIX`…`SUFFIX`. Where there are several, a journal there names them all; from the moment it
stands, the exchange is as good as done: whoever looks into the folder next carries it out to its
end (`recover`). Without a journal nothing was replaced, and what was written is thrown away.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path, PurePath
from typing import Final

from suta_calib.errors import OutputError

PREFIX: Final = ".suta-calib-"
SUFFIX: Final = ".tmp"
JOURNAL: Final = "journal.json"
# How long another process may take to exchange files of the same folder, s: a few files take
# milliseconds, a slow network drive seconds.
_PATIENCE_S: Final = 5.0
# What was read so far, as it was named, for whoever asks (`inputs_listed`).
_listed: ContextVar[dict[Path, None] | None] = ContextVar("listed", default=None)
# Real paths: of what the running command has read (None outside of one), and of what it edits.
_inputs: ContextVar[set[str] | None] = ContextVar("inputs", default=None)
_edited: ContextVar[frozenset[str]] = ContextVar("edited", default=frozenset())


@contextlib.contextmanager
def inputs_kept() -> Iterator[None]:
    """Within it, what was read by then is neither replaced nor removed.

    A job may name a file of its own results folder, which its next run would overwrite. A file of
    which somebody is the `only_writer` is edited, and no input.
    """
    token = _inputs.set(set())
    try:
        yield
    finally:
        _inputs.reset(token)


@contextlib.contextmanager
def inputs_listed() -> Iterator[dict[Path, None]]:
    """Gives what is read within it, by the names it is read by, in that order."""
    files: dict[Path, None] = {}
    token = _listed.set(files)
    try:
        yield files
    finally:
        _listed.reset(token)


def note_input(path: Path) -> None:
    """Say that a file is read; whoever opens one does, so that `inputs_kept` knows it."""
    if (listed := _listed.get()) is not None:
        listed[path] = None
    if (inputs := _inputs.get()) is not None:
        inputs.add(os.path.realpath(path))


def refuse_inputs(contents: Mapping[Path, bytes | None]) -> None:
    """Refuse to replace an input (`inputs_kept`) by something else, or to remove it (None).

    Raises:
        OutputError: one of these files is one.
    """
    inputs = (_inputs.get() or set()) - _edited.get()
    for path, data in contents.items():
        if inputs and os.path.realpath(path) in inputs:
            # The same once more is no loss.
            with contextlib.suppress(OSError):
                if path.read_bytes() == data:
                    continue
            raise _is_input(path)


def _refuse_devices(paths: Iterable[Path]) -> None:
    """Refuse to replace what is there and is no file: a device, a pipe, a socket.

    Raises:
        OutputError: one of these paths is such a thing, or a link to it.
    """
    for path in paths:
        with contextlib.suppress(OSError, ValueError):
            mode = path.stat().st_mode
            if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
                raise OutputError(
                    f"{path}: found a device, pipe or socket; expected a regular file or a new "
                    "name; choose another --out"
                )


def _is_input(path: Path) -> OutputError:
    return OutputError(
        f"{path}: found an input of the same command; expected a file of its own; move it, or "
        "choose another --out"
    )


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
    exchange_files(path.parent, {path.name: data})


def exchange_files(
    folder: Path, contents: Mapping[str, bytes], stale: Collection[str] = ()
) -> None:
    """Write files that belong together: nothing is replaced before all of them are on the disk.

    The last file is the record of the others: it goes first and comes last, so that whoever finds
    it finds the files it tells of, at whatever moment the computer stops. Where it stops in the
    middle, whoever writes or reads there next finishes it (`recover`).

    Args:
        folder: exists.
        contents: of the files by name, the record last; ``pictures/1.png`` is in a folder of this
            one, which is made where it is not there.
        stale: names of files of an earlier run that these do not replace; removed.

    Raises:
        OutputError: a file could not be written, or is an input (`inputs_kept`). Where the disk or
            the folder is why, what was there before is untouched, and neither a temporary file nor
            a new folder is left.
    """
    files = {folder / name: data for name, data in contents.items()}
    refuse_inputs({**dict.fromkeys(folder / name for name in stale), **files})
    _refuse_devices(files)
    try:
        _exchange(folder, contents, stale)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        if not folder.is_dir():
            reason = f"there is no folder {folder}"
        place = getattr(error, "filename2", None) or next(iter(files))
        message = f"{place}: not written: {reason}; nothing half-written was left"
        raise OutputError(message) from error


def _exchange(folder: Path, contents: Mapping[str, bytes], stale: Collection[str]) -> None:
    """Of an OSError the ``filename2`` is the file's path where it is known."""
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
            # Where a folder cannot be locked (Windows, some network drives), nobody still writes
            # after an hour.
            if not alone and time.time() - stage.stat().st_mtime < 3600.0:
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
                time.sleep(0.02)
            except OSError:
                break
        yield alone
    finally:
        os.close(descriptor)


def check_outputs(outputs: Iterable[Path], inputs: Iterable[os.PathLike[str] | None]) -> None:
    """Refuse to write a file that is read by the same command, or two into one.

    Raises:
        OutputError: an output is one of the inputs, or two outputs are the same file.
    """
    read = {os.path.realpath(path) for path in inputs if path is not None}
    written = set[str]()
    for path in outputs:
        real = os.path.realpath(path)
        if real in read:
            raise _is_input(path)
        if real in written:
            raise OutputError(
                f"{path}: found another output of the same command; expected a file of its own; "
                "choose another name"
            )
        written.add(real)


@contextlib.contextmanager
def only_writer(path: Path) -> Iterator[None]:
    """Be the only one to write a file, among the processes of this computer that ask to be.

    The lock is advisory, and gone with its process, however that ends. It is a file in the folder
    for temporary files, so that none is left where the other lies.

    Raises:
        OutputError: another process is writing it; says which.
    """
    real = os.path.realpath(path)
    name = hashlib.sha256(os.fsencode(real)).hexdigest()[:24]
    lock = Path(tempfile.gettempdir()) / f"suta-calib-{name}.lock"
    try:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError:
        # Nowhere to keep a lock, or somebody else's: better to write than not to.
        with _editing(real):
            yield
        return
    try:
        try:
            _lock(descriptor)
        except OSError:
            os.lseek(descriptor, 1, os.SEEK_SET)
            holder = os.read(descriptor, 20).decode(errors="replace").strip()
            raise OutputError(
                f"{path}: found process {holder or 'of another user'} writing it; expected nobody "
                "else; wait until it has ended, or choose another --out"
            ) from None
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f" {os.getpid()}".encode())
        with _editing(real):
            yield
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def _editing(real: str) -> Iterator[None]:
    token = _edited.set(_edited.get() | {real})
    try:
        yield
    finally:
        _edited.reset(token)


def _lock(descriptor: int) -> None:
    """Lock an open file, or raise an OSError where somebody else has."""
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


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
