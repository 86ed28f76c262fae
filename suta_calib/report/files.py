"""A folder of results: JSON and whatever stands beside it, each file complete or not there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from suta_calib.atomic import write_bytes_atomically
from suta_calib.errors import OutputError
from suta_calib.report.document import Document, Figure, File
from suta_calib.report.listing import json_text
from suta_calib.report.page import page_with

REPORT: Final = "report.html"


def make_folder(folder: Path) -> None:
    """Create a folder and its parents.

    Raises:
        OutputError: it cannot be created, or a file is in its place.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be used as the output folder: {error.strerror}; choose another one"
        ) from error


def write_texts(
    answer: Mapping[str, Any],
    texts: Mapping[str, str | bytes],
    folder: Path,
    name: str | None = "result.json",
) -> dict[str, Any]:
    """Write ``texts`` and then the answer, so that whoever waits for it finds the others.

    Args:
        answer: content of the JSON file.
        texts: whole contents by file name.
        folder: created if it is not there.
        name: of the JSON file; None for none.

    Returns:
        ``answer`` with ``files``, the paths written by name; what the JSON file holds.

    Raises:
        OutputError: the folder or a file in it cannot be written. Where that can be seen before,
            nothing is written.
    """
    paths = {each: folder / each for each in (*texts, *([] if name is None else [name]))}
    complete = {**answer, "files": {each: str(path) for each, path in paths.items()}}
    contents = dict(texts) if name is None else {**texts, name: json_text(complete)}
    for path in paths.values():
        if path.is_dir():
            raise OutputError(
                f"{path}: not written: found a folder of this name; expected a file or nothing; "
                "choose another folder with --out"
            )
    make_folder(folder)
    for each, path in paths.items():
        content = contents[each]
        write_bytes_atomically(path, content if isinstance(content, bytes) else content.encode())
    return complete


def write_document(answer: Document, folder: Path) -> dict[str, Any]:
    """Write a document: its JSON, its pictures and files, its section in ``report.html``.

    Args:
        answer: NAME is its name, and `Document.written` says which of these it has. Figures are
            written as ``NAME.svg``, or ``NAME_1.svg``, ``NAME_2.svg``, … where there are several.
        folder: created if it is not there.

    Returns:
        The answer's JSON with ``files``, the paths written by name; what its JSON file holds.

    Raises:
        OutputError: the folder or a file in it cannot be written.
    """
    contents = _contents(answer)
    if answer.written in ("result", "files"):
        name = "result.json" if answer.written == "result" else None
        return write_texts(answer.json(), contents, folder, name)
    report = folder / REPORT
    page = report.read_text(encoding="utf-8", errors="replace") if report.is_file() else None
    contents[REPORT] = page_with(answer, page)
    return write_texts(answer.json(), contents, folder, f"{answer.name}.json")


def _contents(answer: Document) -> dict[str, str | bytes]:
    """Pictures and further files by name, in the document's order."""
    figures = [part for part in answer.parts if isinstance(part, Figure)]
    found: dict[str, str | bytes] = {}
    for part in answer.parts:
        if isinstance(part, File):
            found[part.name] = part.content()
        elif isinstance(part, Figure) and answer.written != "opening":
            number = f"_{figures.index(part) + 1}" if len(figures) > 1 else ""
            found[f"{answer.name}{number}.svg"] = part.svg
    return found
