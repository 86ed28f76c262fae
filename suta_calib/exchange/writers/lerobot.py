"""LeRobot's calibration JSON with new homing offsets."""

from __future__ import annotations

import math
from typing import Final

from suta_calib.errors import InputError
from suta_calib.exchange.joint_readings import COUNTS
from suta_calib.exchange.lerobot_motors import DYNAMIXEL, FEETECH, MOTORS, counts_of, read_motors
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result, json_bytes
from suta_calib.exchange.writers.joint_offsets import OffsetsWriter
from suta_calib.model.parameters import OFFSET

CALIBRATION: Final = Option(
    "calibration", "The calibration JSON to be corrected.", "FILE.json", file=True
)
BUS: Final = Option(
    "bus",
    "Type of the servos: Dynamixel adds a homing offset, Feetech subtracts it.",
    choices=(FEETECH, DYNAMIXEL),
)


class LerobotWriter(OffsetsWriter):
    """An existing calibration whose ``homing_offset`` take the joints' offsets in."""

    name = "lerobot"
    summary = "LeRobot calibration JSON with corrected homing_offset"
    example = "results --format lerobot --calibration so101.json --out new.json"
    options = (CALIBRATION, BUS, MOTORS, COUNTS)
    file = "exported_lerobot.json"
    notes = (
        "Homing offsets are whole ticks: smaller corrections are lost.",
        "Write them to the motors: LeRobot's calibration command offers to do that.",
        "Readings have the direction of Present_Position for any drive_mode, as LeRobot's "
        "degrees and a device.yaml from import do.",
    )

    def content(self, result: Result, given: Given) -> bytes:
        """The calibration, every other number as it was.

        A Feetech servo reports its position less its homing offset, a Dynamixel adds it: to read
        more, the offset is less, or more. The range stays, because LeRobot counts degrees from its
        middle.
        """
        arm = result.need_arm(self.name)
        own_joints = arm.alone.own_joints
        path = given.path(CALIBRATION)
        if path is None:
            problem = "no calibration to correct"
            raise given.refuse(CALIBRATION, problem, "LeRobot's JSON of this arm")
        motors, counts = read_motors(path), counts_of(given)
        names = given.pairs(MOTORS)
        sign = 1 if given.text(BUS, FEETECH) == DYNAMIXEL else -1
        joints = {names.get(motor, motor): motor for motor in motors}
        if missing := [joint for joint in own_joints if joint not in joints]:
            problem = f"no motor of the joint {missing[0]!r} among {', '.join(motors)}"
            expected = "a motor for each joint of the arm"
            hint = f"choose it with {MOTORS.switch} MOTOR={missing[0]}"
            raise InputError(problem, expected, file=path, hint=hint)
        for joint in own_joints:
            if arm.model.units[joint] != "rad":
                raise InputError(f"{joint}, which is prismatic", "revolute joints", file=path)
            ticks = arm.values.get(f"{joint}.{OFFSET}", 0.0) * counts / math.tau
            motor = motors[joints[joint]]
            motor["homing_offset"] += sign * round(ticks)
        return json_bytes(motors)
