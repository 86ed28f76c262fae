"""An answer that can be certified: `CertifiedAnswer`, one file each in ``answers/``."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final, get_args

from suta_calib.certificate.content import CertifiedValue, Content
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


def judged_budgets(found: Sequence[UncertaintyBudget]) -> dict[str, CertifiedValue]:
    """The expanded uncertainties, which may be given limits, such as ``U_X_mm`` and ``U_X_deg``."""
    return {
        key(f"U_{budget.name}".replace(" ", "_"), budget.unit): CertifiedValue(
            f"U of {budget.of}", budget.expanded, budget.unit
        )
        for budget in found
    }


def judged_rms(record: Record) -> dict[str, CertifiedValue]:
    """Residuals, which may be given limits; U is how well so many rows tell a root mean square."""
    judged, count = dict[str, CertifiedValue](), max(float(record["counts"]["inliers"]), 1.0)
    kinds: tuple[tuple[str, str, Unit], ...] = (
        ("rms_mm", "residuals, RMS", "m"),
        ("rms_deg", "residuals in angle, RMS", "rad"),
        ("reprojection_rms_px", "reprojection, RMS", "px"),
    )
    for told, words, unit in kinds:
        # Beside pixels the other residuals are of the poses of single pictures.
        if record.get(told) is not None and (unit == "px") == ("reprojection_rms_px" in record):
            rms = float(stored(float(record[told]), unit))
            judged[told] = CertifiedValue(words, rms, unit, rms / (2.0 * count) ** 0.5)
    return judged


def scale_of(carrier: str, ppm: float | None) -> str:
    """What a carrier of lengths adds to every U, or that it adds nothing."""
    if not ppm:
        return not_stated(f"scale of the {carrier}")
    return f"{carrier}: standard uncertainty of its scale {float(ppm):,.4g} ppm, included in U"


def not_stated(what: str) -> str:
    """Of a reference whose uncertainty nobody stated."""
    return f"{what}: its uncertainty is not stated, and U does not include it"


def scales(record: Record) -> tuple[str, ...]:
    """What gave the lengths of a calibration their unit, in words."""
    words = []
    for row in record.get("scale") or ():
        name = "" if row.get("name") in (None, "", "default") else f" {row['name']}"
        graded = f", {row['grade']}" if row.get("grade") else ""
        words.append(scale_of(f"{row['carrier']}{name}{graded}", row["ppm"]))
    return tuple(words) or (not_stated("scale of all lengths"),)
