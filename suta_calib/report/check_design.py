"""Report of measurements that would show most of what may have changed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.check.design import CheckDesign
from suta_calib.report.check import POWER
from suta_calib.report.document import Document, File, Part, Text
from suta_calib.report.listing import Column, Listing
from suta_calib.units import deg, mm
from suta_calib.words import enumerated

NAME: Final = "plan_check"


@dataclass(frozen=True, eq=False)
class _Chosen:
    """One measurement.

    Attributes:
        name: of the candidate.
        sort: what it is.
        readings: (joints,) of its first row, rad or m.
        shown: the same for a reader, degrees or mm.
        evidence: expected of it and of those before it.
    """

    name: str
    sort: str
    readings: FloatArray
    shown: str
    evidence: float


CHOSEN: Final = Listing[_Chosen](
    "What to measure, the most telling first",
    Column("name", "name"),
    Column("sort", "what"),
    Column("readings", "joints, ° or mm", cell=lambda row: row.shown),
    Column("evidence", "evidence", form=".1f"),
    key="chosen",
)


def check_design_document(design: CheckDesign) -> Document:
    """Document of a design: the postures, and what they would show together."""
    units = design.situation.arm.units
    sliding = np.array([units[joint] == "m" for joint in design.situation.arm.joints])
    rows = []
    for candidate, evidence in zip(design.chosen, design.evidence.tolist(), strict=True):
        first = candidate.q[0]
        numbers = np.where(sliding, mm(first), deg(first))
        written = ", ".join(f"{number:.1f}" for number in numbers)
        rows.append(_Chosen(candidate.name, candidate.sort, first, written, evidence))
    sentence = f"{enumerated([row.name for row in rows])} would show most of what may have changed"
    parts: list[Part] = [CHOSEN.of(rows), POWER.of(design.power), *_more(design)]
    return Document(NAME, "What to measure for a check", Assessment.of(sentence), parts)


def _more(design: CheckDesign) -> Iterator[Part]:
    yield Text(
        "Each is found with 90 % probability, wherever it points, if these are measured and "
        "checked together. A dash: a change in some direction does not show."
    )
    rows = [
        ",".join((candidate.name, *(f"{reading:.6f}" for reading in row)))
        for candidate in design.chosen
        for row in candidate.q
    ]
    header = ",".join(("name", *design.situation.arm.joints))
    yield File(f"{NAME}.csv", lambda: "\n".join((header, *rows, "")))
