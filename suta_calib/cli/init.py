"""``suta-calib init``: the files of a new job."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from shlex import quote

import click

from suta_calib.atomic import check_folder
from suta_calib.cli._options import PATH, option, urdf_argument
from suta_calib.errors import InputError
from suta_calib.exchange.imported import ImportedFile
from suta_calib.exchange.reader import read_foreign
from suta_calib.exchange.recognition import recognised_format
from suta_calib.inputs import UrdfFile, XacroFile
from suta_calib.job.arm_grade import ARM_GRADES, guessed_grade
from suta_calib.job.new_job import Template, new_job, write_job
from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import ends, other_chains
from suta_calib.model.robot import AnyArm, Robot
from suta_calib.model.urdf_tree import read_tree
from suta_calib.words import listed


@click.command()
@urdf_argument("URDF")
@option(
    "--tip",
    "Link or frame of the tip; default: the end of the chain, if there is only one. For several "
    "chains of one robot, repeat it with a name for each: --tip left=LINK --tip right=LINK.",
    name="tips",
    multiple=True,
)
@option("--base", "First link of the chain; default: the root link.")
@option("--out", "Folder of the job; default: the current folder.", PATH, ".", show_default=False)
@option(
    "--kind",
    "Kind of observation; may be repeated. Default for a printed or hobby arm: the crosses of a "
    "printed sheet; else distances on an artefact, and a point that is touched from many "
    "directions.",
    name="kinds",
    multiple=True,
)
@option(
    "--grade",
    "How the arm was made, which determines the tolerances of its dimensions; default: guessed "
    "from the URDF.",
    click.Choice([*ARM_GRADES]),
)
def init(
    urdf: UrdfFile,
    tips: tuple[str, ...],
    base: str | None,
    out: Path,
    kinds: tuple[str, ...],
    grade: str | None,
) -> None:
    """Start a job for the arm in URDF: commented files to fill in. Overwrites nothing.

    With several --tip NAME=LINK, the job has a chain for each of them.

    Instead of a URDF you can give a .xacro file, with --xacro-arg for its arguments, or a model of
    MuJoCo (MJCF), which is converted to a URDF beside the job.
    """
    made = _converted(Path(urdf))
    source = urdf if made is None else made.text()
    tree = read_tree(source)
    if not tips:
        if len(tree.leaves) > 1:
            several = "; several in one job: --tip NAME=LINK for each"
            expected = f"expected a link or joint of {urdf}; {ends(tree)}{several}"
            raise click.UsageError(f"found no --tip; {expected}")
        tips = tree.leaves
        click.echo(f"{urdf}: the tip is {tips[0]}, at the end of the only chain.", err=True)
    arm = _arm(source, tips, base)
    notes = [note for chain in arm.chained for note in chain.notes]
    for note in (*(made.notes if made else ()), *(f"{n}." for n in dict.fromkeys(notes))):
        click.echo(f"{urdf}: {note}", err=True)
    if isinstance(arm, ArmModel) and (others := other_chains(tree, arm.chain.tip_link)):
        click.echo(
            f"{urdf}: the robot has other chains, which end at {listed(others, 6)}. This job is "
            f"for {arm.chain.tip} alone. One job can hold several, in which shared joints are one "
            "unknown: give --tip NAME=LINK for each.",
            err=True,
        )
    named = urdf if made is None else out / Path(urdf).with_suffix(made.kind).name
    files = new_job(arm, out, kinds=kinds, grade=grade, urdf=named)
    if made is not None:
        files = (*files, Template(Path(named), made.text()))
    check_folder(out)
    write_job(files)
    if grade is None:
        guess, reason = guessed_grade(arm)
        grades = "|".join(name for name in ARM_GRADES if name != guess.name)
        click.echo(
            f"The grade of the arm was guessed as {guess.name} ({guess.about}): {reason}. "
            f"If that is wrong, give --grade {grades}.",
            err=True,
        )
    for file in files:
        click.echo(file.path)
    click.echo(f"Next: fill in the samples, then suta-calib observe {quote(str(files[0].path))}")


def _arm(urdf: Path | XacroFile | str, tips: Sequence[str], base: str | None) -> AnyArm:
    """The arm with this tip, or the robot with a chain to each: ``NAME=LINK``."""
    if len(tips) == 1 and "=" not in tips[0]:
        return ArmModel.from_urdf(urdf, tips[0], base)
    named = [(name, link or name) for name, _, link in (tip.partition("=") for tip in tips)]
    for what, given in zip(("name", "tip"), zip(*named, strict=True), strict=True):
        for one in dict.fromkeys(given):
            if given.count(one) > 1:
                raise InputError(f"the {what} '{one}' twice", f"each {what} once", where="--tip")
    return Robot.from_urdf(urdf, {name: (link, base) for name, link in named})


def _converted(path: Path) -> ImportedFile | None:
    """A description of an arm that is none of URDF, as a URDF; None where it is one."""
    format_name = recognised_format(path)
    if format_name is None or "import" not in format_name.read_by:
        return None
    made = read_foreign(path)
    return made if isinstance(made, ImportedFile) and made.kind == ".urdf" else None
