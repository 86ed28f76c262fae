"""``residuals.csv``: every error, before and after, with the samples it belongs to."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Final

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.accuracy import BlockErrors, TermAccuracy
from suta_calib.report.result import Result, labelled_terms
from suta_calib.units import shown, unit_name

COLUMNS: Final = (
    *("set", "kind", "label", "quantity", "what", "samples", "unit"),
    *("error_before", "error_after"),
    *(f"{axis}_{state}" for state in ("before", "after") for axis in ("c1", "c2", "c3")),
)


def residuals_csv(result: Result) -> str:
    """All residuals as CSV text, one row an observation.

    ``error_before|after`` are norms, ``c1|c2|c3_before|after`` the components with their signs
    (only ``c1`` for distances), all in the row's ``unit``, mm or deg. ``samples`` names the rows
    of the samples files, separated by a semicolon.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for name, rows in labelled_terms(result).items():
        for label, term in rows:
            writer.writerows([name, term.term.kind, label, *row] for row in _rows(term))
    return text.getvalue()


def _rows(term: TermAccuracy) -> Iterator[list[str]]:
    origin = term.term.poses.samples.origin
    for block in term.blocks:
        for k, what in enumerate(block.labels):
            samples = "; ".join(origin[i] for i in block.rows[k])
            yield [block.name, what, samples, *_numbers(block, k)]


def _numbers(block: BlockErrors, k: int) -> list[str]:
    unit = block.unit
    norms = [f"{shown(float(e[k]), unit):.6g}" for e in (block.before, block.after)]
    before, after = block.residual_before[k], block.residual_after[k]
    return [unit_name(unit), *norms, *_components(before, block), *_components(after, block)]


def _components(residual: FloatArray, block: BlockErrors) -> list[str]:
    found = [f"{shown(float(r), block.unit):.6g}" for r in residual]
    return found + [""] * (3 - len(found))
