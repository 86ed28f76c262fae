"""A folder of results: JSON and whatever stands beside it, each file complete or not there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from suta_calib.atomic import write_bytes_atomically
from suta_calib.errors import OutputError
from suta_calib.report.document import Document, Figure
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
    name: str = "result.json",
) -> dict[str, Any]:
    """Write ``texts`` and then the answer, so that whoever waits for it finds the others.

    Args:
        answer: content of the JSON file.
        texts: whole contents by file name.
        folder: created if it is not there.
        name: of the JSON file.

    Returns:
        ``answer`` with ``files``, the paths written by name; what the JSON file holds.

    Raises:
        OutputError: the folder or a file in it cannot be written. Where that can be seen before,
            nothing is written.
    """
    paths = {each: folder / each for each in (*texts, name)}
    complete = {**answer, "files": {each: str(path) for each, path in paths.items()}}
    contents: dict[str, str | bytes] = {**texts, name: json_text(complete)}
    _check_targets(list(paths.values()))
    make_folder(folder)
    for each, path in paths.items():
        content = contents[each]
        write_bytes_atomically(path, content if isinstance(content, bytes) else content.encode())
    return complete


def write_document(
    answer: Document, folder: Path, texts: Mapping[str, str | bytes] = MappingProxyType({})
) -> dict[str, Any]:
    """Write a document: ``NAME.json``, its pictures, its section in ``report.html``.

    Args:
        answer: NAME is its name. Figures are written as ``NAME.svg``, or ``NAME_1.svg``,
            ``NAME_2.svg``, … where there are several; those of one that opens a report are not.
        folder: created if it is not there.
        texts: further whole files by name.

    Returns:
        The answer's JSON with ``files``, the paths written by name; what ``NAME.json`` holds.

    Raises:
        OutputError: the folder or a file in it cannot be written.
    """
    report = folder / REPORT
    page = report.read_text(encoding="utf-8", errors="replace") if report.is_file() else None
    contents = {**texts, **_pictures(answer), REPORT: page_with(answer, page)}
    return write_texts(answer.json(), contents, folder, f"{answer.name}.json")


def _pictures(answer: Document) -> dict[str, str]:
    if answer.opens_report:
        return {}
    figures = [part.svg for part in answer.shown("page") if isinstance(part, Figure)]
    if len(figures) == 1:
        return {f"{answer.name}.svg": figures[0]}
    return {f"{answer.name}_{k}.svg": svg for k, svg in enumerate(figures, start=1)}


def json_text(data: Mapping[str, Any]) -> str:
    """A JSON document as it is written to a file; what is not a finite number becomes null."""
    finite = json.loads(json.dumps(data), parse_constant=lambda _: None)
    return json.dumps(finite, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _check_targets(paths: list[Path]) -> None:
    for path in paths:
        if path.is_dir():
            raise OutputError(
                f"{path}: not written: found a folder of this name; expected a file or nothing; "
                "choose another folder with --out"
            )
