"""Two arms on the same held-out data, told."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Final

from suta_calib.analysis.comparison import ArmComparison
from suta_calib.report.document import Document, Text
from suta_calib.report.errors import accuracy_json, errors_table

NAME: Final = "validation"


def comparison_document(found: ArmComparison, own: Path, given: Path) -> Document:
    """A comparison to be shown; the figures of ``validation`` are those of the first term's kind.

    Args:
        found: errors with either arm.
        own: the job's URDF.
        given: the other one.
    """
    own, given = plain(own), plain(given)
    terms = found.terms
    by_term = [{"kind": term.term.kind} | accuracy_json([term]) for term in terms]
    told = math.isfinite(found.gain.significance)
    metrics = {
        "validation": {
            **accuracy_json(terms),
            "gain_standard_errors": found.gain.significance if told else None,
            "by_term": by_term,
        }
    }
    return Document(
        NAME,
        "Validation",
        found.assessment,
        [
            errors_table({"validation": terms}),
            Text(f"before: {own}\nafter:  {given}", look="verbatim"),
        ],
        {"urdf": str(given), "metrics": metrics},
    )


def plain(path: Path) -> Path:
    """A path without the folders that it enters only to leave them, where it is the same file."""
    short = Path(os.path.normpath(path))
    return short if short.exists() and short.samefile(path) else path
