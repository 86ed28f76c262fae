"""An answer that can be certified: `CertifiedAnswer`, one file each in ``answers/``."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final, get_args

from suta_calib.certificate.content import CertifiedValue, Content, Reference
from suta_calib.certificate.lengths import LengthUncertainty
from suta_calib.errors import InputError
from suta_calib.registry import classes_of
from suta_calib.trust.uncertainty_budget import (
    Contribution,
    Evaluation,
    UncertaintyBudget,
    coverage_factor,
)
from suta_calib.units import SHOWN, Unit, key, stored

Record = Mapping[str, Any]


# Why other answers have none, and what to do, by a key that only their JSON has.
WITHOUT: Final = {
    "em_readings": "its posts and navigated points have no uncertainty budget: the distortion that "
    "is left in the tracker is validated, but in no ±. Certify the tools by pivot, and the "
    "registration by register",
    "calibrated": "its camera was given, or the pictures do not determine it: calibrate it from "
    "pictures, without --camera",
    "by_update_rate": "it compares two recordings, without an uncertainty of its own: certify the "
    "arm by repeatability, iso10360 or calibrate",
}
# Units of budgets.
BUDGETED: Final[tuple[Unit, ...]] = ("m", "rad", "px")


class CertifiedAnswer(ABC):
    """One kind of answer, read from the JSON that its command wrote.

    Attributes:
        name: of the command.
        mark: a key that only its JSON has.
    """

    name: ClassVar[str]
    mark: ClassVar[str]

    @abstractmethod
    def content(self, record: Record) -> Content:
        """What it says. Figures are those of the JSON: nothing is solved here.

        Raises:
            KeyError, TypeError, ValueError: the JSON is of an earlier version, or was changed.
        """


def answer_of(record: Record, path: Path) -> CertifiedAnswer:
    """The kind of an answer.

    Raises:
        InputError: of no kind that has a certificate.
    """
    every = known_answers()
    for answer in every.values():
        if answer.mark in record:
            return answer()
    known = (why for mark, why in WITHOUT.items() if mark in record)
    raise InputError(
        "an answer that has no certificate",
        f"an answer of {', '.join(sorted(every))}",
        file=path,
        hint=next(known, "give the result.json of the calibration or measurement itself"),
    )


def known_answers() -> Mapping[str, type[CertifiedAnswer]]:
    """Every kind, by its command."""
    return classes_of("suta_calib.certificate.answers", CertifiedAnswer)


# ── figures as JSON has them ─────────────────────────────────────────────────────────────────
def si(record: Record, key: str, unit: Unit) -> float:
    """A number under a key whose suffix tells the unit, in SI; nan for null."""
    found = record[key + SHOWN[unit].suffix]
    return math.nan if found is None else float(stored(float(found), unit))


def quantities(
    labels: Sequence[str],
    numbers: Sequence[float],
    stds: Sequence[float | None],
    unit: Unit,
    factor: float = 2.0,
) -> Iterator[CertifiedValue]:
    """Results of one unit, from numbers as JSON has them: the reader's unit."""
    for label, number, std in zip(labels, numbers, stds, strict=True):
        spread = None if std is None else float(stored(float(std), unit))
        yield CertifiedValue(label, float(stored(float(number), unit)), unit, spread, factor)


def budgets(record: Record) -> tuple[UncertaintyBudget, ...]:
    """The budgets that an answer wrote; none of an earlier version."""
    return tuple(_budget(entry) for entry in record.get("uncertainty") or ())


def _budget(entry: Record) -> UncertaintyBudget:
    unit: Unit = next(u for u in BUDGETED if f"std{SHOWN[u].suffix}" in entry)
    parts = tuple(
        Contribution(
            str(part["source"]),
            part["evaluation"],
            si(part, "std", unit),
            math.inf if part["freedom"] is None else float(part["freedom"]),
            bool(part.get("student", False)),
        )
        for part in entry["contributions"]
    )
    for part in parts:
        if part.evaluation not in get_args(Evaluation) or not part.std >= 0.0:
            raise ValueError(f"{part.source}: evaluation {part.evaluation}, std {part.std}")
    budget = UncertaintyBudget(str(entry["of"]), unit, parts, str(entry.get("name") or ""))
    if not math.isclose(budget.std, si(entry, "std", unit), rel_tol=1e-6):
        raise ValueError(f"contributions that do not give the standard uncertainty of {budget.of}")
    return budget


def factor_of(found: Sequence[UncertaintyBudget]) -> float:
    """Coverage factor of estimates whose scatter has the degrees of freedom of a budget's."""
    freedom = [part.uncertain for budget in found for part in budget.contributions]
    return coverage_factor(min(freedom, default=math.inf))


def judged_budgets(
    found: Sequence[UncertaintyBudget], references: Sequence[Reference]
) -> dict[str, CertifiedValue]:
    """The expanded uncertainties, which may be given limits, such as ``U_X_mm`` and ``U_X_deg``.

    Those of lengths rest on the references; turns do not.
    """
    return {
        key(f"U_{budget.name}".replace(" ", "_"), budget.unit): CertifiedValue(
            *(f"U of {budget.of}", budget.expanded, budget.unit),
            rests_on=tuple(one.name for one in references) if budget.unit == "m" else (),
            is_uncertainty=True,
        )
        for budget in found
    }


def judged_rms(record: Record) -> dict[str, CertifiedValue]:
    """Residuals, which may be given limits; U is how well so many rows tell a root mean square."""
    judged, count = dict[str, CertifiedValue](), max(float(record["counts"]["inliers"]), 1.0)
    kinds: tuple[tuple[str, str, Unit], ...] = (
        ("rms_mm", "residuals in position, RMS", "m"),
        ("rms_deg", "residuals in angle, RMS", "rad"),
        ("reprojection_rms_px", "reprojection, RMS", "px"),
    )
    for told, words, unit in kinds:
        # Beside pixels the other residuals are of the poses of single pictures.
        if record.get(told) is not None and (unit == "px") == ("reprojection_rms_px" in record):
            rms = float(stored(float(record[told]), unit))
            judged[told] = rms_value(words, rms, unit, count)
    return judged


def rms_value(
    name: str, rms: float, unit: Unit, count: float, rests_on: tuple[str, ...] = ()
) -> CertifiedValue:
    """A root mean square with how well so many numbers tell it."""
    about = (
        f"U is 2 RMS/√(2 × {count:.0f}), how well {count:.0f} independent errors tell a root mean "
        "square; an error that all of them share is not in it"
    )
    return CertifiedValue(name, rms, unit, rms / (2.0 * count) ** 0.5, 2.0, about, rests_on)


def scale_of(
    name: str, ppm: float | None, carrier: str = "", what: str = "scale", more: str = ""
) -> Reference:
    """A reference of which the scale is in every U, or is not.

    Args:
        name: of the reference, in a word.
        ppm: standard uncertainty of its scale; nothing where nobody stated it.
        carrier: what it is called on paper; its name by default.
        what: is uncertain.
        more: said at the end.
    """
    carrier = carrier or name
    if not ppm:
        return not_stated(name, f"{what} of the {carrier}")
    return Reference(
        name,
        f"{carrier}: standard uncertainty of its {what} {float(ppm):,.4g} ppm, included in U{more}",
        LengthUncertainty(per_length=1e-6 * float(ppm)),
    )


def not_stated(name: str, what: str) -> Reference:
    """A reference whose uncertainty nobody stated."""
    return Reference(name, f"{what}: its uncertainty is not stated, and U does not include it")


def scales(record: Record) -> tuple[Reference, ...]:
    """What gave the lengths of a calibration their unit."""
    references, rows = [], record.get("scale") or ()
    carriers = [str(row["carrier"]) for row in rows]
    for row in rows:
        name = "" if row.get("name") in (None, "", "default") else f" {row['name']}"
        graded = f", {row['grade']}" if row.get("grade") else ""
        carrier = str(row["carrier"])
        # A standard is of one of several by its own name.
        short = carrier if carriers.count(carrier) == 1 else str(row.get("name") or carrier)
        references.append(scale_of(short, row["ppm"], f"{carrier}{name}{graded}"))
    return tuple(references) or (not_stated("lengths", "scale of all lengths"),)
