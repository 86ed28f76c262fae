"""Encoder words: a position, two flags and a CRC in 32 bits.

``00 | position (22 bits) | nError | nWarning | crc (6 bits)``, right-aligned; a flag is raised
when its bit is 0, so that a dead line does not look like a good position.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

import anycrc
import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.device.description import FRAME_COUNTS_PER_TURN

WordArray = NDArray[np.uint32]
POSITIONS: Final = FRAME_COUNTS_PER_TURN
_NO_ERROR: Final = np.uint32(1 << 7)
_NO_WARNING: Final = np.uint32(1 << 6)


@cache
def frame_crc() -> Callable[[Any], int]:
    """CRC-16/CCITT-FALSE of bytes: polynomial 0x1021, init 0xFFFF (check value 0x29B1)."""
    calculate: Callable[[Any], int] = anycrc.Model("CRC16-CCITT-FALSE").calc
    return calculate


@cache
def _tables() -> tuple[WordArray, WordArray]:
    """CRC-6 of 24 bits by their upper and lower twelve: it is linear before the inversion."""
    crc = anycrc.CRC(6, 0x03, 0, False, False, 0)
    upper = [crc.calc((value << 12).to_bytes(3, "big")) for value in range(1 << 12)]
    lower = [crc.calc(value.to_bytes(3, "big")) for value in range(1 << 12)]
    return np.array(upper, dtype=np.uint32), np.array(lower, dtype=np.uint32)


def word_crc(payload: WordArray) -> WordArray:
    """CRC-6 of 24 bits as sent: polynomial x⁶ + x + 1 (0x43), init 0, MSB first, inverted."""
    upper, lower = _tables()
    crc: WordArray = upper[payload >> 12] ^ lower[payload & 0xFFF] ^ np.uint32(0x3F)
    return crc


class EncoderWords(NamedTuple):
    """What encoder words say; every field has the words' shape.

    Attributes:
        counts: position, 0 … 2²² - 1.
        error: the error flag is raised.
        warning: the warning flag is raised.
        good: the CRC fits and nothing is left of the 30 bits; the rest means nothing otherwise.
    """

    counts: NDArray[np.int64]
    error: BoolArray
    warning: BoolArray
    good: BoolArray


def unpack_words(words: WordArray) -> EncoderWords:
    """Take encoder words apart: any shape of uint32."""
    payload: WordArray = (words >> np.uint32(6)) & np.uint32(0xFFFFFF)
    return EncoderWords(
        counts=(payload >> 2).astype(np.int64),
        error=(words & _NO_ERROR) == 0,
        warning=(words & _NO_WARNING) == 0,
        good=(word_crc(payload) == (words & 0x3F)) & (words < (1 << 30)),
    )


def pack_words(
    counts: ArrayLike,
    error: Sequence[bool] | BoolArray | None = None,
    warning: Sequence[bool] | BoolArray | None = None,
) -> WordArray:
    """Encoder words of positions (n,), 0 … 2²² - 1, as sent; flags are raised nowhere by default.

    Raises:
        ValueError: a position that 22 bits do not hold.
    """
    positions = np.asarray(counts, dtype=np.int64)
    if ((positions < 0) | (positions >= POSITIONS)).any():
        raise ValueError(f"encoder positions from 0 to {POSITIONS - 1} expected, found {positions}")
    no_error, no_warning = (
        np.ones_like(positions) if raised is None else 1 - np.asarray(raised, dtype=np.int64)
        for raised in (error, warning)
    )
    payload = (positions << 2 | no_error << 1 | no_warning).astype(np.uint32)
    words: WordArray = payload << np.uint32(6) | word_crc(payload)
    return words


def angles_from_counts(counts: IntArray, sign: IntArray, per_turn: int) -> FloatArray:
    """Joint angles in (-π, π], rad, to the last bit: the wrapping is done on whole numbers.

    Args:
        counts: (..., n) encoder positions.
        sign: (n,) +1 or -1.
        per_turn: counts of one turn.
    """
    # ceil(per_turn / 2) - 1 is the largest count above -π that is still wanted below zero.
    below = (per_turn + 1) // 2 - 1
    centred = (counts * sign + below) % per_turn - below
    return np.asarray(centred * (math.tau / per_turn), dtype=float)
