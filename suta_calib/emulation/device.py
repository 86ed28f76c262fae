"""The device that an emulated arm is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from suta_calib.device.description import FRAME_COUNTS_PER_TURN, DeviceSpec, JointSpec
from suta_calib.device.formats import FORMATS
from suta_calib.errors import InputError
from suta_calib.measurements.yaml_text import yaml_text

if TYPE_CHECKING:
    from suta_calib.model.arm import ArmModel


def device_of(
    arm: ArmModel,
    *,
    form: str = "frames",
    unit: str = "counts",
    counts_per_turn: int = FRAME_COUNTS_PER_TURN,
    signs: Sequence[int] = (),
    baudrate: int = 921600,
) -> DeviceSpec:
    """One encoder for each joint of an arm, from base to tip; it has no port yet.

    Args:
        arm: whose joints.
        form: one of `FORMATS`.
        unit: of lines: ``counts``, ``rad`` or ``deg``.
        counts_per_turn: of one turn, in counts.
        signs: +1 or -1 for each joint; all +1 by default.
        baudrate: for ``device.yaml``: a pseudo-terminal has none.

    Raises:
        InputError: a unit or counts that the format cannot have, a number of signs that is not that
            of the joints, or a joint that slides where angles are sent.
    """
    if (refused := FORMATS[form].refusal(unit, counts_per_turn)) is not None:
        description = f"{form} with {counts_per_turn} counts per turn, in {unit}"
        raise InputError(description, refused[1], where=refused[0])
    for joint in arm.chain.moving:
        if joint.type == "prismatic" and unit != "rad":
            raise InputError(
                f"prismatic joint {joint.name!r}",
                "joints that turn: an encoder's word is an angle",
                file=arm.chain.path,
                line=joint.line,
                hint="send it as lines in rad, which carry metres as they are",
            )
    chosen = list(signs) or [1] * len(arm.joints)
    if len(chosen) != len(arm.joints):
        raise InputError(f"{len(chosen)} signs", f"{len(arm.joints)}, one per joint")
    joints = tuple(map(JointSpec, arm.joints, chosen))
    return DeviceSpec(Path("device.yaml"), "", baudrate, form, unit, counts_per_turn, joints)


def device_text(device: DeviceSpec) -> str:
    """``device.yaml`` of a device."""
    document: dict[str, Any] = {
        "port": device.port,
        "baudrate": device.baudrate,
        "format": device.format,
        "unit": device.unit,
        "counts_per_turn": device.counts_per_turn,
        "joints": [{"name": joint.name, "sign": joint.sign} for joint in device.joints],
    }
    return yaml_text(document, "An emulated arm: there is no hardware behind this port.")
