"""Files in and out: text, and the glob patterns that name them.

Every reader either returns what the file says or raises one `InputError` that names the file
and, where there is one, the line. What the content means is the business of the other modules.
"""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from itertools import count
from pathlib import Path
from typing import Final

from suta_calib.atomic import note_input, write_bytes_atomically
from suta_calib.errors import InputError, SamplesError
from suta_calib.inputs import read_input


def read_bytes(path: Path, error: type[InputError] = InputError) -> bytes:
    """Every byte of a file.

    Raises:
        InputError: (as ``error``) missing, a folder, or unreadable.
    """
    if path.is_dir():
        raise error("a folder", "a file", file=path)
    try:
        note_input(path)
        return read_input(path)
    except FileNotFoundError:
        raise error("no such file", "a file that exists", file=path) from None
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise error(f"an unreadable file ({reason})", "a readable file", file=path) from None


def read_text(path: str | Path, error: type[InputError] = InputError) -> str:
    """Whole text of a UTF-8 file, without its byte order mark.

    Raises:
        InputError: (as ``error``) missing, a folder, unreadable, or not UTF-8 (with the
            line), as text with bytes that are zero is not.
    """
    path = Path(path)
    data = read_bytes(path, error)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = data[: problem.start].count(b"\n") + 1
        raise error(
            "bytes that are not UTF-8", "UTF-8 text", file=path, line=line, hint="save it as UTF-8"
        ) from None
    if (at := data.find(b"\0")) >= 0:
        hint = "UTF-16 files contain them: save it as UTF-8; or the file is incomplete"
        line = data[:at].count(b"\n") + 1
        raise error("zero bytes", "UTF-8 text", file=path, line=line, hint=hint)
    return text


def lines_of(text: str) -> list[str]:
    """Lines with their ends, which together are the text.

    A line feed, a carriage return, or both end a line, and nothing else does: `str.splitlines`
    knows eight more, U+2028 and the form feed among them, which may stand in a comment or a label.
    """
    return re.findall(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+", text)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text to ``path``, whole or not at all.

    Raises:
        OutputError: the folder is missing or cannot be written; ``path`` is as it was before.
    """
    write_bytes_atomically(path, text.encode("utf-8"))


# So many that a pattern was not meant.
MOST_ENTRIES: Final = 100_000


def expand(pattern: str, folder: Path) -> list[Path]:
    """Files that match a glob pattern (``**`` descends), sorted, at least one.

    Args:
        pattern: relative to ``folder``, or absolute; a file of exactly this name is taken as it is.
        folder: where relative patterns start.

    Raises:
        SamplesError: no file matches, one is a link to nothing, or so many have to be looked at
            that it was not meant; says the pattern and the folder.
    """
    is_file = os.path.isfile  # Path.is_file raises on overlong names
    if is_file(folder / pattern):
        return [folder / pattern]
    given = Path(pattern)
    paths = _matching(folder / given.anchor, given.relative_to(given.anchor).parts, count())
    try:
        matches = sorted(set(paths))
    except OverflowError:
        raise SamplesError(
            f"{pattern!r} in {folder}, which covers more than {MOST_ENTRIES:,} files",
            "a pattern that contains the folder of the files",
        ) from None
    files = [path for path in matches if is_file(path)]
    for path in matches:
        if path.is_symlink() and not path.exists():
            raise SamplesError(
                f"{path}, a link to {path.readlink()}, which does not exist",
                f"files that {pattern!r} matches",
                hint="correct the link or remove it",
            )
    if not files:
        raise SamplesError(f"no file that matches {pattern!r} in {folder}", "at least one file")
    return files


def in_empty_folder(pattern: str, folder: Path) -> bool:
    """Whether a glob pattern looks into a folder that exists and in which there is nothing."""
    within = (folder / pattern).parent
    if not (glob.has_magic(Path(pattern).name) and is_empty_folder(within)):
        return False
    note_input(within)
    return True


def is_empty_folder(path: Path) -> bool:
    """Whether it is a folder, and there is nothing in it."""
    try:
        return not any(path.iterdir())
    except (OSError, ValueError):
        return False


def _matching(folder: Path, parts: Sequence[str], looked: Iterator[int]) -> Iterator[Path]:
    """What matches the parts of a pattern below a folder.

    Not `glob.glob`, which says nothing until it has gone through all there is.
    """
    if not parts:
        yield folder
        return
    part, rest = parts[0], parts[1:]
    if not glob.has_magic(part):
        yield from _matching(folder / part, rest, looked)
        return
    descends = part == "**"
    if descends:
        rest = rest or ("*",)
        yield from _matching(folder, rest, looked)
    try:
        entries = list(os.scandir(folder))
    except (OSError, ValueError):
        return
    for entry in entries:
        if next(looked) >= MOST_ENTRIES:
            raise OverflowError
        if entry.name.startswith(".") and not part.startswith("."):
            continue
        if descends and entry.is_dir() and not _leads_back(entry):
            yield from _matching(folder / entry.name, parts, looked)
        elif not descends and fnmatch(entry.name, part):
            yield from _matching(folder / entry.name, rest, looked)


def _leads_back(entry: os.DirEntry[str]) -> bool:
    """Whether it is a link to a folder that it is in."""
    real = Path(entry.path).resolve()
    return entry.is_symlink() and Path(entry.path).parent.resolve().is_relative_to(real)
