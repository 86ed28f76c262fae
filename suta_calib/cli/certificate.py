"""``suta-calib certificate``: an answer as a document to be signed and filed."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.atomic import check_outputs, exchange_files
from suta_calib.certificate.dcc import dcc_record
from suta_calib.certificate.details import details_to_fill_in, read_details
from suta_calib.certificate.issued import certificate_of
from suta_calib.certificate.paper import Paper, pdf_bytes
from suta_calib.cli._options import PATH, WRITTEN, option
from suta_calib.cli._output import answer_command
from suta_calib.exchange.result import json_bytes
from suta_calib.measurements.files import write_text
from suta_calib.report.certificate import certificate_document, details_document
from suta_calib.report.document import Document


@answer_command
@click.argument("result", type=PATH, metavar="RESULT", required=False)
@option(
    "--out FILE.pdf", "The document; the same as JSON is written beside it.", WRITTEN, name="file"
)
@option("--details FILE.yaml", "What the laboratory adds: item, standards, conditions.", PATH)
@option("--new-details FILE.yaml", "Write such a file to fill in, and nothing else.", WRITTEN)
@option("--font FILE.ttf", "Font for signs that DejaVu Sans lacks, such as Chinese ones.", PATH)
@option("--paper", "Size of the pages.", click.Choice(("a4", "letter")), "a4")
def certificate(
    result: Path | None,
    file: Path | None,
    details: Path | None,
    new_details: Path | None,
    font: Path | None,
    paper: Paper,
) -> Document:
    """Write a certificate of RESULT (a folder of results, or a JSON file in it) as a PDF.

    RESULT is an answer of calibrate, hand-eye, rig, detect (a camera), pivot, register, certify,
    iso10360 or repeatability.
    The certificate states measurand, method, conditions, reference standards, results with expanded
    uncertainty (k = 2), uncertainty budget, validation and conformity with limits, after ISO/IEC
    17025 and the GUM. All figures are those of RESULT. What only the laboratory knows is read from
    --details; what it does not state is left blank. A result that must not be used, or that was
    changed since it was written, is refused.
    """
    if new_details is not None:
        check_outputs([new_details], [result, details])
        write_text(new_details, details_to_fill_in())
        return details_document(new_details)
    if result is None or file is None:
        missing = "RESULT" if result is None else "--out"
        raise click.UsageError(f"found no {missing}; expected RESULT --out certificate.pdf")
    if file.suffix.lower() != ".pdf":
        raise click.UsageError(f"found --out {file}; expected a name that ends in .pdf")
    issued = certificate_of(result, None if details is None else read_details(details))
    beside = file.with_suffix(".json")
    check_outputs([file, beside], [issued.result, details, font])
    record = dcc_record(issued)
    contents = {beside.name: json_bytes(record), file.name: pdf_bytes(issued, paper, font)}
    exchange_files(file.parent, contents)
    return certificate_document(issued, (file, beside))
