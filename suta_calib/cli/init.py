"""``suta-calib init``: the files of a new job."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.atomic import check_folder
from suta_calib.cli._options import PATH, option
from suta_calib.job.arm_grade import ARM_GRADES, guessed_grade
from suta_calib.job.new_job import new_job, write_job
from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import ends
from suta_calib.model.urdf_tree import read_tree


@click.command()
@click.argument("urdf", type=PATH, metavar="URDF")
@option("--tip", "Link or frame whose pose matters; without it the ends are listed.")
@option("--base", "Link the chain starts from; the root link by default.")
@option("--out", "Folder of the job; here.", PATH, ".", show_default=False)
@option(
    "--kind",
    "Kind of observation; may be repeated. For a printed or hobby arm the crosses of a sheet by "
    "default; else distances on an artefact, and a point that is touched from many directions.",
    name="kinds",
    multiple=True,
)
@option(
    "--grade",
    "How the arm was made, which says how far its dimensions may be from the drawing; guessed "
    "from the URDF by default.",
    click.Choice([*ARM_GRADES]),
)
def init(
    urdf: Path,
    tip: str | None,
    base: str | None,
    out: Path,
    kinds: tuple[str, ...],
    grade: str | None,
) -> None:
    """Start a job for the arm in URDF: commented files to fill in. Overwrites nothing."""
    if tip is None:
        tree = read_tree(urdf)
        raise click.UsageError(f"found no --tip; expected a link or joint of {urdf}; {ends(tree)}")
    arm = ArmModel.from_urdf(urdf, tip, base)
    for note in arm.chain.notes:
        click.echo(f"{urdf}: {note}.", err=True)
    files = new_job(arm, out, kinds=kinds, grade=grade)
    check_folder(out)
    write_job(files)
    if grade is None:
        guess, reason = guessed_grade(arm)
        others = "|".join(name for name in ARM_GRADES if name != guess.name)
        click.echo(
            f"The arm's grade is taken to be {guess.name} ({guess.about}): {reason}. "
            f"If that is wrong, say --grade {others}.",
            err=True,
        )
    for file in files:
        click.echo(file.path)
    click.echo(f"Next: fill in the samples, then suta-calib observe {files[0].path}")
