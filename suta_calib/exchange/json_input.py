"""JSON of other programs: bounded, and one error for whatever is wrong with it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_foreign_text


def read_json(path: Path) -> dict[str, Any]:
    """The one object in a file.

    Raises:
        ForeignFileError: unreadable, too large, not JSON (with its line), or something else.
    """
    text = read_foreign_text(path)
    try:
        data = json.loads(text)
    except json.JSONDecodeError as problem:
        reason = f"text that is not JSON ({problem.msg})"
        raise ForeignFileError(reason, "a JSON object", file=path, line=problem.lineno) from None
    except (RecursionError, ValueError) as problem:
        reason = f"JSON that cannot be read ({type(problem).__name__})"
        raise ForeignFileError(reason, "a JSON object", file=path) from None
    if not isinstance(data, dict) or not data:
        description = "an empty JSON object" if data == {} else f"a JSON {type(data).__name__}"
        raise ForeignFileError(description, "a JSON object with something in it", file=path)
    return data
