from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from device_streams import device, frames, same
from hypothesis import given, settings
from hypothesis import strategies as st

from suta_calib.device.description import JointSpec
from suta_calib.device.diagnosis import remarks
from suta_calib.device.formats import decoder_for, encode_frame
from suta_calib.device.formats.encoder_words import frame_crc
from suta_calib.device.reading import Reading
from suta_calib.errors import WrongFormatError

SIX = device()


def decode(data: bytes, spec=SIX) -> list[Reading]:
    return decoder_for(spec).feed(data, 0.0)


def sequences(readings: list[Reading]) -> list[int]:
    return [reading.sequence for reading in readings]


def test_the_layout_of_a_frame() -> None:
    frame = encode_frame(0x0102, 0x03040506, [0, 1])
    body = bytes.fromhex("0201 06050403 02 FA000000 F6010000")
    assert frame == b"\xaa\x55" + body + struct.pack("<H", frame_crc()(body))


def test_a_frame_says_what_was_put_in() -> None:
    spec = device(joints=(JointSpec("a", 1), JointSpec("b", -1), JointSpec("c", 1)))
    frame = encode_frame(7, 2_500_000, [1 << 20, 1 << 20, 1 << 21], [0, 1, 0], [0, 0, 1])
    decoder = decoder_for(spec)
    (reading,) = decoder.feed(frame, 12.5)
    assert (reading.sequence, reading.time, reading.arrival) == (7, 2.5, 12.5)
    np.testing.assert_array_equal(reading.angles, [math.pi / 2, -math.pi / 2, math.pi])
    assert reading.error.tolist() == [False, True, False]
    assert reading.warning.tolist() == [False, False, True]
    assert decoder.statistics.error_flags.tolist() == [0, 1, 0]
    assert decoder.statistics.warning_flags.tolist() == [0, 0, 1]
    assert decoder.statistics.frames == 1


def test_every_single_bit_error_is_detected() -> None:
    before, frame, after = frames([0, 1, 2])
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << (bit % 8)
        decoder = decoder_for(SIX)
        readings = decoder.feed(before + bytes(damaged) + after, 0.0)
        assert sequences(readings) == [0, 2], f"bit {bit}"
        assert decoder.statistics.lost_frames == 1


@st.composite
def streams(draw: st.DrawFn) -> tuple[bytes, int]:
    """Frames with garbage between them, and how many bytes of the beginning are missing."""
    pieces: list[bytes] = []
    garbage = st.one_of(
        st.binary(max_size=40),
        st.sampled_from([b"\xaa", b"\xaa\x55", b"\xaa\x55\0\0\0\0\0\0\x06", b"\xaa\xaa\x55"]),
        st.integers(1, 34).map(lambda cut: frames([9])[0][:cut]),
    )
    for frame in frames(range(draw(st.integers(1, 6)))):
        pieces += [draw(garbage) if draw(st.booleans()) else b"", frame]
    pieces.append(draw(garbage))
    return b"".join(pieces), draw(st.integers(0, 34))


@given(streams(), st.lists(st.integers(1, 90), min_size=1, max_size=8))
def test_the_pieces_bytes_come_in_make_no_difference(
    stream: tuple[bytes, int], cuts: list[int]
) -> None:
    data, missing = stream
    data = data[missing:]
    whole, bytewise, chunked = (decoder_for(SIX) for _ in range(3))
    expected = whole.feed(data, 0.0)
    one_by_one = [r for k in range(len(data)) for r in bytewise.feed(data[k : k + 1], 0.0)]
    pieces, at = [], 0
    while at < len(data):
        size = cuts[len(pieces) % len(cuts)]
        pieces += [data[at : at + size]]
        at += size
    in_chunks = [r for piece in pieces for r in chunked.feed(piece, 0.0)]
    # Nothing that is complete is lost, whatever stands between.
    complete = [n for n, f in enumerate(frames(range(6))) if data.count(f)]
    assert sequences(expected) == complete
    assert same(expected, one_by_one)
    assert same(expected, in_chunks)
    for other in (bytewise.statistics, chunked.statistics):
        assert {k: np.asarray(v).tolist() for k, v in vars(other).items()} == {
            k: np.asarray(v).tolist() for k, v in vars(whole.statistics).items()
        }


@settings(max_examples=50)
@given(st.binary(max_size=3000))
def test_random_bytes_give_nothing_and_break_nothing(data: bytes) -> None:
    decoder = decoder_for(SIX)
    assert decoder.feed(data, 0.0) == []
    assert sequences(decoder.feed(frames([5])[0], 0.0)) == [5]


def test_a_header_inside_the_data_does_not_cost_the_next_frame() -> None:
    # Bytes 10 and 11 of this frame are AA 55, and byte 18 is a 6 where the count would stand.
    false = encode_frame(0, 0, [0x55AA, 0, 6, 0, 0, 0])
    assert false[10:12] == b"\xaa\x55"
    assert false[18] == 6
    true = frames([1, 2])
    assert sequences(decode(false[5:] + b"".join(true))) == [1, 2]
    assert sequences(decode(false + b"".join(true))) == [0, 1, 2]


def test_a_frame_inside_one_with_a_crc_that_happens_to_fit_is_found() -> None:
    (true,) = frames([3])
    tail = bytes(15) + true[:13]
    for first in range(1 << 16):
        body = struct.pack("<HIB", first, 0, 6) + tail[:24]
        if frame_crc()(body) == struct.unpack("<H", (tail + true[13:15])[24:26])[0]:
            break
    else:
        pytest.fail("no number makes the CRC fit")
    outer = b"\xaa\x55" + struct.pack("<HIB", first, 0, 6) + tail[:24]
    start = outer.find(true[:9])
    data = outer[:start] + true
    assert frame_crc()(data[2:33]) == struct.unpack("<H", data[33:35])[0]
    decoder = decoder_for(SIX)
    assert sequences(decoder.feed(data, 0.0)) == [3]
    assert decoder.statistics.word_crc_errors == 1


def with_wrong_word(frame: bytes) -> bytes:
    """A frame that came whole, but for the word of joint 4, whose own CRC is wrong."""
    damaged = bytearray(frame)
    damaged[9 + 4 * 3 + 1] ^= 0x10
    damaged[-2:] = struct.pack("<H", frame_crc()(bytes(damaged[2:-2])))
    return bytes(damaged)


def test_a_wrong_word_in_a_good_frame_is_no_reading_and_no_lost_frame() -> None:
    good, damaged, last = frames([0, 1, 2])
    decoder = decoder_for(SIX)
    assert sequences(decoder.feed(good + with_wrong_word(damaged) + last, 0.0)) == [0, 2]
    counts = decoder.statistics
    assert (counts.word_crc_errors, counts.frame_crc_errors, counts.garbage_bytes) == (1, 0, 0)
    assert counts.joint_crc_errors.tolist() == [0, 0, 0, 1, 0, 0]
    assert (counts.lost_frames, counts.gaps) == (0, 0)
    assert all("too slow" not in said for said in remarks(counts, SIX))


def test_lost_frames_are_those_that_did_not_come() -> None:
    """308 words of 2,000 are wrong, and 40 frames are lost, over the number's end."""
    random = np.random.default_rng(5)
    inner = random.permutation(np.arange(1, 1_999))
    wrong, lost = set(inner[:308].tolist()), set(inner[308:348].tolist())
    decoder = decoder_for(SIX)
    for n in range(2_000):
        frame = encode_frame(65_000 + n, n * 1302, [n] * 6)
        if n not in lost:
            decoder.feed(with_wrong_word(frame) if n in wrong else frame, n / 768)
    counts = decoder.statistics
    assert (counts.word_crc_errors, counts.lost_frames) == (308, 40)
    assert counts.frames == 2_000 - 348


def test_bytes_that_are_in_no_frame_are_counted() -> None:
    first, second, third = frames([0, 1, 2])
    broken = bytearray(second)
    broken[20] ^= 1
    decoder = decoder_for(SIX)
    decoder.feed(first[30:] + first + b"\x00" * 7 + bytes(broken) + third, 0.0)
    counts = decoder.statistics
    assert (counts.garbage_bytes, counts.frame_crc_errors, counts.frames) == (5 + 7, 1, 2)


def test_missing_frames_are_counted_through_the_wrap() -> None:
    decoder = decoder_for(SIX)
    data = b"".join(frames([65530, 65531, 65534, 65535, 65536, 65540]))
    assert sequences(decoder.feed(data, 0.0)) == [65530, 65531, 65534, 65535, 65536, 65540]
    assert (decoder.statistics.gaps, decoder.statistics.lost_frames) == (2, 2 + 3)


@pytest.mark.parametrize("count", [1, 5, 7, 60])
def test_frames_of_another_number_of_joints_are_named(count: int) -> None:
    frame, decoder = frames([0], count)[0], decoder_for(SIX)
    for byte in frame[:-1]:
        assert decoder.feed(bytes([byte]), 0.0) == []
    message = rf"frames of {count} joints?; expected 6.*device\.yaml"
    with pytest.raises(WrongFormatError, match=message):
        decoder.feed(frame[-1:], 0.0)
    with pytest.raises(WrongFormatError, match=message):
        decode(frame)


def test_one_odd_frame_among_good_ones_is_taken_for_damage() -> None:
    good, odd = frames([0])[0], b"".join(frames([0, 1], 5))
    decoder = decoder_for(SIX)
    assert len(decoder.feed(good, 0.0)) == 1
    assert decoder.feed(odd, 0.0) == []
    with pytest.raises(WrongFormatError):
        decoder.feed(odd, 0.0)


def test_an_interruption_does_not_join_what_does_not_belong_together() -> None:
    first, second, third = frames([10, 11, 500])
    decoder = decoder_for(SIX)
    (before,) = decoder.feed(first + second[:20], 100.0)
    decoder.resume(before)
    (after,) = decoder.feed(second[20:] + third, 103.0)
    assert (after.sequence, after.time) == (11, pytest.approx(before.time + 3.0))
    assert decoder.statistics.lost_frames == 0


def test_more_joints_than_a_byte_can_count_are_refused() -> None:
    with pytest.raises(ValueError, match="255"):
        encode_frame(0, 0, [0] * 256)
