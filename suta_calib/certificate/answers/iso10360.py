"""An acceptance test by ISO 10360-12 on paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from suta_calib.certificate.answer import CertifiedAnswer, Record, not_stated
from suta_calib.certificate.content import (
    CertifiedValue,
    Content,
    Decision,
    Outcome,
    Reference,
    ValueTable,
)
from suta_calib.certificate.lengths import LengthUncertainty
from suta_calib.units import from_mm

# Of the answer's words.
OUTCOMES: Final[dict[str, Outcome]] = {"pass": "conforms", "fail": "does not conform"}


class AcceptanceOnPaper(CertifiedAnswer):
    """What ``iso10360`` wrote."""

    name = "iso10360"
    mark = "characteristics"

    def content(self, record: Record) -> Content:
        """Every characteristic with its limit and decision, as the test took it."""
        rows, decisions = list[CertifiedValue](), list[Decision]()
        for entry in record["characteristics"]:
            value = from_mm(float(entry["value_mm"]))
            stated = entry["expanded_uncertainty_mm"]
            std = from_mm(float(stated)) / 2.0 if stated else None
            where = f"at {entry['where']}" if entry.get("where") else ""
            rests_on = (_reference(str(entry["symbol"])),)
            row = CertifiedValue(entry["symbol"], value, "m", std, 2.0, where, rests_on)
            rows.append(row)
            if entry.get("limit_mm") is not None:
                limit = from_mm(float(entry["limit_mm"]))
                outcome = OUTCOMES.get(str(entry["decision"]), "no decision")
                decisions.append(Decision(row, limit, outcome).known())
        rule = record["decision_rule"]
        return Content(
            title="Acceptance test of an articulated arm coordinate measuring machine",
            measurand=f"Characteristics of {record['standard']}.",
            method=(f"After {record['standard']}, simplified where the notes say so."),
            groups=(ValueTable("Characteristics", tuple(rows)),),
            checked=(
                (
                    "lengths",
                    f"{record['lengths']['count']} measured, RMS error "
                    f"{record['lengths']['rms_mm']:.3f} mm",
                ),
            )
            if record.get("lengths")
            else (),
            decisions=tuple(decisions),
            rule=_rule(str(rule["kind"]), float(rule["factor"])),
            references=tuple(_references(rows)),
            notes=(*record.get("simplified", ()), *record["verdict"]["notes"]),
        )


def _rule(kind: str, factor: float) -> str:
    """Of the job, where it is not a guard band as wide as U."""
    if kind == "simple":
        return (
            "Decision rule: simple acceptance without a guard band (ISO 14253-6). A value conforms "
            "if |value| ≤ limit, whatever its U. Where U is not known, or lacks a source, no "
            "decision is made."
        )
    return (
        f"Decision rule: a guard band of {factor:g} standard uncertainties (ISO 14253-1). A value "
        "conforms if |value| + guard band ≤ limit. It does not conform if |value| - guard band > "
        "limit. Otherwise, and where U is not known or lacks a source, no decision is made."
    )


def _reference(symbol: str) -> str:
    """Which reference a characteristic rests on."""
    of = {"E": "artefact", "P": "sphere"}
    return of.get(symbol.partition("_")[0], "point" if symbol.startswith("L_") else symbol)


def _references(rows: Sequence[CertifiedValue]) -> Iterator[Reference]:
    """Of every reference, its uncertainty in U: that of the characteristic where U is smallest."""
    for name in dict.fromkeys(name for row in rows for name in row.rests_on):
        mine = [row for row in rows if name in row.rests_on]
        told = [row for row in mine if row.std is not None]
        symbols = ", ".join(row.name for row in told)
        if told:
            yield Reference(
                name,
                f"{name} and what the job states of the test: their uncertainties are U of "
                f"{symbols}",
                LengthUncertainty(min(row.std or 0.0 for row in told)),
            )
        if missing := [row.name for row in mine if row.std is None]:
            # Theirs is unknown as a whole.
            yield not_stated("" if told else name, f"reference of {', '.join(missing)}")
