"""``suta-calib init``: the files of a new job."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.atomic import check_folder
from suta_calib.cli._options import PATH, option
from suta_calib.job.new_job import DEFAULT_KINDS, new_job, write_job
from suta_calib.model.chain import ends, read_chain
from suta_calib.model.urdf_tree import read_tree


@click.command()
@click.argument("urdf", type=PATH, metavar="URDF")
@option("--tip", "Link or frame whose pose matters; without it the ends are listed.")
@option("--base", "Link the chain starts from; the root link by default.")
@option("--out", "Folder of the job; here.", PATH, ".", show_default=False)
@option(
    "--kind",
    "Kind of observation; may be repeated. Distances on an artefact and a point that is "
    "touched from many directions by default.",
    name="kinds",
    multiple=True,
)
def init(urdf: Path, tip: str | None, base: str | None, out: Path, kinds: tuple[str, ...]) -> None:
    """Start a job for the arm in URDF: commented files to fill in. Overwrites nothing."""
    if tip is None:
        tree = read_tree(urdf)
        raise click.UsageError(f"found no --tip; expected a link or joint of {urdf}; {ends(tree)}")
    for note in read_chain(urdf, tip, base).notes:
        click.echo(f"{urdf}: {note}.", err=True)
    files = new_job(urdf, tip, out, base=base, kinds=kinds or DEFAULT_KINDS)
    check_folder(out)
    write_job(files)
    for file in files:
        click.echo(file.path)
    click.echo(f"Next: fill in the samples, then suta-calib observe {files[0].path}")
