"""What the console says of a certificate that was written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from suta_calib.assessment import Assessment
from suta_calib.certificate.content import Decision
from suta_calib.certificate.issued import Certificate
from suta_calib.report.document import Document, Part, Text
from suta_calib.report.listing import Column, Listing

NAME: Final = "certificate"
DECISIONS: Final = Listing[Decision](
    "Conformity",
    Column("name", "quantity", lambda row: row.quantity.name),
    Column("value", "value", lambda row: row.quantity.value, lambda row: row.quantity.unit),
    Column("expanded", "U", lambda row: row.quantity.expanded, lambda row: row.quantity.unit),
    Column("limit", "limit", unit=lambda row: row.quantity.unit),
    Column("outcome", "decision", cell=lambda row: row.words),
    Column("because", None),
    key="decisions",
)


def certificate_document(certificate: Certificate, files: Sequence[Path]) -> Document:
    """Conformity, and which files were written."""
    parts: list[Part] = [
        DECISIONS.of(certificate.decisions),
        Text(f"Written: {', '.join(map(str, files))}"),
    ]
    data = {
        "number": certificate.number,
        "missing": certificate.missing,
        "files": [*map(str, files)],
    }
    return Document(NAME, certificate.content.title, certificate.assessment, parts, data, "files")


def details_document(file: Path) -> Document:
    """That a file to fill in was written."""
    words = f"written: {file}. Fill it in, and give it with --details."
    return Document(NAME, "Details", Assessment.of(words), (), {"file": str(file)}, "files")
