"""Report of a residual map: what left-out blocks say, the correction, and the files of it."""

from __future__ import annotations

from functools import partial
from typing import Final, NamedTuple

from suta_calib.analysis.residual_map import (
    JointCurve,
    LeftOut,
    MapCandidate,
    ResidualMap,
    Validated,
)
from suta_calib.analysis.residual_map.export import correction_record, python_text, table_text
from suta_calib.analysis.residual_map.plots import draw_residual_map, size_of
from suta_calib.analysis.residual_map.result import SORTS
from suta_calib.report.document import Document, Figure, File, Part
from suta_calib.report.listing import Column, Listing
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import unit_name

NAME: Final = "residual_map"
TITLE: Final = "What the calibration leaves"


class _Test(NamedTuple):
    """One test of a candidate."""

    candidate: MapCandidate
    test: LeftOut


TESTS: Final = Listing[_Test](
    "Error of the tip in left-out rows, without and with a map, mm",
    Column("sort", "map", lambda row: row.candidate.sort, cell=lambda row: SORTS[row[0].sort]),
    Column("by", "blocks by", lambda row: row.test.by),
    Column("blocks", "blocks", lambda row: row.test.blocks, form="d"),
    Column("before_rms", "without", lambda row: row.test.metrics[0].rms, "m"),
    Column("after_rms", "with", lambda row: row.test.metrics[1].rms, "m"),
    Column("p_value", "p", lambda row: row.test.p_value, form=".2g"),
    Column(
        "proven",
        "proven",
        lambda row: row.test.proven,
        cell=lambda row: "yes" if row.test.proven else "no",
    ),
    key="tests",
)


class _Validation(NamedTuple):
    """Validation rows of one row of the job."""

    candidate: MapCandidate
    rows: Validated


def _error(k: int, what: str) -> Column[_Validation]:
    """Validation errors without (0) or with (1) the map."""
    state, heading = ("before", "without") if k == 0 else ("after", "with")
    name = what.upper() if what == "rms" else what
    return Column(
        f"{state}_{what}",
        f"{name} {heading}",
        lambda row: float(getattr(row.rows.metrics[k], what)),
        "m",
    )


VALIDATION: Final = Listing[_Validation](
    "Error of the tip in validation rows, mm",
    Column("name", "rows", lambda row: row.rows.name),
    Column("count", "", lambda row: len(row.rows.before), form="d"),
    Column("sort", "map", lambda row: row.candidate.sort, cell=lambda row: SORTS[row[0].sort]),
    *(_error(k, what) for what in ("mean", "rms") for k in range(2)),
    key="validation",
)


def _largest(curve: JointCurve) -> float:
    return float(abs(curve.correction).max())


CURVES: Final = Listing[JointCurve](
    "Correction of each joint",
    Column("joint", "joint"),
    Column("largest", "largest", _largest, lambda curve: curve.unit, form=".4f"),
    Column("unit", "", lambda curve: unit_name(curve.unit)),
    Column("tip_rms", "at the tip, mm RMS", lambda curve: curve.tip, "m"),
    key="joints",
)


def residual_map_document(residual_map: ResidualMap) -> Document:
    """Tests, picture and correction; a Python file and a table where there is one."""
    record = correction_record(residual_map)
    tests = [_Test(c, test) for c in residual_map.tried for test in c.tests]
    validated = [_Validation(c, rows) for c in residual_map.tried for rows in c.validated]
    parts: list[Part] = [
        Figure(
            partial(residual_map_plot, residual_map),
            "Left-out errors before and after the correction; its size over two joints, the others "
            "as they mostly were; what to add to each joint (shaded: ± 2 standard deviations).",
        ),
        TESTS.of(tests),
        VALIDATION.of(validated),
        CURVES.of(residual_map.curves),
    ]
    if record is not None:
        parts.append(File(f"{NAME}.py", partial(python_text, record)))
        parts.append(File(f"{NAME}.csv", partial(table_text, record)))
    data = {
        "used": residual_map.used,
        "rows": len(residual_map.residuals),
        "gross_rows": residual_map.residuals.gross,
        "correction": record,
    }
    return Document(NAME, TITLE, residual_map.assessment, parts, data)


def residual_map_plot(residual_map: ResidualMap, name: str = NAME) -> str:
    """An SVG: left-out errors, the map over two joints, and the curves of joints."""
    with picture(name, size_of(residual_map)) as figure:
        draw_residual_map(figure, residual_map)
        return svg_text(figure, name, "Left-out errors of the tip, and the correction")
