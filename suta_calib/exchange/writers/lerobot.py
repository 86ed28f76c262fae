"""LeRobot's calibration JSON with new homing offsets."""

from __future__ import annotations

import json
import math
from typing import Any, ClassVar, Final

from suta_calib.errors import InputError
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import CalibratedArm, Result, json_bytes
from suta_calib.exchange.writer import Writer
from suta_calib.exchange.writers.joint_offsets import lost_beside_offsets
from suta_calib.measurements.files import read_text
from suta_calib.model.parameters import OFFSET

CALIBRATION: Final = Option(
    "calibration", "The calibration JSON that is to be corrected.", "FILE.json", file=True
)
MOTORS: Final = Option(
    "motors",
    "Joints of the motors that are called otherwise.",
    "shoulder_pan=joint_1,…",
    several=True,
)
COUNTS: Final = Option("counts_per_turn", "Ticks of one turn of an encoder.", "N")
# Of the servos that LeRobot's arms have.
_FEETECH: Final = "4096"


class LerobotWriter(Writer):
    """An existing calibration whose ``homing_offset`` take the joints' offsets in."""

    name: ClassVar[str] = "lerobot"
    summary: ClassVar[str] = "LeRobot calibration JSON with corrected homing_offset"
    example: ClassVar[str] = "results --format lerobot --calibration so101.json --out new.json"
    options: ClassVar[tuple[Option, ...]] = (CALIBRATION, MOTORS, COUNTS)
    file: ClassVar[str] = "exported_lerobot.json"
    notes: ClassVar[tuple[str, ...]] = (
        "Homing offsets are whole ticks: what is less than half of one is lost.",
        "Write them to the motors: LeRobot's own check of a calibration does.",
    )

    def content(self, result: Result, given: Given) -> bytes:
        """The calibration, every other number as it was.

        A servo reports its position less its homing offset: to read more, the offset is less. The
        range stays, because LeRobot counts degrees from its middle.
        """
        arm = result.need_arm(self.name)
        path = given.path(CALIBRATION)
        if path is None:
            found = "no calibration to correct"
            raise given.refuse(CALIBRATION, found, "LeRobot's JSON of this arm")
        try:
            data = json.loads(read_text(path))
        except json.JSONDecodeError as problem:
            said = f"text that is not JSON ({problem.msg})"
            raise InputError(said, "a JSON object", file=path, line=problem.lineno) from None
        text = given.text(COUNTS, _FEETECH)
        if not (text.isascii() and text.isdigit() and int(text) > 1):
            raise given.refuse(COUNTS, repr(text), "a whole number, such as 4096")
        names = given.pairs(MOTORS)
        motors = _motors(data, path)
        joints = {names.get(motor, motor): motor for motor in motors}
        if missing := [joint for joint in arm.model.joints if joint not in joints]:
            raise InputError(
                f"no motor of the joint {missing[0]!r} among {', '.join(motors)}",
                "a motor for each joint of the arm",
                file=path,
                hint=f"say which with {MOTORS.switch} MOTOR={missing[0]}",
            )
        for joint in arm.model.joints:
            if arm.model.units[joint] != "rad":
                raise InputError(f"{joint}, which slides", "joints that turn", file=path)
            ticks = arm.values.get(f"{joint}.{OFFSET}", 0.0) * int(text) / math.tau
            motors[joints[joint]]["homing_offset"] -= round(ticks)
        return json_bytes(data)

    def lost(self, arm: CalibratedArm) -> list[str]:
        """Everything that differs from nominal but the offsets of joints that are read."""
        return lost_beside_offsets(arm)


def _motors(data: Any, path: Any) -> dict[str, dict[str, Any]]:
    """The motors of a calibration, each with a whole number for its homing offset."""
    if not isinstance(data, dict) or not data:
        raise InputError(f"a JSON {type(data).__name__}", "motors by name", file=path)
    for name, motor in data.items():
        offset = motor.get("homing_offset") if isinstance(motor, dict) else None
        if not isinstance(offset, int) or isinstance(offset, bool):
            found = f"{offset!r}" if isinstance(motor, dict) else repr(motor)[:40]
            raise InputError(found, "a whole number", file=path, where=f"{name}.homing_offset")
    return data
