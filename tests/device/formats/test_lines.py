from __future__ import annotations

import math

import numpy as np
import pytest
from device_streams import device, same
from hypothesis import given
from hypothesis import strategies as st

from suta_calib.device.description import JointSpec
from suta_calib.device.formats import decoder_for, encode_line
from suta_calib.errors import WrongFormatError

JOINTS = tuple(JointSpec(name, sign) for name, sign in (("a", 1), ("b", -1), ("c", 1)))
SPECS = {
    unit: device(format="lines", unit=unit, counts_per_turn=4096, joints=JOINTS)
    for unit in ("counts", "rad", "deg")
}


@pytest.mark.parametrize("unit", SPECS)
@given(angles=st.lists(st.floats(-3.14, math.pi), min_size=3, max_size=3))
def test_angles_survive_a_line(unit: str, angles: list[float]) -> None:
    spec = SPECS[unit]
    line = encode_line(spec.values(angles), spec)
    (reading,) = decoder_for(spec).feed(b"\n" + line, 5.0)
    step = math.tau / 4096 if unit == "counts" else 1e-8
    turned = np.angle(np.exp(1j * (reading.angles - angles)))
    assert np.abs(turned).max() <= 0.51 * step
    assert (reading.sequence, reading.time, reading.arrival) == (0, 5.0, 5.0)
    assert not reading.error.any()
    assert not reading.warning.any()


def test_the_end_of_a_line_is_not_taken_for_a_line() -> None:
    readings = decoder_for(SPECS["counts"]).feed(b"23,1,2\n1024,1024,2048\r\n", 0.0)
    assert len(readings) == 1
    np.testing.assert_allclose(readings[0].angles, [math.pi / 2, -math.pi / 2, math.pi])


@given(
    st.lists(
        st.one_of(
            st.tuples(*[st.integers(-4096, 4096)] * 3).map(
                lambda row: ",".join(map(str, row)).encode() + b"\n"
            ),
            st.sampled_from([b"\n", b"\r\n", b"1,2\n", b"1,2,x\n", b"nan,1,2\n", b"1_0,2,3\n"]),
            st.binary(max_size=300),
        ),
        max_size=12,
    ),
    st.integers(1, 17),
)
def test_the_pieces_lines_come_in_make_no_difference(pieces: list[bytes], size: int) -> None:
    data = b"".join(pieces)
    whole, bytewise, chunked = (decoder_for(SPECS["counts"]) for _ in range(3))

    def feed(decoder, step: int) -> list:
        found = []
        for at in range(0, len(data), step):
            found += decoder.feed(data[at : at + step], 0.0)
        return found

    try:
        expected = feed(whole, max(len(data), 1))
    except WrongFormatError:
        for decoder, step in ((bytewise, 1), (chunked, size)):
            with pytest.raises(WrongFormatError):
                feed(decoder, step)
        return
    assert same(expected, feed(bytewise, 1))
    assert same(expected, feed(chunked, size))


def test_damaged_lines_are_counted_and_left_out() -> None:
    decoder = decoder_for(SPECS["deg"])
    data = b"\n1,2,3\n1,2\xff,3\n1,,3\ninf,1,2\n1e999,1,2\n4,5,6\n"
    readings = decoder.feed(data, 0.0)
    np.testing.assert_allclose(
        np.rad2deg([r.angles for r in readings]), [[1, -2, 3], [4, -5, 6]], atol=1e-12
    )
    assert (decoder.statistics.frames, decoder.statistics.frame_crc_errors) == (2, 4)


def test_an_endless_line_does_not_fill_the_memory() -> None:
    decoder = decoder_for(SPECS["counts"])
    for _ in range(100):
        assert decoder.feed(b"\x00" * 1000, 0.0) == []
    assert decoder.statistics.garbage_bytes > 99_000
    assert len(decoder.feed(b"7,8,9\n1,2,3\n", 0.0)) == 1


def test_lines_of_another_number_of_values_are_named() -> None:
    with pytest.raises(WrongFormatError, match=r"'1,2', of 2 values; expected 3.*device\.yaml"):
        decoder_for(SPECS["counts"]).feed(b"\n" + b"1,2\n" * 3, 0.0)


@pytest.mark.parametrize(
    ("unit", "line", "words"),
    [
        ("counts", b"1,9000,3\n", "one turn, 4096 counts.*counts_per_turn"),
        ("rad", b"1,90,3\n", "one turn, 6.2831.* rad.*unit"),
        ("deg", b"1,4096,3\n", "one turn, 360 deg.*unit"),
    ],
)
def test_values_of_more_than_a_turn_do_not_fit(unit: str, line: bytes, words: str) -> None:
    decoder = decoder_for(SPECS[unit])
    assert decoder.feed(b"\n" + line * 2, 0.0) == []  # may be damage
    with pytest.raises(WrongFormatError, match=words):
        decoder.feed(line, 0.0)


@pytest.mark.parametrize("unit", ["counts", "rad", "deg"])
def test_zero_gear_and_counts_of_each_joint(unit: str) -> None:
    """A servo with its zero in the middle, and a counter behind a gear: there and back."""
    joints = (
        JointSpec("a", 1, 2048.0 if unit == "counts" else 1.5),
        JointSpec("b", -1, 100.0 if unit == "counts" else -0.5, 3.0, 1000),
    )
    spec = device(format="lines", unit=unit, counts_per_turn=4096, joints=joints)
    angles = np.array([[0.0, 0.0], [1.0, -2.0], [-3.0, 3.0]])
    values = spec.values(angles)
    if unit == "counts":
        assert values[0].tolist() == [2048, 100]
        assert values[1].tolist() == [2048 + round(4096 / math.tau), 100 + round(6000 / math.tau)]
    decoder = decoder_for(spec)
    decoder.feed(b"\n", 0.0)
    readings = [r for row in values for r in decoder.feed(encode_line(row, spec), 0.0)]
    got = np.array([reading.angles for reading in readings])
    step = {"counts": math.tau / 2048, "rad": 1e-9, "deg": 1e-9}[unit]
    np.testing.assert_allclose(got, angles, rtol=0, atol=step)


# ── Numbers beside those of the joints ────────────────────────────────────────────────────────
EXTRA = device(format="lines", unit="rad", joints=JOINTS, extra_columns=("ax", "ay"))


def test_further_numbers_come_after_those_of_the_joints() -> None:
    line = encode_line([0.1, 0.2, 0.3], EXTRA, [9.81, -0.125])
    assert line == b"0.1,0.2,0.3,9.81,-0.125\n"
    (reading,) = decoder_for(EXTRA).feed(b"\n" + line, 0.0)
    np.testing.assert_allclose(reading.angles, [0.1, -0.2, 0.3], atol=1e-12)
    assert reading.extra.tolist() == [9.81, -0.125]


@pytest.mark.parametrize("cells", [b"nan,1", b" NaN ,1", b",1", b"-nan,1", b"1e999,1", b"inf,1"])
def test_a_number_that_is_missing_costs_no_joint(cells: bytes) -> None:
    decoder = decoder_for(EXTRA)
    readings = decoder.feed(b"\n" + 5 * (b"0.1,0.2,0.3," + cells + b"\n"), 0.0)
    assert len(readings) == 5
    assert decoder.statistics.frame_crc_errors == 0
    for reading in readings:
        assert np.isfinite(reading.extra).tolist() == [False, True]


@pytest.mark.parametrize("line", [b"nan,0.2,0.3,1,2\n", b"0.1,,0.3,1,2\n", b"0.1,0.2,0.3,1,x\n"])
def test_a_joint_without_a_number_is_damage(line: bytes) -> None:
    decoder = decoder_for(EXTRA)
    assert decoder.feed(b"\n" + 5 * line, 0.0) == []
    assert decoder.statistics.frame_crc_errors == 5


def test_missing_or_unnamed_further_numbers_are_named() -> None:
    words = r"of 3 values; expected 5.*under 'joints' and 'extra_columns'"
    with pytest.raises(WrongFormatError, match=words):
        decoder_for(EXTRA).feed(b"\n" + 3 * b"0.1,0.2,0.3\n", 0.0)
    with pytest.raises(WrongFormatError, match=r"of 5 values; expected 3.*name them under 'extra_"):
        decoder_for(SPECS["rad"]).feed(b"\n" + 3 * b"0.1,0.2,0.3,0,9.8\n", 0.0)
