"""``suta-calib zero-offsets``: encoder offsets from known poses of the tip."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from suta_calib.acquisition.zero_offsets import ZeroOffsetOptions, find_zero_offsets
from suta_calib.atomic import check_outputs
from suta_calib.cli._options import PATH, POSITIVE, WRITTEN, numbers_of, option, urdf_argument
from suta_calib.cli._output import answer_command
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.inputs import UrdfFile
from suta_calib.measurements import SampleColumns, Samples, read_samples
from suta_calib.model.arm import ArmModel
from suta_calib.report.document import Document
from suta_calib.report.zero_offsets import zero_offsets_document
from suta_calib.terms.poses import joint_ranges
from suta_calib.units import from_deg, from_mm

if TYPE_CHECKING:
    from suta_calib.measurements import Samples
    from suta_calib.model.arm import ArmModel


@answer_command
@urdf_argument("ARM.urdf")
@option("--tip", "Link or frame whose poses are known.", required=True)
@option("--base", "Link in which the poses are given; default: the root link.")
@option(
    "--readings",
    "CSV with one column per joint, and x,y,z[,qx,qy,qz,qw] (m) unless --pose is given.",
    PATH,
    required=True,
)
@option(
    "--pose X,Y,Z[,R,P,Y]",
    "Pose of the tip in the base frame, in mm and deg; once for each row of the readings, in the "
    "same order.",
    multiple=True,
)
@option("--branch", "Number of the solution, if several fit.", click.IntRange(min=1), 1)
@option("--out", "URDF to write, with the offsets.", WRITTEN, name="file")
@option(
    "--tolerance-mm",
    "Largest acceptable distance of the tip from its known positions (RMS).",
    POSITIVE,
    20.0,
)
def zero_offsets(
    urdf: UrdfFile,
    tip: str,
    base: str | None,
    readings: Path,
    pose: tuple[str, ...],
    branch: int,
    file: Path | None,
    tolerance_mm: float,
) -> Document:
    """Find the encoder offsets that make ARM.urdf agree with known poses of its tip.

    One pose with its orientation determines the offsets of six joints, except for the branches:
    several ways in which the arm can reach it. The branches are listed, with the smallest offsets
    first, and the first is used unless --branch chooses another. A single pose is not checked by
    other data: give two, above all if an offset is beyond 45 degrees. Each position without
    orientation gives three equations: give several. With --out it writes the URDF with the offsets
    in its joints' origins, for raw readings. The exit code is 1, and nothing is written, if no
    offsets fit, if infinitely many fit, or if large offsets are not confirmed by a second pose.
    """
    if file is not None:
        check_outputs([file], [urdf, readings])
    arm = ArmModel.from_urdf(urdf, tip, base)
    options = ZeroOffsetOptions(branch, from_mm(tolerance_mm))
    result = find_zero_offsets(arm, _samples(arm, readings, pose), options)
    written = file if result.assessment.usable else None
    if written is not None:
        arm.write_urdf(written, result.values())
    return zero_offsets_document(result, written)


def _samples(arm: ArmModel, readings: Path, poses: Sequence[str]) -> Samples:
    if not poses:
        columns = SampleColumns(position=True, orientation="optional")
        return read_samples([readings], joint_ranges(arm), columns)
    samples = read_samples([readings], joint_ranges(arm), SampleColumns())
    numbers = [numbers_of(text) for text in poses]
    pose_numbers = (3, 6)
    for text, pose in zip(poses, numbers, strict=True):
        if len(pose) not in pose_numbers:
            expected = "x,y,z or x,y,z,roll,pitch,yaw in mm and deg"
            raise InputError(repr(text), expected, where="--pose")
    if len(numbers) != len(samples):
        raise InputError(
            f"{len(numbers)} --pose for {len(samples)} rows",
            "one --pose for each row",
            file=readings,
            hint="or give the columns x,y,z in the file",
        )
    if len({len(array) for array in numbers}) > 1:
        raise InputError(
            "poses with and without orientation",
            "all poses with orientation, or all without",
            where="--pose",
        )
    table = np.array(numbers)
    oriented = table.shape[1] > len("xyz")
    turns = from_deg(table[:, 3:])
    return Samples.from_arrays(
        arm.joints,
        samples.q,
        position=from_mm(table[:, :3]),
        rotation=[rotation_from_rpy(turn) for turn in turns] if oriented else None,
        origin=samples.origin,
    )
