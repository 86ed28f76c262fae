"""LeRobot's calibration JSON as a ``device.yaml``: the zero, sign and counts of each motor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from suta_calib.exchange.imported import ImportedFile
from suta_calib.exchange.joint_readings import COUNTS
from suta_calib.exchange.lerobot_motors import (
    BUSES,
    KEYS,
    LINES,
    MOTORS,
    OLD_NAMES,
    bus_of,
    counts_of,
    read_motors,
)
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import Reader
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.words import listed

BUS: Final = Option(
    "bus",
    'Type of the servos, which are then polled directly; "lines" if a program sends their '
    "readings.",
    choices=(*BUSES, LINES),
)
PORT: Final = Option("port", "Port of the device, written to device.yaml.", "/dev/…")


class LerobotCalibrationReader(Reader):
    """Motors as joints: zero in the middle of the range, as LeRobot counts degrees."""

    name = "lerobot-calibration"
    summary = "LeRobot calibration JSON: motors as a device.yaml, ticks to rad"
    example = "so101.json --port /dev/ttyACM0 --out device.yaml"
    options = (PORT, BUS, MOTORS, COUNTS)
    suffixes = (".json",)

    def recognises(self, path: Path, head: str) -> bool:
        """Motors with homing offsets."""
        del path
        old = (KEYS[0], OLD_NAMES)
        return any(all(json.dumps(key) in head for key in keys) for keys in (KEYS, old))

    def read(self, path: Path, given: Given) -> ImportedFile:
        """A device whose ticks are those of Present_Position, which counts as LeRobot's degrees do.

        No ``drive_mode`` turns them round: LeRobot applies it to shares of a range only, and a
        Dynamixel that has it in its register turns its Present_Position round itself
        (LeRobot 0.6, ``_normalize`` and ``apply_drive_mode`` of its motors' buses).
        """
        motors, counts, names = read_motors(path), counts_of(given), given.pairs(MOTORS)
        numbered = all(_number(motor) is not None for motor in motors.values())
        probable, why = bus_of(path, motors)
        bus = given.text(BUS, probable if numbered else LINES)
        if bus != LINES and not numbered:
            raise given.refuse(
                BUS, f"{bus}, and motors without a number", f"an id of each in {path}"
            )
        joints = []
        for name, motor in motors.items():
            # Whole counts: half a tick is less than any servo repeats.
            zero = (motor["range_min"] + motor["range_max"]) // 2
            number = {} if bus == LINES else {"id": _number(motor)}
            joints.append({"name": names.get(name, name), **number, "sign": 1, "zero": zero})
        device = {
            "port": given.text(PORT, "/dev/ttyACM0"),
            "format": bus,
            **({"unit": "counts"} if bus == LINES else {}),
            "counts_per_turn": counts,
            "joints": joints,
        }
        comment = f"From LeRobot's calibration {path.name}."
        if bus == LINES:
            comment += " Send each motor's Present_Position, from which\n"
            comment += "the servo has taken its homing offset, as a line of counts."
        remarks = list[str]()
        if PORT not in given:
            remarks.append(f"The port is {device['port']}; choose another with --port.")
        if BUS not in given and bus != LINES:
            remarks.append(
                f"The servos are taken for {bus}: {why}. If they are others, state their type with "
                f"{BUS.switch}."
            )
        if turned := [name for name, motor in motors.items() if motor["drive_mode"]]:
            remarks.append(
                f"drive_mode of {listed(turned)} is not applied, as for LeRobot's degrees: "
                "readings have the direction of the servo's Present_Position."
            )
        return ImportedFile(
            source=path,
            form=self.name,
            content=yaml_text(device, comment),
            what=f"a device of {len(joints)} motor{'s' * (len(joints) != 1)}",
            kind=".yaml",
            remarks=tuple(remarks),
        )


def _number(motor: dict[str, Any]) -> int | None:
    """On its bus; None where the file does not say."""
    number = motor.get("id")
    return number if isinstance(number, int) and 0 <= number <= 252 else None
