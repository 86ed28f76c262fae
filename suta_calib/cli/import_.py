"""``suta-calib import``: files of other programs as samples or poses CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from suta_calib.atomic import check_outputs
from suta_calib.cli._formats import format_options, with_file
from suta_calib.cli._options import PATH, WRITTEN, flag, option
from suta_calib.cli._output import answer_command
from suta_calib.exchange.reader import import_formats, read_foreign
from suta_calib.report.document import Document
from suta_calib.report.exchange import formats_document, imported_document


@answer_command
@click.argument("source", type=PATH, metavar="SOURCE", required=False)
@option("--format NAME", "Of SOURCE; recognised without.", name="form")
@option("--out FILE.csv", "What to write.", WRITTEN, name="file")
@flag("--list", "Name the formats and what they read.", name="listed")
@option("--mapping FILE.yaml", "Options of the format, in a file.", PATH)
@format_options(import_formats().values())
def import_(
    source: Path | None,
    form: str | None,
    file: Path | None,
    listed: bool,
    mapping: Path | None,
    **options: Any,
) -> Document:
    """Turn SOURCE, a file of another program, into a samples or poses CSV.

    The options behind --mapping are those of the formats; --list names the formats, with an
    example of each. Lengths come out in m and angles in rad. A file that may be understood in
    several ways is refused, with the options that settle it; --guess takes the likeliest and says
    so. Without --out nothing is written: what would be is shown.
    """
    if listed:
        return formats_document(import_formats(), "What can be read")
    if source is None:
        raise click.UsageError("found no SOURCE; expected a file, or --list for the formats")
    if file is not None:
        check_outputs([file], [source, mapping])
    imported = read_foreign(source, form, **with_file(options, mapping))
    if file is not None:
        imported.write(file)
    return imported_document(imported, file)
