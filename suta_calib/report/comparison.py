"""Report that compares two arms on the same validation data."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Final

from suta_calib.analysis.comparison import ArmComparison
from suta_calib.report.document import Document, Text
from suta_calib.report.errors import accuracy_json, errors_table

NAME: Final = "validation"


def comparison_document(comparison: ArmComparison, before: Path, given: Path) -> Document:
    """Errors with the job's URDF, ``before``, and the ``given`` one; figures of the first kind."""
    before, given = plain(before), plain(given)
    terms = comparison.terms
    by_term = [{"kind": term.term.kind} | accuracy_json([term]) for term in terms]
    significant = math.isfinite(comparison.gain.significance)
    metrics = {
        "validation": {
            **accuracy_json(terms),
            "gain_standard_errors": comparison.gain.significance if significant else None,
            "by_term": by_term,
        }
    }
    return Document(
        NAME,
        "Validation",
        comparison.assessment,
        [
            errors_table({"validation": terms}),
            Text(f"before: {before}\nafter:  {given}", look="verbatim"),
        ],
        {"urdf": str(given), "metrics": metrics},
    )


def plain(path: Path) -> Path:
    """A path without the folders that it enters only to leave them, where it is the same file."""
    short = Path(os.path.normpath(path))
    return short if short.exists() and short.samefile(path) else path
