"""JSON objects of earlier commands, read with one clear error for whatever is wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError
from suta_calib.measurements.files import read_text


def read_json_object(path: Path) -> dict[str, Any]:
    """The one JSON object in a file.

    Raises:
        InputError: no such file, not JSON (with the line), or something else than an object.
    """
    try:
        data = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise InputError(
            f"text that is not JSON ({error.msg})", "a JSON object", file=path, line=error.lineno
        ) from None
    if not isinstance(data, dict):
        raise InputError(f"a JSON {type(data).__name__}", "a JSON object", file=path)
    return data


def numbers(data: Any, shape: tuple[int, ...], path: Path, where: str) -> FloatArray:
    """Finite numbers of a given shape.

    Raises:
        InputError: anything else.
    """
    size = " x ".join(map(str, shape))
    try:
        found = np.array(data, dtype=float)
    except (TypeError, ValueError):
        found = np.full(1, np.nan)
    if found.shape != shape or not np.isfinite(found).all():
        said = repr(data)
        said = said if len(said) <= 60 else said[:57] + "…"
        raise InputError(said, f"{size} finite numbers", file=path, where=where)
    return found
