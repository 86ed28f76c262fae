"""Held-out errors against their predicted standard deviations, told."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.job.calibration import Calibration
from suta_calib.report.listing import Column, Listing
from suta_calib.trust.held_out import PROBABILITIES, HeldOutErrors
from suta_calib.units import Unit, unit_name


@dataclass(frozen=True, eq=False)
class HeldOutRow:
    """Held-out errors of one block, and the label of the job's row.

    Attributes:
        label: of the row.
        errors: against their prediction.
    """

    label: str
    errors: HeldOutErrors

    @property
    def unit(self) -> Unit:
        """Of the errors: m or rad."""
        return self.errors.unit


def _of(kind: str, name: str) -> str:
    """What kind of observation, and what of it, where the kind does not say so already."""
    return kind if kind.endswith(name) else f"{kind} {name}"


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _within(probability: float) -> Column[HeldOutRow]:
    def shown(row: HeldOutRow) -> str:
        coverage = row.errors.coverage(probability)
        return f"{100 * coverage.share:.0f} ± {100 * coverage.std:.0f} %"

    return Column(
        f"within_{100 * probability:.0f}",
        f"within {100 * probability:.0f} %",
        lambda row: row.errors.coverage(probability).share,
        "%",
        cell=shown,
    )


HELD_OUT: Final = Listing[HeldOutRow](
    "Held-out errors, of one component, against what was predicted",
    Column(
        "kind",
        "of",
        lambda row: row.errors.term.kind,
        cell=lambda row: _of(row.errors.term.kind.replace("_", " "), row.errors.name),
    ),
    Column("label"),
    Column("block", None, lambda row: row.errors.name),
    Column("count", "count", lambda row: len(row.errors.residual)),
    Column("unit", "unit", cell=lambda row: unit_name(row.unit)),
    Column("std", "found", lambda row: _rms(row.errors.residual), lambda row: row.unit, si=True),
    Column(
        "predicted_std",
        "predicted",
        lambda row: _rms(row.errors.predicted),
        lambda row: row.unit,
        si=True,
    ),
    Column(
        "parameters_std",
        "by parameters",
        lambda row: _rms(row.errors.by_parameters),
        lambda row: row.unit,
        si=True,
    ),
    *map(_within, PROBABILITIES),
    Column("each_predicted_std", None, lambda row: row.errors.predicted),
    key="held_out",
)


def held_out_rows(result: Calibration) -> Iterator[HeldOutRow]:
    """Of every block that was held out; the solution has converged."""
    for label, term in result.labelled_terms["validation"]:
        errors = (
            errors_of_block
            for errors_of_block in result.examined.held_out
            if errors_of_block.term is term.term
        )
        yield from (HeldOutRow(label, error) for error in errors)
