"""An uncertainty budget as a table and as JSON."""

from __future__ import annotations

from typing import Final

from suta_calib.report.listing import Column, Json, Listing, Place, Table, written
from suta_calib.trust.uncertainty_budget import COVERAGE, Contribution, UncertaintyBudget
from suta_calib.units import Unit


def _contributions(unit: Unit) -> Listing[Contribution]:
    return Listing[Contribution](
        "",
        Column("source", "source"),
        Column("evaluation", "type"),
        Column("std", "standard uncertainty", unit=unit),
        Column("freedom", "degrees of freedom", form=".0f"),
        Column("student"),
        strong=lambda row: row.source == "combined",
    )


_BUDGET: Final = Listing[UncertaintyBudget](
    "",
    *written("of", "name"),
    Column("std", unit=lambda row: row.unit),
    Column("freedom"),
    Column("coverage_factor", value=lambda row: row.factor),
    Column("coverage", value=lambda _: COVERAGE, unit="%"),
    Column("expanded", unit=lambda row: row.unit),
)


def budget_record(budget: UncertaintyBudget) -> Json:
    """A budget as JSON has it."""
    return {
        **_BUDGET.record(budget),
        "contributions": _contributions(budget.unit).records(budget.contributions),
    }


def budget_table(budget: UncertaintyBudget, title: str, place: Place = "page") -> Table:
    """A budget as a table, with the combined standard uncertainty as its last row."""
    rows = [*budget.contributions, budget.combined]
    return _contributions(budget.unit).of(rows, title, place=place)
