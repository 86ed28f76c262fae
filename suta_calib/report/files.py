"""A folder of results: JSON and whatever stands beside it, each file complete or not there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from suta_calib.atomic import write_bytes_atomically
from suta_calib.errors import OutputError


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
    texts: Mapping[str, str],
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
    contents = {**texts, name: json_text(complete)}
    _check_targets(list(paths.values()))
    make_folder(folder)
    for each, path in paths.items():
        write_bytes_atomically(path, contents[each].encode())
    return complete


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
