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
@option("--format NAME", "Format of SOURCE; default: recognised from the file.", name="form")
@option("--out FILE.csv", "File to write.", WRITTEN, name="file")
@flag("--list", "List the formats, with an example of each.", name="listed")
@option("--mapping FILE.yaml", "File with options of the format.", PATH)
@format_options(import_formats().values())
def import_(
    source: Path | None,
    form: str | None,
    file: Path | None,
    listed: bool,
    mapping: Path | None,
    **options: Any,
) -> Document:
    """Convert SOURCE, a file of another program, into a samples or poses CSV.

    The options after --mapping belong to the formats; --list shows the formats with an example of
    each. Lengths are converted to m and angles to rad. If a file can be interpreted in several
    ways, it is refused, and the message names the options to give; --guess chooses the likeliest
    and shows it. Without --out nothing is written, and only a summary is shown.
    """
    if listed:
        return formats_document(import_formats(), "Formats that can be read")
    if source is None:
        raise click.UsageError("found no SOURCE; expected a file, or --list for the formats")
    if file is not None:
        check_outputs([file], [source, mapping])
    imported = read_foreign(source, form, **with_file(options, mapping))
    if file is not None:
        imported.write(file)
    return imported_document(imported, file)
