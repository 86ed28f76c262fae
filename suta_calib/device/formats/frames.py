"""The framed format: ``AA 55 | seq u16 | time_us u32 | n u8 | n x u32 | crc16``, little-endian.

A frame is believed when its header, its number of words, its CRC-16 and the CRC-6 and spare bits
of every word fit: of random bytes, at one position in 2^(40 + 8n); 2^88 for six joints.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray
from suta_calib.device.clock import DeviceClock
from suta_calib.device.description import DeviceSpec
from suta_calib.device.formats.base import Decoder, Encoder, Format, Sample
from suta_calib.device.formats.encoder_words import (
    POSITIONS,
    WordArray,
    angles_from_counts,
    frame_crc,
    pack_words,
    unpack_words,
)
from suta_calib.device.reading import Reading
from suta_calib.errors import WrongFormatError

HEADER: Final = b"\xaa\x55"
FIELDS: Final = struct.Struct("<HIB")  # sequence number, time in µs, number of words
CRC: Final = struct.Struct("<H")
FIELDS_AT: Final = len(HEADER)
WORDS_AT: Final = FIELDS_AT + FIELDS.size
COUNT_AT: Final = WORDS_AT - 1
SEQUENCES: Final = 1 << 16
# A frame says how many words it has in one byte.
MOST_JOINTS: Final = 255


def frame_size(count: int) -> int:
    """Bytes of a frame of ``count`` words."""
    return WORDS_AT + 4 * count + CRC.size


def crc_fits(buffer: bytearray, at: int, end: int) -> bool:
    """Whether the frame from ``at`` to ``end`` has the CRC-16 that its bytes give."""
    (crc,) = CRC.unpack_from(buffer, end - CRC.size)
    return bool(frame_crc()(buffer[at + FIELDS_AT : end - CRC.size]) == crc)


def encode_frame(
    sequence: int,
    time_us: int,
    counts: Sequence[int] | NDArray[Any],
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
    body = FIELDS.pack(sequence % SEQUENCES, time_us % (1 << 32), len(counts)) + words
    return HEADER + body + CRC.pack(frame_crc()(body))


class OtherCount:
    """Watches for frames of another number of joints while none of the right number come."""

    def __init__(self, spec: DeviceSpec) -> None:
        self._spec = spec
        self._buffer = bytearray()
        self._enough = 1
        self._in_a_row = 0

    def feed(self, data: bytes, *, expected_seen: bool) -> None:
        """Take the next bytes; ``expected_seen``: frames of the right number ended among them."""
        if expected_seen:
            self._buffer.clear()
            # Once a device has sent frames of the right count, damage is likelier than a change of
            # device.
            self._enough, self._in_a_row = 3, 0
        else:
            self._buffer += data
            del self._buffer[: self._search()]

    def _search(self) -> int:
        """Look at every frame that is complete; up to where the buffer is done with."""
        buffer, at = self._buffer, 0
        while (at := buffer.find(HEADER, at)) >= 0:
            if at + WORDS_AT > len(buffer):
                return at
            count = buffer[at + COUNT_AT]
            end = at + frame_size(count)
            if end > len(buffer):
                return at
            words = np.frombuffer(bytes(buffer[at + WORDS_AT : end - CRC.size]), dtype="<u4")
            ours = count in (0, len(self._spec.joints))
            if ours or not (crc_fits(buffer, at, end) and unpack_words(words).good.all()):
                at += 1
                continue
            at = end
            self._in_a_row += 1
            if self._in_a_row >= self._enough:
                buffer.clear()
                raise WrongFormatError(
                    f"{self._spec.port}: found frames of {count} joint{'s' * (count != 1)}; "
                    f"expected {len(self._spec.joints)}, as many as {self._spec.path} lists "
                    "under 'joints'; list there every joint that the device sends, in the same "
                    "order"
                )
        return len(buffer) - buffer.endswith(HEADER[:1])


class FramesDecoder(Decoder):
    """`Decoder` of the framed format.

    After a frame that cannot be believed the search goes on one byte further, so that ``AA 55``
    inside data never costs the true frame behind it.
    """

    def __init__(self, spec: DeviceSpec) -> None:
        super().__init__(spec)
        self._count = len(spec.joints)
        self._zeros = spec.zeros.astype(np.int64)
        self._size = frame_size(self._count)
        self._clock = DeviceClock()
        self._other_count = OtherCount(spec)
        # Where in the buffer the bytes begin that are in no frame so far, nor counted as garbage.
        self._claimed = 0
        # Sequence numbers of frames since the last reading that came whole but for a word: they
        # are no readings, and they are not lost.
        self._damaged: set[int] = set()

    def feed(self, data: bytes, arrival: float) -> list[Reading]:
        """Take the next bytes and give the readings they complete."""
        self._buffer += data
        starts, end = self._scan()
        readings = self._readings(starts, arrival) if starts else []
        self._claim(end, end)
        self._claimed -= end
        del self._buffer[:end]
        self._other_count.feed(data, expected_seen=bool(readings))
        return readings

    def resume(self, after: Reading | None) -> None:
        """Begin anew after an interruption; time goes on by this computer's clock."""
        self._buffer.clear()
        self._damaged.clear()
        self._claimed = 0
        if after is not None:
            self._clock.resume(after.sequence, after.time, after.arrival)

    def _scan(self) -> tuple[list[int], int]:
        """Frames with a good CRC-16, and where the search is to go on when more bytes are there."""
        buffer, size, length = self._buffer, self._size, len(self._buffer)
        starts: list[int] = []
        at = 0
        while (at := buffer.find(HEADER, at)) >= 0:
            if at + COUNT_AT >= length:
                return starts, at
            if buffer[at + COUNT_AT] != self._count:
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
        if not crc_fits(self._buffer, at, end):
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
        words, counts = unpack_words(self._words(starts)), self.statistics
        intact: BoolArray = np.asarray(words.good.all(axis=1))
        if not intact.all():
            counts.word_crc_errors += int((~intact).sum())
            counts.joint_crc_errors += (~words.good).sum(axis=0)
        if words.error.any():
            counts.error_flags += words.error[intact].sum(axis=0)
        if words.warning.any():
            counts.warning_flags += words.warning[intact].sum(axis=0)
        angles = angles_from_counts(words.counts - self._zeros, self._signs, POSITIONS)
        angles.setflags(write=False)
        readings = []
        for at, fits, row, error, warning in zip(
            starts, intact.tolist(), angles, words.error, words.warning, strict=True
        ):
            sent, time_us, _ = FIELDS.unpack_from(self._buffer, at + FIELDS_AT)
            if not fits:
                # Not the clock's business: what fits in all but a word may be no frame at all.
                self._damaged.add(sent)
                continue
            sequence, time, lost = self._clock.unwrap(sent, time_us, arrival)
            if self._damaged:
                missing = min(lost, SEQUENCES - 1)
                lost -= sum(0 < (sent - n) % SEQUENCES <= missing for n in self._damaged)
                self._damaged.clear()
            counts.gaps += lost > 0
            counts.lost_frames += lost
            readings.append(Reading(sequence, time, row, error, warning, arrival))
        counts.frames += len(readings)
        return readings


class FramesEncoder(Encoder):
    """`Encoder` of the framed format."""

    def packet(self, sample: Sample) -> bytes:
        """One frame."""
        return encode_frame(*sample[:5])


class FramesFormat(Format):
    """Binary frames with a number, a clock, flags and checksums, of encoder words of 22 bits."""

    name: ClassVar[str] = "frames"
    decoder: ClassVar[type[Decoder]] = FramesDecoder
    encoder: ClassVar[type[Encoder]] = FramesEncoder
    counts_per_turn: ClassVar[int | None] = POSITIONS
    most_joints: ClassVar[int | None] = MOST_JOINTS
    has_clock: ClassVar[bool] = True
    damaged: ClassVar[str] = "frames with a wrong CRC"
    damage: ClassVar[str] = "frames are damaged"
    near_miss: ClassVar[str] = "frame headers AA 55, but no frame with a correct CRC"
    header: ClassVar[bytes] = HEADER

    def expected(self, numbers: int) -> str:
        """``frames AA 55 … of 6 joints``."""
        return f"frames AA 55 … of {numbers} joints"

    def recognises(self, data: bytes) -> bool:
        """More headers than chance explains."""
        return data.count(HEADER) > 1 + len(data) // 1000

    def refusal(self, unit: str, counts_per_turn: int) -> tuple[str, str] | None:
        """Its words are counts of 22 bits."""
        if unit not in self.units:
            return "unit", "counts: frames contain encoder words of 22 bits"
        if counts_per_turn != POSITIONS:
            return "counts_per_turn", f"{POSITIONS}: the words of a frame contain 22-bit positions"
        return None
