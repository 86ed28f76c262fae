"""What a device said at one moment, and what went wrong on the way."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Final, Self

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.display import Displayable

ERROR_MEANING: Final = "error: the encoder's position is not valid"
WARNING_MEANING: Final = "warning: the position is valid, but the encoder is near its limits"
ERROR_ADVICE: Final = (
    "check the distance and position of the magnet (or scale), and the encoder's supply"
)

NO_EXTRA: Final[FloatArray] = np.zeros(0)
NO_EXTRA.setflags(write=False)


@dataclass(frozen=True, eq=False, slots=True)
class Reading(Displayable):
    """All joints at one moment.

    Attributes:
        sequence: number of the frame, unwrapped: it only grows.
        time: s, the device's clock, unwrapped; for lines, which carry none, ``arrival``.
        angles: (n,) rad in (-π, π], sign applied, in the order of `DeviceSpec.joints`.
        error: (n,) the encoder says that its position is not valid.
        warning: (n,) the encoder says that its position is valid, but near its limits.
        arrival: s, `time.perf_counter` of this computer when the last byte had been read.
        extra: (m,) numbers of `DeviceSpec.extra_columns`; NaN where the device had none.
    """

    sequence: int
    time: float
    angles: FloatArray
    error: BoolArray
    warning: BoolArray
    arrival: float
    extra: FloatArray = field(default_factory=lambda: NO_EXTRA)


@dataclass(eq=False)
class Statistics(Displayable):
    """What has passed since the device was opened; counts only grow.

    Attributes:
        joints: names, in the order of the arrays below.
        frames: good frames (or lines): one reading each.
        gaps: places where the sequence number jumped.
        lost_frames: frames missing there.
        frame_crc_errors: frames with a damaged frame CRC (lines: with unreadable numbers).
        word_crc_errors: frames that arrived whole, but with an encoder word whose own CRC is wrong.
        garbage_bytes: bytes that belong to no frame, good or damaged.
        stale_readings: dropped on start, or after an interruption, because they were old.
        interruptions: how often the connection was lost, or the device's clock jumped.
        error_flags: (n,) readings of each joint with its error flag raised.
        warning_flags: (n,) the same for the warning flag.
        joint_crc_errors: (n,) wrong encoder words by joint.
    """

    joints: Sequence[str]
    frames: int = 0
    gaps: int = 0
    lost_frames: int = 0
    frame_crc_errors: int = 0
    word_crc_errors: int = 0
    garbage_bytes: int = 0
    stale_readings: int = 0
    interruptions: int = 0
    error_flags: IntArray = field(init=False)
    warning_flags: IntArray = field(init=False)
    joint_crc_errors: IntArray = field(init=False)

    def __post_init__(self) -> None:
        for name in ("error_flags", "warning_flags", "joint_crc_errors"):
            setattr(self, name, np.zeros(len(self.joints), dtype=np.int64))

    def copy(self) -> Self:
        """An independent snapshot."""
        return deepcopy(self)

    def restore(self, other: Statistics) -> None:
        """Take over the counts of a snapshot, in place."""
        for name, value in vars(other).items():
            setattr(self, name, value.copy() if isinstance(value, np.ndarray) else value)
