"""The two checksums of the framed format."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suta_calib.extras import load

WordArray = NDArray[np.uint32]


@cache
def frame_crc() -> Callable[[Any], int]:
    """CRC-16/CCITT-FALSE of bytes: polynomial 0x1021, init 0xFFFF; of ``123456789`` it is 0x29B1.

    Raises:
        MissingExtraError: the CRC library is not installed.
    """
    calculate: Callable[[Any], int] = load("anycrc", "device").Model("CRC16-CCITT-FALSE").calc
    return calculate


@cache
def _tables() -> tuple[WordArray, WordArray]:
    """CRC-6 of 24 bits by their upper and lower twelve: it is linear before the inversion."""
    crc = load("anycrc", "device").CRC(6, 0x03, 0, False, False, 0)
    upper = [crc.calc((value << 12).to_bytes(3, "big")) for value in range(1 << 12)]
    lower = [crc.calc(value.to_bytes(3, "big")) for value in range(1 << 12)]
    return np.array(upper, dtype=np.uint32), np.array(lower, dtype=np.uint32)


def word_crc(payload: WordArray) -> WordArray:
    """CRC-6 as encoders send it: polynomial x⁶ + x + 1 (0x43), init 0, MSB first, inverted.

    Args:
        payload: any shape; 24 bits each: position, nError, nWarning.

    Raises:
        MissingExtraError: the CRC library is not installed.
    """
    upper, lower = _tables()
    crc: WordArray = upper[payload >> 12] ^ lower[payload & 0xFFF] ^ np.uint32(0x3F)
    return crc
