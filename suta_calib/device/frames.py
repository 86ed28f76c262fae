"""The framed format: ``AA 55 | seq u16 | time_us u32 | n u8 | n x u32 | crc16``, little-endian.

A frame is believed when its header, its number of words, its CRC-16 and the CRC-6 and spare bits
of every word fit: of random bytes, at one position in 2^(40 + 8n); 2^88 for six joints.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray
from suta_calib.device.clock import DeviceClock
from suta_calib.device.crc import WordArray, frame_crc
from suta_calib.device.description import FRAME_COUNTS_PER_TURN, DeviceSpec
from suta_calib.device.frame_layout import CRC, FIELDS, FIELDS_AT, HEADER, WORDS_AT, frame_size
from suta_calib.device.other_count import OtherCount
from suta_calib.device.reading import Reading, Statistics
from suta_calib.device.units import angles_from_counts, signs
from suta_calib.device.words import Words, unpack_words

_COUNT_AT: Final = WORDS_AT - 1


class FramesDecoder:
    """`Decoder` of the framed format.

    After a frame that cannot be believed the search goes on one byte further, so that ``AA 55``
    inside data never costs the true frame behind it.

    Attributes:
        statistics: what has passed through so far.
    """

    def __init__(self, spec: DeviceSpec) -> None:
        self.statistics = Statistics(spec.names)
        self._signs = signs(spec)
        self._count = len(spec.joints)
        self._size = frame_size(self._count)
        self._crc = frame_crc()
        self._clock = DeviceClock()
        self._other_count = OtherCount(spec)
        self._buffer = bytearray()
        # Where in the buffer the bytes begin that are in no frame so far, nor counted as garbage.
        self._claimed = 0

    def feed(self, data: bytes, arrival: float) -> list[Reading]:
        """Take the next bytes and give the readings they complete.

        Raises:
            WrongFormatError: good frames with another number of joints.
        """
        self._buffer += data
        starts, end = self._scan()
        readings = self._readings(starts, arrival) if starts else []
        self._claim(end, end)
        self._claimed -= end
        del self._buffer[:end]
        self._other_count.feed(data, seen=bool(readings))
        return readings

    def resume(self, after: Reading | None) -> None:
        """Begin anew after an interruption; time goes on by this computer's clock."""
        self._buffer.clear()
        self._claimed = 0
        if after is not None:
            self._clock.resume(after.sequence, after.time, after.arrival)

    def _scan(self) -> tuple[list[int], int]:
        """Frames with a good CRC-16, and where the search is to go on when more bytes are there."""
        buffer, size, length = self._buffer, self._size, len(self._buffer)
        starts: list[int] = []
        at = 0
        while (at := buffer.find(HEADER, at)) >= 0:
            if at + _COUNT_AT >= length:
                return starts, at
            if buffer[at + _COUNT_AT] != self._count:
                at += 1
            elif at + size > length:
                return starts, at
            else:
                at = self._examine(at, starts)
        return starts, length - buffer.endswith(HEADER[:1])

    def _examine(self, at: int, starts: list[int]) -> int:
        """Note the frame at ``at`` if its CRC-16 fits; where to look for the next one."""
        end = at + self._size
        self._claim(at, end)
        (crc,) = CRC.unpack_from(self._buffer, end - CRC.size)
        if self._crc(self._buffer[at + FIELDS_AT : end - CRC.size]) != crc:
            self.statistics.frame_crc_errors += 1
            return at + 1
        starts.append(at)
        # A frame whose words do not fit may be none, and a true one may begin inside it.
        inside = self._buffer.find(HEADER, at + 1, end)
        if inside < 0 and self._buffer[end - 1] == HEADER[0]:
            inside = end - 1
        if inside >= 0 and not unpack_words(self._words([at])).good.all():
            return inside
        return end

    def _claim(self, start: int, end: int) -> None:
        """Bytes before ``start`` that no frame has claimed are garbage; claim up to ``end``."""
        self.statistics.garbage_bytes += max(start - self._claimed, 0)
        self._claimed = max(self._claimed, end)

    def _words(self, starts: list[int]) -> WordArray:
        """(frames, joints) words of the frames that begin at ``starts``."""
        buffer, span = self._buffer, 4 * self._count
        data = b"".join([buffer[at + WORDS_AT : at + WORDS_AT + span] for at in starts])
        return np.frombuffer(data, dtype="<u4").reshape(len(starts), self._count)

    def _readings(self, starts: list[int], arrival: float) -> list[Reading]:
        words = unpack_words(self._words(starts))
        if not words.good.all():
            starts, words = self._without_bad(starts, words)
        self._count_flags(words)
        angles = angles_from_counts(words.counts, self._signs, FRAME_COUNTS_PER_TURN)
        angles.setflags(write=False)
        return [
            Reading(*self._moment(at, arrival), row, error, warning, arrival)
            for at, row, error, warning in zip(
                starts, angles, words.error, words.warning, strict=True
            )
        ]

    def _without_bad(self, starts: list[int], words: Words) -> tuple[list[int], Words]:
        good: BoolArray = np.asarray(words.good.all(axis=1))
        self.statistics.word_crc_errors += int((~good).sum())
        self.statistics.joint_crc_errors += (~words.good).sum(axis=0)
        kept = [at for at, fits in zip(starts, good.tolist(), strict=True) if fits]
        return kept, words.take(good)

    def _count_flags(self, words: Words) -> None:
        if words.error.any():
            self.statistics.error_flags += words.error.sum(axis=0)
        if words.warning.any():
            self.statistics.warning_flags += words.warning.sum(axis=0)

    def _moment(self, at: int, arrival: float) -> tuple[int, float]:
        """Unwrapped sequence number and time of the frame at ``at``, which is a good one."""
        sequence, time_us, _ = FIELDS.unpack_from(self._buffer, at + FIELDS_AT)
        sequence, time, lost = self._clock.unwrap(sequence, time_us, arrival)
        self.statistics.frames += 1
        self.statistics.gaps += lost > 0
        self.statistics.lost_frames += lost
        return sequence, time
