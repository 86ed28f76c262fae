"""Poses of cameras, instruments, artefacts and points that a calibration found beside the arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.report.listing import Column, Listing, shown_as
from suta_calib.report.poses import axes_with_std
from suta_calib.trust.external_poses import ExternalPose
from suta_calib.units import Unit, text
from suta_calib.words import listed


def _rpy(pose: ExternalPose) -> FloatArray | None:
    return None if pose.rotation is None else rpy_from_rotation(pose.rotation)


def _spaced(
    numbers: Callable[[ExternalPose], FloatArray | None], unit: Unit, decimals: int | None = None
) -> Callable[[ExternalPose], str]:
    """A cell with several numbers; empty for a point, which has no orientation."""

    def cell(pose: ExternalPose) -> str:
        components = numbers(pose)
        if components is None or pose.rotation is None:
            return ""
        return "  ".join(text(float(v), unit, decimals=decimals) for v in components)

    return cell


EXTERNAL_POSES: Final = Listing[ExternalPose](
    "External poses",
    Column("name", "frame"),
    Column("what", "pose", lambda pose: pose.frame.what, cell=lambda pose: f"{pose.words}, mm"),
    Column("within", None, lambda pose: pose.frame.within),
    *axes_with_std(lambda pose: pose.position, lambda pose: pose.std[:3]),
    shown_as("roll  pitch  yaw, deg", _spaced(_rpy, "rad")),
    shown_as("± turn about its x  y  z", _spaced(lambda pose: pose.std[3:], "rad")),
    shown_as("quaternion x  y  z  w", _spaced(lambda pose: pose.quaternion, "1")),
    shown_as("± std", _spaced(lambda pose: pose.quaternion_std, "1")),
    Column("matrix"),
    Column("inverse"),
    Column("position", unit="m"),
    Column("position_std", value=lambda pose: pose.std[:3], unit="m"),
    Column("rpy", value=_rpy, unit="rad"),
    Column("rotation_std", value=lambda pose: pose.std[3:], unit="rad"),
    Column("quaternion_xyzw", value=lambda pose: pose.quaternion),
    Column("quaternion_std"),
    Column("held", "not told", cell=lambda pose: listed(pose.held, 3), optional=True),
    Column("given", "given", cell=lambda pose: listed(pose.given, 3), optional=True),
    key="external_poses",
    named=True,
)
# A terminal has no room for what says the same again, and angles may stand below their row.
IN_SHORT: Final = Listing[ExternalPose](
    EXTERNAL_POSES.title,
    *(
        replace(column, numeric=False) if "  " in (column.heading or "") else column
        for column in EXTERNAL_POSES.columns
        if column.heading not in ("quaternion x  y  z  w", "± std")
    ),
)
NOTE: Final = (
    "A pose is T_within_what, in metres in result.json, where its inverse is too. ± of a turn is "
    "about the frame's own axes. Where parameters, or a key of the job, are given, it has its "
    "meaning only relative to them: nothing measured checks these."
)
