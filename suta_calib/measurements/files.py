"""Files in and out: text, and the glob patterns that name them.

Every reader either returns what the file says or raises one `InputError` that names the file
and, where there is one, the line. What the content means is the business of the other modules.
"""

from __future__ import annotations

import glob
import os
import re
from pathlib import Path

from suta_calib.atomic import write_bytes_atomically
from suta_calib.errors import InputError, SamplesError


def read_text(path: Path, error: type[InputError] = InputError) -> str:
    """Whole text of a UTF-8 file, without its byte order mark.

    Raises:
        InputError: (as ``error``) missing, a folder, unreadable, or not UTF-8 (with the line).
    """
    if path.is_dir():
        raise error("a folder", "a file", file=path)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise error("no such file", "a file that exists", file=path) from None
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise error(f"an unreadable file ({reason})", "a readable file", file=path) from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = data[: problem.start].count(b"\n") + 1
        raise error(
            "bytes that are not UTF-8", "UTF-8 text", file=path, line=line, hint="save it as UTF-8"
        ) from None


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


def expand(pattern: str, folder: Path) -> list[Path]:
    """Files that match a glob pattern (``**`` descends), sorted, at least one.

    Args:
        pattern: relative to ``folder``, or absolute; a file of exactly this name is taken as it is.
        folder: where relative patterns start.

    Raises:
        SamplesError: no file matches; says the pattern and the folder.
    """
    if os.path.isfile(folder / pattern):  # noqa: PTH113 (Path.is_file raises on overlong names)
        return [folder / pattern]
    found = glob.glob(pattern, root_dir=folder, recursive=True)  # noqa: PTH207 (Path.glob refuses absolute patterns)
    files = sorted(path for name in found if (path := folder / name).is_file())
    if not files:
        raise SamplesError(f"no file that matches {pattern!r} in {folder}", "at least one file")
    return files
