"""An acceptance test by ISO 10360-12 on paper."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from suta_calib.certificate.answer import CertifiedAnswer, Record, not_stated
from suta_calib.certificate.content import CertifiedValue, Content, Decision, Outcome, ValueTable
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
            expanded = from_mm(float(entry["expanded_uncertainty_mm"] or 0.0))
            where = f"at {entry['where']}" if entry.get("where") else ""
            rows.append(CertifiedValue(entry["symbol"], value, "m", expanded / 2.0, 2.0, where))
            if entry.get("limit_mm") is not None:
                limit = from_mm(float(entry["limit_mm"]))
                outcome = OUTCOMES.get(str(entry["decision"]), "no decision")
                decisions.append(Decision(entry["symbol"], value, expanded, limit, "m", outcome))
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
            standards=tuple(_standards(record)),
            notes=(*record.get("simplified", ()), *record["verdict"]["notes"]),
        )


def _rule(kind: str, factor: float) -> str:
    """Of the job, where it is not a guard band as wide as U."""
    if kind == "simple":
        return (
            "Decision rule: simple acceptance without a guard band (ISO 14253-6). A value conforms "
            "if its size keeps the limit, whatever its uncertainty."
        )
    return (
        f"Decision rule: a guard band of {factor:g} standard uncertainties (ISO 14253-1). A value "
        "conforms if its size and the guard band together keep the limit. It does not conform if "
        "its size less the guard band exceeds the limit. Between them no decision is made."
    )


def _standards(record: Record) -> Iterator[str]:
    stated = [e["symbol"] for e in record["characteristics"] if e["expanded_uncertainty_mm"]]
    missing = [e["symbol"] for e in record["characteristics"] if not e["expanded_uncertainty_mm"]]
    if stated:
        yield (
            "artefact and what the job states of the test: their uncertainties are U of "
            f"{', '.join(stated)}"
        )
    if missing:
        yield not_stated(f"reference of {', '.join(missing)}")
