"""``suta-calib zero-offsets``: encoder offsets from known poses of the tip."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
import numpy as np

from suta_calib.assessment import NOT_USABLE
from suta_calib.cli._numbers import FiniteRange
from suta_calib.cli._output import check_folder, console, json_option, print_json
from suta_calib.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from suta_calib.acquisition.zero_offsets import Branch, ZeroOffsets
    from suta_calib.measurements import Samples
    from suta_calib.model.arm import ArmModel

_TOLERANCE_MM: Final = 20.0
_POSE_NUMBERS: Final = (3, 6)


@click.command()
@click.argument("urdf", type=click.Path(path_type=Path), metavar="ARM.urdf")
@click.option("--tip", required=True, help="Link or frame whose poses are known.")
@click.option("--base", help="Link the poses are given in; the root link by default.")
@click.option(
    "--readings",
    type=click.Path(path_type=Path),
    required=True,
    help="CSV: a column per joint, and x,y,z[,qx,qy,qz,qw] (m) unless --pose is given.",
)
@click.option(
    "--pose",
    multiple=True,
    metavar="X,Y,Z[,R,P,Y]",
    help="Pose of the tip in the base, mm and deg; once per row of the readings, in their order.",
)
@click.option("--branch", type=click.IntRange(min=1), help="Which of the answers that fit.")
@click.option("--out", type=click.Path(path_type=Path), help="URDF to write, with the offsets.")
@click.option(
    "--tolerance-mm",
    type=FiniteRange(min=0, min_open=True),
    default=_TOLERANCE_MM,
    show_default=True,
    help="How far the tip may stay from where it is known to be (RMS).",
)
@json_option
@click.pass_context
def zero_offsets(
    context: click.Context,
    urdf: Path,
    tip: str,
    base: str | None,
    readings: Path,
    pose: tuple[str, ...],
    branch: int | None,
    out: Path | None,
    tolerance_mm: float,
    as_json: bool,
) -> None:
    """Find the encoder offsets that make ARM.urdf agree with known poses of its tip.

    One pose with its orientation tells the offsets of six joints, up to the ways (branches) in
    which the arm can reach it; they are listed, the smallest offsets first, and the first is taken
    unless --branch says otherwise. Positions alone give three equations each: give several. With
    --out writes the URDF with the offsets in its joints' origins, for raw readings. Exits with 1,
    and writes nothing, where no offsets fit or where the poses leave a choice between many.
    """
    from suta_calib.acquisition.zero_offsets import find_baseline
    from suta_calib.model.arm import ArmModel

    if out is not None:
        check_folder(out.parent)
    arm = ArmModel.from_urdf(urdf, tip, base)
    found = find_baseline(arm, _samples(arm, readings, pose))
    chosen = _chosen(found, branch)
    status = _status(found, chosen, 1e-3 * tolerance_mm)
    written = out if status == "found" else None
    if written is not None:
        arm.write_urdf(written, found.values(chosen))
    if as_json:
        print_json(baseline_dict(found, chosen, status, written))
    else:
        _print(found, chosen, status, written)
    if status != "found":
        context.exit(NOT_USABLE)


def _samples(arm: ArmModel, readings: Path, poses: Sequence[str]) -> Samples:
    from suta_calib.geometry.numbers import rotation_from_rpy
    from suta_calib.job.calibration import joint_ranges
    from suta_calib.measurements import SampleColumns, Samples, read_samples

    if not poses:
        columns = SampleColumns(position=True, orientation="optional")
        return read_samples([readings], joint_ranges(arm), columns)
    samples = read_samples([readings], joint_ranges(arm), SampleColumns())
    numbers = [_pose(text) for text in poses]
    if len(numbers) != len(samples):
        raise InputError(
            f"{len(numbers)} --pose for {len(samples)} rows",
            "one --pose per row",
            file=readings,
            hint="or give the columns x,y,z in the file",
        )
    if len({len(each) for each in numbers}) > 1:
        raise InputError("poses with and without orientation", "one or the other", where="--pose")
    table = np.array(numbers)
    oriented = table.shape[1] > len("xyz")
    turns = np.radians(table[:, 3:])
    return Samples.from_arrays(
        arm.joints,
        samples.q,
        position=1e-3 * table[:, :3],
        rotation=[rotation_from_rpy(turn) for turn in turns] if oriented else None,
        origin=samples.origin,
    )


def _pose(text: str) -> list[float]:
    try:
        numbers = [float(cell) for cell in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in _POSE_NUMBERS or not all(map(math.isfinite, numbers)):
        raise InputError(repr(text), "x,y,z or x,y,z,roll,pitch,yaw in mm and deg", where="--pose")
    return numbers


def _chosen(found: ZeroOffsets, branch: int | None) -> Branch:
    if branch is not None and branch > len(found.branches):
        raise InputError(str(branch), f"1 to {len(found.branches)}", where="--branch")
    return found.branches[(branch or 1) - 1]


def _status(found: ZeroOffsets, chosen: Branch, tolerance: float) -> str:
    if chosen.rms > tolerance:
        return "no_fit"
    return "found" if found.unique else "undetermined"


def baseline_dict(
    found: ZeroOffsets, chosen: Branch, status: str, written: Path | None
) -> dict[str, Any]:
    """The answer as data."""
    units = {name: found.arm.parameters[name].unit for name in found.names}
    return {
        "status": status,
        "offsets": {
            name: {"unit": units[name], "value": value}
            for name, value in found.values(chosen).items()
        },
        "undetermined": [c.held for c in found.undetermined],
        "combinations": [c.direction for c in found.undetermined],
        "residual": _residual(chosen),
        "branch": found.branches.index(chosen) + 1,
        "branches": [{"offsets": found.values(each), **_residual(each)} for each in found.branches],
        "urdf": None if written is None else str(written),
    }


def _residual(branch: Branch) -> dict[str, float | int | None]:
    angles = branch.angles
    return {
        "count": len(branch.distances),
        "rms_mm": 1e3 * branch.rms,
        "max_mm": 1e3 * float(branch.distances.max()),
        "rms_deg": None if angles is None else math.degrees(float(np.sqrt(np.mean(angles**2)))),
    }


def _print(found: ZeroOffsets, chosen: Branch, status: str, written: Path | None) -> None:
    to = console()
    to.print(_table(found, chosen))
    for line in _sentences(found, chosen, status):
        to.print(line, soft_wrap=True)
    if written is not None:
        to.print(f"Written to {written}: raw readings are its joint positions.", soft_wrap=True)


def _table(found: ZeroOffsets, chosen: Branch) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title="Offsets, deg (mm)", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("branch", no_wrap=True)
    for joint in found.arm.joints:
        table.add_column(joint, justify="right")
    table.add_column("RMS mm", justify="right", no_wrap=True)
    for k, branch in enumerate(found.branches):
        mark = " *" if branch is chosen else ""
        cells = [_cell(found, name, value) for name, value in found.values(branch).items()]
        table.add_row(f"{k + 1}{mark}", *cells, f"{1e3 * branch.rms:.3f}")
    return table


def _cell(found: ZeroOffsets, name: str, value: float) -> str:
    if name in (combination.held for combination in found.undetermined):
        return "?"
    length = found.arm.parameters[name].unit == "m"
    return f"{1e3 * value:.3f}" if length else f"{math.degrees(value):.3f}"


def _sentences(found: ZeroOffsets, chosen: Branch, status: str) -> list[str]:
    residual = _residual(chosen)
    count = len(found.branches)
    lines = [
        f"{residual['count']} poses; the tip stays {residual['rms_mm']:.3f} mm (RMS) away, "
        f"at most {residual['max_mm']:.3f} mm"
    ]
    if count > 1:
        which = found.branches.index(chosen) + 1
        lines.append(f"{count} branches fit; this is number {which}: choose with --branch N")
    for combination in found.undetermined:
        others = ", ".join(name for name in combination.direction if name != combination.held)
        what = f"only together with {others}" if others else "held at 0"
        lines.append(f"undetermined: {combination.held}, {what}")
    if status == "undetermined":
        lines.append("Not usable: give more poses, or their orientations. Nothing was written.")
    if status == "no_fit":
        lines.append(
            "Not usable: no offsets make the URDF agree; look for a wrong unit, frame or joint "
            "that turns the other way. Nothing was written."
        )
    return lines
