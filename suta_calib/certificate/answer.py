"""An answer that can be certified: `CertifiedAnswer`, one file each in ``answers/``."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from suta_calib.certificate.content import CertifiedValue, Content
from suta_calib.errors import InputError
from suta_calib.registry import classes_of
from suta_calib.trust.uncertainty_budget import Contribution, UncertaintyBudget, coverage_factor
from suta_calib.units import SHOWN, Unit, stored

Record = Mapping[str, Any]


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
    expected = f"an answer of {', '.join(sorted(every))}"
    raise InputError("an answer that has no certificate", expected, file=path)


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
    unit: Unit = "m" if "std_mm" in entry else "rad"
    parts = tuple(
        Contribution(
            str(part["source"]),
            part["evaluation"],
            si(part, "std", unit),
            math.inf if part["freedom"] is None else float(part["freedom"]),
        )
        for part in entry["contributions"]
    )
    return UncertaintyBudget(str(entry["of"]), unit, parts)


def factor_of(found: Sequence[UncertaintyBudget]) -> float:
    """Coverage factor of estimates whose scatter has the degrees of freedom of a budget's."""
    freedom = [part.freedom for budget in found for part in budget.contributions]
    return coverage_factor(min(freedom, default=math.inf))


def scales(record: Record) -> tuple[str, ...]:
    """What gave the lengths of a calibration their unit, in words."""
    words = []
    for row in record.get("scale") or ():
        name = "" if row.get("name") in (None, "", "default") else f" {row['name']}"
        graded = f", {row['grade']}" if row.get("grade") else ""
        words.append(
            f"{row['carrier']}{name}{graded}: standard uncertainty of its scale "
            f"{float(row['ppm']):,.4g} ppm"
        )
    return tuple(words)
