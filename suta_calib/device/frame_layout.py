"""Where things are in a frame, and how one is written."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from suta_calib.arrays import BoolArray
from suta_calib.device.crc import frame_crc
from suta_calib.device.description import MOST_JOINTS
from suta_calib.device.words import pack_words

HEADER: Final = b"\xaa\x55"
FIELDS: Final = struct.Struct("<HIB")  # sequence number, time in µs, number of words
CRC: Final = struct.Struct("<H")
FIELDS_AT: Final = len(HEADER)
WORDS_AT: Final = FIELDS_AT + FIELDS.size
SEQUENCES: Final = 1 << 16
MICROSECONDS: Final = 1 << 32


def frame_size(count: int) -> int:
    """Bytes of a frame of ``count`` words."""
    return WORDS_AT + 4 * count + CRC.size


def encode_frame(
    sequence: int,
    time_us: int,
    counts: Sequence[int],
    error: Sequence[bool] | BoolArray | None = None,
    warning: Sequence[bool] | BoolArray | None = None,
) -> bytes:
    """One frame, as a device would send it.

    Args:
        sequence: any whole number; its lowest 16 bits are sent.
        time_us: µs; its lowest 32 bits are sent.
        counts: one encoder position per joint, 0 … 2²² - 1.
        error: joints whose error flag is raised; none by default.
        warning: joints whose warning flag is raised; none by default.

    Raises:
        ValueError: a position that 22 bits do not hold, or more than 255 joints.
    """
    if len(counts) > MOST_JOINTS:
        raise ValueError(f"at most {MOST_JOINTS} joints expected, found {len(counts)}")
    words = pack_words(counts, error, warning).astype("<u4").tobytes()
    body = FIELDS.pack(sequence % SEQUENCES, time_us % MICROSECONDS, len(counts)) + words
    return HEADER + body + CRC.pack(frame_crc()(body))
