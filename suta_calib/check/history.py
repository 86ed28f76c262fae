"""What earlier checks of a result found: one line each in ``checks.jsonl`` beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from suta_calib.assessment import attempt
from suta_calib.check.checking import Check
from suta_calib.errors import OutputError
from suta_calib.inputs import read_input
from suta_calib.units import Unit, from_mm, shown

NAME: Final = "checks.jsonl"


@dataclass(frozen=True)
class EarlierCheck:
    """A line of a history.

    Attributes:
        time: of the check, UTC.
        unchanged: its answer.
        p: chance of its rows if nothing changed.
        changed: what did.
        rms: of the errors of its rows, m; NaN of angles alone.
        result: SHA-256 of the result that was checked; empty where an older line names none.
    """

    time: datetime
    unchanged: bool
    p: float
    changed: tuple[str, ...]
    rms: float
    result: str


def line_of(check: Check, samples: Sequence[Path], result: Path) -> Mapping[str, Any]:
    """What a history says of a check of the result in a file."""
    lengths = [rms for _, rms, unit in check.before if unit == "m"]
    return {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "unchanged": check.unchanged,
        "p": check.p,
        "changed": [change.what for change in check.changed],
        "by": [
            {unit: shown(amount, unit) for unit, (amount, _) in change.amounts.items()}
            for change in check.changed
        ],
        "rms_mm": shown(lengths[0], _LENGTH) if lengths else None,
        "rows": check.rows,
        "bad_rows": len(check.bad_rows),
        "samples": [path.name for path in samples],
        "result_sha256": sha256(read_input(result)).hexdigest(),
    }


_LENGTH: Final[Unit] = "m"


def remembered(check: Check, samples: Sequence[Path], result: Path) -> Check:
    """A check that has its line beside the result, or a note that this could not be written."""
    notes, line = list[str](), line_of(check, samples, result)
    # A folder that nobody may write to is checked all the same.
    attempt("written: the history", lambda: remember(result.parent, line), None, notes)
    return replace(check, notes=(*check.notes, *notes))


def remember(folder: Path, line: Mapping[str, Any]) -> Path:
    """Add a line to the history in a folder.

    Raises:
        OutputError: it cannot be written.
    """
    file = folder / NAME
    try:
        with file.open("a", encoding="utf-8") as history:
            history.write(json.dumps(line) + "\n")
    except OSError as error:
        raise OutputError(f"{file}: not written: {error.strerror or error}") from None
    return file


def recall(folder: Path) -> list[EarlierCheck]:
    """Earlier checks, first ones first; lines that are broken are left out."""
    try:
        text = (folder / NAME).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []
    found = []
    # Lines of a history that are looked at: one check a day for ten years.
    for line in text.splitlines()[-4000:]:
        try:
            entry = json.loads(line)
            rms = entry.get("rms_mm")
            found.append(
                EarlierCheck(
                    datetime.fromisoformat(entry["time"]),
                    bool(entry["unchanged"]),
                    float(entry["p"]),
                    tuple(map(str, entry.get("changed", []))),
                    math.nan if rms is None else from_mm(float(rms)),
                    str(entry.get("result_sha256", "")),
                )
            )
        except (ValueError, TypeError, KeyError, AttributeError):
            continue
    return found
