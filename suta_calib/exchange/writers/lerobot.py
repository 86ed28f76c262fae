"""LeRobot's calibration JSON with new homing offsets."""

from __future__ import annotations

import math
from typing import Any, Final

from suta_calib.device.description import DeviceSpec
from suta_calib.device.device_file import read_device
from suta_calib.errors import InputError
from suta_calib.exchange.joint_readings import COUNTS
from suta_calib.exchange.lerobot_motors import (
    BUSES,
    DYNAMIXEL,
    MOTORS,
    bus_of,
    counts_of,
    read_motors,
)
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result, json_bytes
from suta_calib.exchange.writers.joint_offsets import OffsetsWriter
from suta_calib.model.parameters import OFFSET

CALIBRATION: Final = Option(
    "calibration", "The calibration JSON to be corrected.", "FILE.json", file=True
)
BUS: Final = Option(
    "bus",
    "Type of the servos: Dynamixel adds a homing offset, Feetech subtracts it; default: that of "
    "device.yaml, or as the calibration shows it.",
    choices=BUSES,
)
DEVICE: Final = Option(
    "device",
    "The device.yaml of the samples: LeRobot's zeros become those of the URDF, whichever motor "
    "moves a joint.",
    "device.yaml",
    file=True,
)


class LerobotWriter(OffsetsWriter):
    """An existing calibration whose ``homing_offset`` take the joints' offsets in."""

    name = "lerobot"
    summary = "LeRobot calibration JSON with corrected homing_offset"
    example = "results --format lerobot --calibration so101.json --out new.json"
    options = (CALIBRATION, DEVICE, BUS, MOTORS, COUNTS)
    file = "exported_lerobot.json"
    notes = (
        "Homing offsets are whole ticks: smaller corrections are lost.",
        "Write them to the motors: LeRobot's calibration command offers to do that.",
        "Readings have the direction of Present_Position for any drive_mode, as LeRobot's "
        "degrees and a device.yaml from import do. If device.yaml has sign: -1 for a joint, its "
        "degrees in LeRobot are those of the URDF times -1.",
        "LeRobot gives degrees with use_degrees: true, which is not its default for a Koch.",
    )

    def content(self, result: Result, given: Given) -> bytes:
        """The calibration, every other number as it was.

        A Feetech servo reports its position less its homing offset, a Dynamixel adds it: to read
        more, the offset is less, or more. The range stays, because LeRobot counts degrees from its
        middle. With the device's file the middle becomes the zero of the URDF. As the stops do not
        move with it, the range becomes as much smaller at both ends.
        """
        arm = result.need_arm(self.name)
        own_joints = arm.alone.own_joints
        path = given.path(CALIBRATION)
        if path is None:
            problem = "no calibration to correct"
            raise given.refuse(CALIBRATION, problem, "LeRobot's JSON of this arm")
        motors, counts = read_motors(path), counts_of(given)
        at = given.path(DEVICE)
        device = None if at is None else read_device(at)
        names = given.pairs(MOTORS)
        bus = bus_of(path, motors)[0]
        if device is not None and device.format in BUSES:
            bus = device.format
        bus = given.text(BUS, bus)
        joints = {names.get(motor, motor): motor for motor in motors}
        if device is not None:
            joints |= _by_number(device, motors)
        if missing := [joint for joint in own_joints if joint not in joints]:
            problem = f"no motor of the joint {missing[0]!r} among {', '.join(motors)}"
            expected = "a motor for each joint of the arm"
            hint = f"choose it with {MOTORS.switch} MOTOR={missing[0]}"
            raise InputError(problem, expected, file=path, hint=hint)
        for joint in own_joints:
            if arm.model.units[joint] != "rad":
                raise InputError(f"{joint}, which is prismatic", "revolute joints", file=path)
            offset = arm.values.get(f"{joint}.{OFFSET}", 0.0)
            motor = motors[joints[joint]]
            if device is None or joint not in device.names:
                _shift(motor, -round(offset * counts / math.tau), bus, counts)
            else:
                _centre(motor, _reading_at_zero(device, joint, offset), bus, counts)
        return json_bytes(motors)


def _by_number(device: DeviceSpec, motors: dict[str, dict[str, Any]]) -> dict[str, str]:
    """Names of motors by the joints that have their numbers on the bus."""
    numbered = {motor["id"]: name for name, motor in motors.items() if "id" in motor}
    return {j.name: numbered[j.number] for j in device.joints if j.number in numbered}


def _reading_at_zero(device: DeviceSpec, joint: str, offset: float) -> float:
    """What a motor reports where the angle of its calibrated joint is 0, ticks."""
    place = device.names.index(joint)
    spec = device.joints[place]
    return float(spec.zero - spec.sign * offset * device.turns[place] / math.tau)


def _centre(motor: dict[str, Any], zero: float, bus: str, counts: int) -> None:
    """Make the middle of a motor's range its zero, in place."""
    least, most = motor["range_min"], motor["range_max"]
    shift = _of_one_turn(round(zero - (least + most) / 2), counts)
    _shift(motor, shift, bus, counts)
    if most - least < counts - 1:
        motor["range_min"], motor["range_max"] = least + abs(shift), most - abs(shift)
    if motor["range_min"] >= motor["range_max"]:
        expected = "a zero within the range of the motor"
        hint = "calibrate the arm in LeRobot again, from the middle of the joints' ranges"
        raise InputError(f"a zero {abs(shift)} ticks from the middle", expected, hint=hint)


def _shift(motor: dict[str, Any], ticks: int, bus: str, counts: int) -> None:
    """Make a motor report so many ticks less, in place.

    Where a Feetech stands is within one turn whatever its offset is, and the sign of an offset is a
    bit of its own. A Dynamixel reports the sum: a turn more would be a turn that the joint is off.
    """
    if bus == DYNAMIXEL:
        motor["homing_offset"] -= ticks
        return
    most = counts // 2 - 1
    offset = _of_one_turn(motor["homing_offset"] + ticks, counts)
    motor["homing_offset"] = min(max(offset, -most), most)


def _of_one_turn(ticks: int, counts: int) -> int:
    return (ticks + counts // 2) % counts - counts // 2
