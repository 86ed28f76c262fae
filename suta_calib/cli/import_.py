"""``suta-calib import``: files of other programs as samples or poses CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from suta_calib.atomic import check_outputs
from suta_calib.cli._formats import format_options, with_file
from suta_calib.cli._options import PATH, WRITTEN, flag, option, optional_arm, urdf_option
from suta_calib.cli._output import answer_command
from suta_calib.exchange.aligned_rows import aligned
from suta_calib.exchange.pose_table import read_without_options
from suta_calib.exchange.reader import TABLE, import_formats, read_foreign, recognised
from suta_calib.inputs import UrdfFile
from suta_calib.report.document import Document
from suta_calib.report.exchange import formats_document, imported_document


@answer_command
@click.argument("source", type=PATH, metavar="SOURCE", required=False)
@option("--format NAME", "Format of SOURCE; default: recognised from the file.", name="form")
@option("--out FILE.csv", "File to write.", WRITTEN, name="file")
@flag("--list", "List the formats, with an example of each.", name="listed")
@option("--mapping FILE.yaml", "File with options of the format.", PATH)
@option(
    "--align OTHER",
    "Second recording of the same motion, with a clock of its own, to join with SOURCE.",
    PATH,
)
@urdf_option("URDF of the arm whose joint readings SOURCE has (with --align).")
@option("--tip", "Link or frame that is rigidly connected to what OTHER saw (with --align).")
@option("--base", "First link of the chain (with --align); default: the root link.")
@format_options(import_formats().values())
def import_(
    source: Path | None,
    form: str | None,
    file: Path | None,
    listed: bool,
    mapping: Path | None,
    align: Path | None,
    urdf: UrdfFile | None,
    tip: str | None,
    base: str | None,
    **options: Any,
) -> Document:
    """Convert SOURCE, a file of another program, into a samples or poses CSV.

    The options after --mapping belong to the formats; --list shows the formats with an example of
    each. Lengths are converted to m and angles to rad. If a file can be interpreted in several
    ways, it is refused, and the message names the options to give; --guess chooses the likeliest
    and shows it. Without --out nothing is written, and only a summary is shown.

    With --align, SOURCE and OTHER are recordings of one motion with two clocks. The shift and the
    drift between the clocks are found from the motion itself, and one file is written: of poses,
    columns a_… (SOURCE) and b_… (OTHER); of joint readings (with --urdf and --tip) samples with
    the poses of OTHER. OTHER is read without options: import it by itself first if it needs any.
    """
    if listed:
        return formats_document(import_formats(), "Formats that can be read")
    if source is None:
        raise click.UsageError("found no SOURCE; expected a file, or --list for the formats")
    if file is not None:
        check_outputs([file], [source, mapping, align])
    arm = optional_arm(urdf, tip, base, "is rigidly connected to what OTHER saw")
    if arm is not None and align is None:
        raise click.UsageError("--urdf and --tip are for --align OTHER")
    given = with_file(options, mapping)
    if arm is not None and (form or recognised(source).name) == TABLE:
        given = {"joints": arm.joints, **given}
    imported = read_foreign(source, form, **given)
    if align is not None:
        imported = aligned(imported, read_without_options(align), arm)
    if file is not None:
        imported.write(file)
    return imported_document(imported, file)
