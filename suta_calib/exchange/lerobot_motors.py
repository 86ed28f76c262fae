"""The motors of a LeRobot calibration, as its JSON has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.json_input import read_json
from suta_calib.exchange.option import Given, Option

MOTORS: Final = Option(
    "motors",
    "Joints of the motors that are called otherwise.",
    "shoulder_pan=joint_1,…",
    several=True,
)
COUNTS: Final = Option("counts_per_turn", "Ticks of one turn of an encoder.", "N")
# Of the servos that LeRobot's arms have.
_FEETECH: Final = "4096"
LINES: Final = "lines"
FEETECH: Final = "feetech"
DYNAMIXEL: Final = "dynamixel"
KEYS: Final = ("homing_offset", "range_min", "range_max", "drive_mode")
# Of files that LeRobot wrote until mid 2025: a list for each key, in the order of these names.
OLD_NAMES: Final = "motor_names"
_LARGEST: Final = 1 << 31


def read_motors(path: Path) -> dict[str, dict[str, Any]]:
    """Motors by name, each with whole numbers for `KEYS`.

    Raises:
        ForeignFileError: no such file, no JSON, an old file with lists, a motor without one
            of these numbers, or without a range.
    """
    data = read_json(path)
    if OLD_NAMES in data:
        raise ForeignFileError(
            f"a calibration with lists by {OLD_NAMES}, as LeRobot wrote it until mid 2025",
            f"one with {', '.join(KEYS)} of each motor",
            file=path,
            hint="its zeros differ from those of today: calibrate the arm again with a current "
            "LeRobot",
        )
    for name, motor in data.items():
        if not isinstance(motor, dict):
            raise ForeignFileError(repr(motor)[:40], "a motor", file=path, where=name)
        for key in KEYS:
            number = motor.get(key)
            if not isinstance(number, int) or isinstance(number, bool) or abs(number) > _LARGEST:
                where = f"{name}.{key}"
                problem = repr(number)[:40]
                raise ForeignFileError(problem, "a whole number", file=path, where=where)
        least, most = motor["range_min"], motor["range_max"]
        if least >= most:
            raise ForeignFileError(
                f"a range from {least} to {most}",
                "range_min less than range_max: the zero is in their middle",
                file=path,
                where=name,
                hint="calibrate it again, and move the motor while LeRobot records its range",
            )
    return data


def counts_of(given: Given) -> int:
    """Ticks of one turn.

    Raises:
        InputError: no whole number above 1.
    """
    text = given.text(COUNTS, _FEETECH)
    if not (text.isascii() and text.isdigit() and 1 < int(text[:12]) < _LARGEST):
        raise given.refuse(COUNTS, repr(text), "a whole number, such as 4096")
    return int(text)
