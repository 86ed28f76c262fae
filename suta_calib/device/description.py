"""What a device is, once its ``device.yaml`` is read: port, format, joints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import InputError, did_you_mean
from suta_calib.measurements.fields import TEXT, Value, keyed, quantity, whole_number
from suta_calib.measurements.yaml_file import YamlSection

# Of an encoder's word, and of a device that does not say.
FRAME_COUNTS_PER_TURN: Final = 1 << 22
UNITS: Final = ("counts", "rad", "deg")
# Formats of devices that speak by themselves: of their device.yaml the port is all that opens it.
UNASKED: Final = ("frames", "lines")


# No encoder has more than 32 bits.
COUNTS_PER_TURN: Final = whole_number(2, 1 << 32)


def _read_sign(section: YamlSection, key: str) -> int:
    sign = section.integer(key, -1)
    if sign not in (-1, 1):
        raise section.refuse(str(sign), "1 or -1", at=(key,))
    return sign


@dataclass(frozen=True)
class JointSpec:
    """One encoder, as the key ``joints`` of ``device.yaml`` has it.

    What one with a ratio sends is taken for a count of more than one turn: one turn of an encoder
    before a gear does not tell the joint's.
    """

    name: str = keyed(TEXT, "The joint's name in the URDF.")
    sign: int = keyed(
        Value("1 or -1", _read_sign),
        "1 if the reading increases with the URDF's angle, -1 if it decreases; default 1.",
        1,
    )
    zero: float = keyed(
        quantity(takes="number, in unit"),
        "Reading at the zero position of the URDF; default 0.",
        0.0,
    )
    ratio: float = keyed(
        quantity(), "Turns of the encoder per turn of the joint (gear ratio); default 1.", 1.0
    )
    counts_per_turn: int | None = keyed(
        COUNTS_PER_TURN, "Counts per turn of this joint's encoder, if different.", None
    )
    number: int | None = keyed(
        whole_number(0),
        "Number of the servo on the bus; default: the joint's position in the list, from 1.",
        None,
        "id",
    )


@dataclass(frozen=True)
class DeviceSpec(Displayable):
    """A device as ``device.yaml`` describes it.

    Attributes:
        path: the file it was read from; error messages name it.
        port: ``/dev/ttyACM0``, ``COM3``, or one of `port.URLS`: ``socket://host:port``, …
        baudrate: bits per second; of no effect where there is no wire.
        format: ``frames`` (binary, with CRC), ``lines`` (ASCII), or the servos that are asked.
        unit: of the values in lines: ``counts``, ``rad`` or ``deg``; all else is in counts.
        counts_per_turn: counts of one turn of a joint.
        joints: in the order the device sends them.
        extra_columns: names of the numbers that it sends after them.
    """

    path: Path
    port: str
    baudrate: int
    format: str
    unit: str
    counts_per_turn: int
    joints: tuple[JointSpec, ...]
    extra_columns: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints, in the order the device sends them."""
        return tuple(joint.name for joint in self.joints)

    @property
    def numbers(self) -> int:
        """How many numbers it sends at a time."""
        return len(self.joints) + len(self.extra_columns)

    @property
    def turns(self) -> FloatArray:
        """(n,) what the device sends more when a joint has made a whole turn."""
        ratio = np.array([joint.ratio for joint in self.joints], dtype=float)
        if self.unit != "counts":
            return ratio * (math.tau if self.unit == "rad" else 360.0)
        return ratio * [joint.counts_per_turn or self.counts_per_turn for joint in self.joints]

    @property
    def zeros(self) -> FloatArray:
        """(n,) what the device sends where a joint's angle is 0."""
        return np.array([joint.zero for joint in self.joints], dtype=float)

    @property
    def signs(self) -> IntArray:
        """(n,) the joints' signs."""
        return np.array([joint.sign for joint in self.joints], dtype=np.int64)

    def values(self, angles: ArrayLike) -> NDArray[np.number]:
        """(..., n) what the device sends for joint angles (..., n), rad: counts, rad or deg.

        Counts are the nearest ones from 0 to less than a turn of the joint's encoder.
        """
        radians = np.asarray(angles, dtype=float)
        values = radians * self.signs * (self.turns / math.tau) + self.zeros
        if self.unit != "counts":
            return values
        of_turn = np.rint(np.abs(self.turns)).astype(np.int64)
        return np.asarray(np.rint(values).astype(np.int64) % of_turn)


def columns_of(
    joints: Sequence[str], given: Sequence[str], arm: str, file: Path | None
) -> IntArray:
    """(n,) for each joint of an ``arm``, its place among those that a device gives.

    Raises:
        InputError: the device lacks one; ``'jiont_3': did you mean 'joint_3'?`` where it can.
    """
    missing = [name for name in joints if name not in given]
    if missing:
        unmatched = (name for name in given if name not in joints)
        hints = (f"{n!r}: {hint}" for n in unmatched if (hint := did_you_mean(n, missing)))
        hint = next(hints, f"add {', '.join(missing)}")
        device, expected = (
            f"the joints {', '.join(given)}",
            (f"the joints of {arm}: {', '.join(joints)}"),
        )
        raise InputError(device, expected, file=file, where="joints", hint=hint)
    return np.array([given.index(name) for name in joints], dtype=np.intp)
