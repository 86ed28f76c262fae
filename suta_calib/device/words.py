"""Encoder words: a position, two flags and a CRC in 32 bits.

``00 | position (22 bits) | nError | nWarning | crc (6 bits)``, right-aligned; a flag is raised
when its bit is 0, so that a dead line does not look like a good position.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import BoolArray
from suta_calib.device.crc import WordArray, word_crc

POSITIONS: Final = 1 << 22
_NO_ERROR: Final = np.uint32(1 << 7)
_NO_WARNING: Final = np.uint32(1 << 6)

ERROR_MEANING: Final = "error: the encoder's position is not valid"
WARNING_MEANING: Final = "warning: the position is valid, but the encoder is near its limits"
ERROR_ADVICE: Final = "check the magnet's (or scale's) distance and place, and the encoder's supply"


class Words(NamedTuple):
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

    def take(self, rows: BoolArray) -> Words:
        """The words of some rows."""
        return Words(self.counts[rows], self.error[rows], self.warning[rows], self.good[rows])


def unpack_words(words: WordArray) -> Words:
    """Take encoder words apart: any shape of uint32."""
    payload: WordArray = (words >> np.uint32(6)) & np.uint32(0xFFFFFF)
    return Words(
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
    """Encoder words of positions, as an encoder would send them.

    Args:
        counts: (n,) 0 … 2²² - 1.
        error: (n,) where the error flag is to be raised; nowhere by default.
        warning: (n,) the same for the warning flag.

    Raises:
        ValueError: a position that 22 bits do not hold.
    """
    positions = np.asarray(counts, dtype=np.int64)
    if ((positions < 0) | (positions >= POSITIONS)).any():
        raise ValueError(f"encoder positions from 0 to {POSITIONS - 1} expected, found {positions}")
    no_error = 1 - np.asarray(np.zeros_like(positions) if error is None else error, dtype=np.int64)
    no_warning = 1 - np.asarray(
        np.zeros_like(positions) if warning is None else warning, dtype=np.int64
    )
    payload = (positions << 2 | no_error << 1 | no_warning).astype(np.uint32)
    words: WordArray = payload << np.uint32(6) | word_crc(payload)
    return words
