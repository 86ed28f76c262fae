"""Report of a check: whether a calibration is still right, what changed, what would have shown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

from suta_calib import report
from suta_calib.check import Check, FoundChange, FoundPower
from suta_calib.check.history import EarlierCheck
from suta_calib.report.document import Document, Figure, Part, remark, section
from suta_calib.report.listing import Column, Json, Listing, Table
from suta_calib.units import NOTHING, Unit, text, unit_name

NAME: Final = "check"


def _of(amounts: FoundChange | FoundPower, unit: Unit, part: int = 0) -> float | None:
    amount = amounts.amounts.get(unit)
    number = amount[part] if isinstance(amount, tuple) else amount
    return number if number is not None and math.isfinite(number) else None


def _change(row: FoundChange, unit: Unit) -> str:
    amount = row.amounts.get(unit)
    if amount is None:
        return NOTHING
    return f"{text(amount[0], unit)} ± {text(amount[1], unit)}"


def _chance(p: float) -> str:
    # Below it a digit says nothing.
    least = 1e-6
    return f"{p:.2g}" if p >= least else f"< {least:g}"


CHANGED: Final = Listing[FoundChange](
    "What changed",
    Column("what", "what"),
    Column("by", "moved, mm", partial(_of, unit="m"), "m", cell=partial(_change, unit="m")),
    Column("by", "turned, °", partial(_of, unit="rad"), "rad", cell=partial(_change, unit="rad")),
    Column("std", None, partial(_of, unit="m", part=1), "m"),
    Column("std", None, partial(_of, unit="rad", part=1), "rad"),
    Column("by_ratio", None, partial(_of, unit="1"), optional=True),
    Column("by_px", None, partial(_of, unit="px"), optional=True),
    Column(
        "at_tip", "at the tip, mm", lambda row: None if math.isnan(row.at_tip) else row.at_tip, "m"
    ),
    Column("p", "p", cell=lambda row: _chance(row.p)),
    Column("since", "from row", lambda row: row.since or None, optional=True),
    Column("instead", "or", lambda row: list(row.instead), cell=lambda row: ", ".join(row.instead)),
)
POWER: Final = Listing[FoundPower](
    "What these rows would have shown",
    Column("what", "a change of"),
    Column("by", "moved, mm", partial(_of, unit="m"), "m"),
    Column("by", "turned, °", partial(_of, unit="rad"), "rad"),
    Column("by_ratio", "factor", partial(_of, unit="1"), form=".5f", optional=True),
    Column("by_px", "px", partial(_of, unit="px"), form=".2f", optional=True),
)
ERRORS: Final = Listing[tuple[str, float, float, Unit]](
    "Errors of the new rows, RMS",
    Column("kind", "kind", lambda row: row[0]),
    Column("before", "as calibrated", lambda row: row[1], lambda row: row[3]),
    Column("after", "with what changed", lambda row: row[2], lambda row: row[3]),
    Column("", "unit", lambda row: unit_name(row[3])),
)


def check_document(check: Check, title: str, history: Sequence[EarlierCheck] = ()) -> Document:
    """Document of a check of a calibration, with the history of earlier ones."""
    parts = [
        *section("what changed", lambda: _changed(check)),
        *section("power", lambda: _power(check)),
        *section("history", lambda: _history(history)),
    ]
    return Document(NAME, f"Check of {title}", check.assessment, parts, _data(check))


def _changed(check: Check) -> Iterator[Part]:
    if check.changed:
        yield CHANGED.of(check.changed)
    yield errors_of(check)


def errors_of(check: Check) -> Table:
    """Errors of the rows, with the calibration as it was and with what changed."""
    return ERRORS.of(error_rows(check))


def error_rows(check: Check) -> list[tuple[str, float, float, Unit]]:
    """Kind, RMS as calibrated and with what changed, and unit."""
    pairs = zip(check.before, check.after, strict=True)
    return [(kind, rms, after, unit) for (kind, rms, unit), (_, after, _) in pairs]


def _power(check: Check) -> Iterator[Part]:
    yield POWER.of(check.power, place="detail")
    yield remark(
        "The smallest change that these rows would have shown with 90 % probability, wherever it "
        "points. A dash: a change in some direction would not have shown."
    )


def _history(history: Sequence[EarlierCheck]) -> Iterator[Part]:
    if len(history) > 1:
        draw = partial(report.check_history_plot, history)
        yield Figure(draw, f"Checks so far ({len(history)})")


def _data(check: Check) -> Json:
    return {
        "unchanged": check.unchanged,
        "changed": CHANGED.records(check.changed),
        "power": POWER.records(check.power),
        "p": check.p,
        "false_alarm": check.false_alarm,
        "rows": check.rows,
        "bad_rows": list(check.bad_rows),
    }
