"""The motors of a LeRobot calibration, as its JSON has them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_json
from suta_calib.exchange.joint_readings import COUNTS
from suta_calib.exchange.option import Given, Option

MOTORS: Final = Option(
    "motors",
    "Names of joints for motors, where they differ.",
    "shoulder_pan=joint_1,…",
    several=True,
)
LINES: Final = "lines"
FEETECH: Final = "feetech"
DYNAMIXEL: Final = "dynamixel"
BUSES: Final = (FEETECH, DYNAMIXEL)
KEYS: Final = ("homing_offset", "range_min", "range_max", "drive_mode")
# Of files that LeRobot wrote until mid 2025: a list for each key, in the order of these names.
OLD_NAMES: Final = "motor_names"
_LARGEST: Final = 1 << 31
# Words in the names of LeRobot's robots, which are those of the folders of their calibrations.
_ROBOTS: Final = {
    FEETECH: ("so100", "so101", "so_follower", "so_leader", "lekiwi"),
    DYNAMIXEL: ("koch", "omx", "viperx", "widowx", "aloha"),
}
# LeRobot takes a whole turn for the range of this motor of a Koch, and records that of an SO-101.
_PAN: Final = "shoulder_pan"


def read_motors(path: Path) -> dict[str, dict[str, Any]]:
    """Motors by name, each with whole numbers for `KEYS`."""
    data = read_json(path)
    if OLD_NAMES in data:
        problem = f"a calibration with lists by {OLD_NAMES}, as LeRobot wrote it until mid 2025"
        expected = f"a calibration with {', '.join(KEYS)} of each motor"
        hint = (
            "its zeros differ from the present ones: calibrate the arm again with a current LeRobot"
        )
        raise ForeignFileError(problem, expected, file=path, hint=hint)
    for name, motor in data.items():
        if not isinstance(motor, dict):
            raise ForeignFileError(repr(motor)[:40], "a motor", file=path, where=name)
        for key in KEYS:
            number, where = motor.get(key), f"{name}.{key}"
            if not isinstance(number, int) or isinstance(number, bool) or abs(number) > _LARGEST:
                raise ForeignFileError(repr(number)[:40], "a whole number", file=path, where=where)
        least, most = motor["range_min"], motor["range_max"]
        if least >= most:
            problem = f"a range from {least} to {most}"
            expected = "range_min less than range_max: the zero is in the middle of the range"
            hint = "calibrate the motor again, and move it while LeRobot records its range"
            raise ForeignFileError(problem, expected, file=path, where=name, hint=hint)
    return data


def bus_of(path: Path, motors: Mapping[str, Mapping[str, Any]]) -> tuple[str, str]:
    """Type of an arm's servos, and what shows it: the names of the file and of its folder, or Koch.

    LeRobot keeps calibrations as ``robots/koch_follower/my_arm.json``.
    """
    for name in (path.absolute().parent.name, path.stem):
        for bus, robots in _ROBOTS.items():
            if word := next((word for word in robots if word in name.lower()), None):
                return bus, f"{name!r} has {word!r} in it"
    pan = motors.get(_PAN, {})
    if (pan.get("range_min"), pan.get("range_max")) == (0, 4095):
        return DYNAMIXEL, f"the range of {_PAN} is the whole turn, as LeRobot writes it for a Koch"
    return FEETECH, "LeRobot's arms have them if nothing says otherwise"


def counts_of(given: Given) -> int:
    """Ticks of one turn: of the servos that LeRobot's arms have where nobody says."""
    return given.whole(COUNTS, "4096", 2, _LARGEST - 1, "a whole number, such as 4096")
