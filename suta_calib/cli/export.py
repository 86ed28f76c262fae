"""``suta-calib export``: a result in the formats of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from suta_calib.atomic import check_outputs
from suta_calib.cli._formats import format_options, with_file
from suta_calib.cli._options import (
    PATH,
    WRITTEN,
    anyway_option,
    chain_option,
    flag,
    option,
    urdf_option,
)
from suta_calib.cli._output import answer_command
from suta_calib.exchange.result import read_result
from suta_calib.exchange.writer import export_formats, write_foreign
from suta_calib.inputs import UrdfFile
from suta_calib.report.document import Document
from suta_calib.report.exchange import exported_document, formats_document


@answer_command
@click.argument("result", type=PATH, metavar="RESULT", required=False)
@option("--format NAME", "Format to write; --list shows all formats.", name="form")
@option("--out FILE", "File to write; default: next to the result.", WRITTEN, name="file")
@flag("--list", "List the formats.", name="listed")
@urdf_option("The nominal arm, if the job of the result no longer exists.")
@chain_option
@option("--tip", "With --urdf: link or frame of the tip.")
@option("--base", "With --urdf: first link of the chain; default: the root.")
@anyway_option
@format_options(export_formats().values())
def export(
    result: Path | None,
    form: str | None,
    file: Path | None,
    listed: bool,
    urdf: UrdfFile | None,
    chain: str,
    tip: str | None,
    base: str | None,
    anyway: bool,
    **options: Any,
) -> Document:
    """Write RESULT (a folder of results, or its result.json) in the format of another program.

    For the formats of a camera, RESULT is also a folder of detect --report, or a camera.yaml.

    The options after --anyway belong to the formats. Values that a format cannot contain
    (covariance, eccentricity, compliance, gain) are reported and written to a second file. A result
    that must not be used is refused. Of a robot with several chains, mjcf, dh and lerobot contain
    one: name it with --chain. The other formats contain all.
    """
    if listed:
        return formats_document(export_formats(), "Formats that can be written")
    if result is None or form is None:
        missing = "RESULT" if result is None else "--format"
        raise click.UsageError(f"found no {missing}; expected RESULT --format NAME, or --list")
    read = read_result(result, urdf=urdf, tip=tip, base=base, chain=chain, anyway=anyway)
    exported = write_foreign(read, form, **with_file(options, None))
    place = read.path.with_name(exported.file) if file is None else file
    check_outputs([place], [read.path, urdf])
    return exported_document(exported, exported.write(place))
