"""``suta-calib init``: the files of a new job."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import Final

import click

from suta_calib.atomic import check_folder
from suta_calib.cli._options import PATH, flag, option, urdf_argument
from suta_calib.errors import InputError
from suta_calib.exchange.imported import ImportedFile
from suta_calib.exchange.lerobot_motors import BUSES, read_motors
from suta_calib.exchange.reader import read_foreign
from suta_calib.exchange.recognition import recognised_format
from suta_calib.inputs import UrdfFile, XacroFile
from suta_calib.job.arm_grade import ARM_GRADES, guessed_grade
from suta_calib.job.new_job import Template, new_job, write_job
from suta_calib.job.pen import PEN, with_pen
from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import ends, other_chains
from suta_calib.model.robot import AnyArm, Robot
from suta_calib.model.urdf_tree import read_tree
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND, EyeSetup
from suta_calib.words import listed

_PLACES: Final[dict[str, EyeSetup]] = {"hand": EYE_IN_HAND, "beside": EYE_TO_HAND}


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
@flag(
    "--pen",
    "The hand holds a pen, at a place that nobody measured: the job has a copy of the URDF with a "
    "link pen_tip on the tip, and finds where its point is.",
)
@option(
    "--camera NAME=hand|beside",
    "A camera that sees a printed board: on the hand, or beside the arm; may be repeated.",
    name="cameras",
    multiple=True,
)
@option(
    "--lerobot FILE.json",
    "LeRobot's calibration of the arm: also writes device.yaml, for its motors.",
    PATH,
)
@option(
    "--bus",
    "Type of the servos of --lerobot; default: as the names of its folder and file or its ranges "
    "show it.",
    click.Choice(BUSES),
)
@option("--port", "Port of the motors, for device.yaml.", default="/dev/ttyACM0")
def init(
    urdf: UrdfFile,
    tips: tuple[str, ...],
    base: str | None,
    out: Path,
    kinds: tuple[str, ...],
    grade: str | None,
    pen: bool,
    cameras: tuple[str, ...],
    lerobot: Path | None,
    bus: str | None,
    port: str,
) -> None:
    """Start a job for the arm in URDF: commented files to fill in. Overwrites nothing.

    With several --tip NAME=LINK, the job has a chain for each of them. For a printed or hobby arm,
    sheet.svg is a sheet of crosses to print; with --camera, board.svg a board.

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
    if pen:
        if len(tips) != 1 or "=" in tips[0]:
            raise InputError(f"--pen with {len(tips)} tips", "one --tip", where="--pen")
        source, tips = with_pen(source, tips[0], Path(urdf).parent, out), (PEN,)
        tree = read_tree(source)
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
    written = source if isinstance(source, str) else None
    named = urdf if written is None else out / Path(urdf).with_suffix(".urdf").name
    files = new_job(
        *(arm, out), kinds=kinds, grade=grade, urdf=named, cameras=_cameras(cameras), pen=pen
    )
    if lerobot is not None:
        files = (*files, Template(out / "device.yaml", _device(lerobot, bus, port, arm.joints)))
    if written is not None:
        files = (*files, Template(Path(named), written))
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
    click.echo(f"Next: {_next_step(files)}")


def _next_step(files: Sequence[Template]) -> str:
    """What to do with a new job: print, measure; or fill it in where no device is known."""
    job = quote(str(files[0].path))
    paths = {file.path.name: quote(str(file.path)) for file in files}
    printed = [path for name, path in paths.items() if name.endswith(".svg")]
    if not printed and "device.yaml" not in paths:
        return f"fill in the samples, then suta-calib observe {job}"
    device = paths.get("device.yaml", "device.yaml")
    measure = f"suta-calib measure {job} --device {device} --placement table"
    if "device.yaml" not in paths:
        measure = f"describe the motors in a device.yaml, and {measure}"
    if not printed:
        return measure
    return f"print {listed(printed)} at 100 %, and measure with a ruler; then {measure}"


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


def _cameras(given: Sequence[str]) -> dict[str, EyeSetup]:
    """Cameras by name, of words NAME=hand and NAME=beside."""
    cameras = dict[str, EyeSetup]()
    for word in given:
        name, _, place = word.partition("=")
        if not name or place not in _PLACES or name in cameras:
            expected = f"{' or '.join(f'NAME={where}' for where in _PLACES)}, each name once"
            raise InputError(repr(word), expected, where="--camera")
        cameras[name] = _PLACES[place]
    return cameras


def _device(calibration: Path, bus: str | None, port: str, joints: Sequence[str]) -> str:
    """``device.yaml`` of LeRobot's motors, by the names of the arm's joints."""
    motors = [*read_motors(calibration)]
    pairs = tuple(f"{motor}={joint}" for motor, joint in zip(motors, joints, strict=False))
    if {*joints} <= {*motors}:
        pairs = ()
    elif len(motors) < len(joints):
        problem = f"{len(motors)} motors for {len(joints)} joints"
        raise InputError(problem, "a motor for each joint", file=calibration)
    else:
        click.echo(
            f"{calibration}: motors and joints have different names, and are taken in order. "
            "suta-calib motors finds out whether that is right.",
            err=True,
        )
    made = read_foreign(calibration, "lerobot-calibration", bus=bus, port=port, motors=pairs)
    assert isinstance(made, ImportedFile)
    for remark in made.remarks:
        click.echo(f"{calibration}: {remark}", err=True)
    return made.text()


def _converted(path: Path) -> ImportedFile | None:
    """A description of an arm that is none of URDF, as a URDF; None where it is one."""
    format_name = recognised_format(path)
    if format_name is None or "import" not in format_name.read_by:
        return None
    made = read_foreign(path)
    return made if isinstance(made, ImportedFile) and made.kind == ".urdf" else None
