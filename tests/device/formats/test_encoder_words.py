from __future__ import annotations

import math

import numpy as np
import pytest
from device_streams import device
from hypothesis import given
from hypothesis import strategies as st

from suta_calib.device.description import JointSpec
from suta_calib.device.formats.encoder_words import (
    angles_from_counts,
    frame_crc,
    pack_words,
    unpack_words,
    word_crc,
)
from suta_calib.device.formats.lines import angles_from_values

TURN = 1 << 22


@pytest.mark.parametrize(
    ("position", "word"),
    [(0, 0x000000FA), (1, 0x000001F6), (0x3FFFFF, 0x3FFFFFEF), (123456, 0x01E240FE)],
)
def test_the_words_of_the_specification(position: int, word: int) -> None:
    assert pack_words([position]).tolist() == [word]
    words = unpack_words(np.array([word], dtype=np.uint32))
    assert words.counts.tolist() == [position]
    assert words.good.all()
    assert not words.error.any()
    assert not words.warning.any()


def test_the_check_value_of_the_frame_crc() -> None:
    assert frame_crc()(b"123456789") == 0x29B1


def long_division(payload: int) -> int:
    """CRC-6 by the definition: remainder of payload · x⁶ by x⁶ + x + 1, inverted."""
    remainder = payload << 6
    for bit in range(29, 5, -1):
        if remainder >> bit & 1:
            remainder ^= 0x43 << (bit - 6)
    return remainder ^ 0x3F


@given(st.integers(0, 0xFFFFFF))
def test_the_word_crc_is_a_polynomial_division(payload: int) -> None:
    assert word_crc(np.array([payload], dtype=np.uint32)).tolist() == [long_division(payload)]


@given(st.integers(0, TURN - 1), st.booleans(), st.booleans(), st.integers(0, 31))
def test_every_single_bit_error_of_a_word_is_seen(
    position: int, error: bool, warning: bool, bit: int
) -> None:
    word = pack_words([position], [error], [warning])
    back = unpack_words(word)
    assert (back.counts[0], back.error[0], back.warning[0]) == (position, error, warning)
    assert back.good[0]
    assert not unpack_words(word ^ np.uint32(1 << bit)).good[0]


def test_positions_of_more_than_22_bits_are_refused() -> None:
    for position in (-1, TURN):
        with pytest.raises(ValueError, match="4194303"):
            pack_words([0, position])


@given(st.lists(st.integers(0, TURN - 1), min_size=1, max_size=7), st.sampled_from([1, -1]))
def test_counts_survive_the_way_to_angles_and_back(counts: list[int], sign: int) -> None:
    spec = device(joints=tuple(JointSpec(f"j{k}", sign) for k in range(len(counts))))
    angles = angles_from_counts(np.array(counts), np.full(len(counts), sign), TURN)
    assert (angles > -math.pi).all()
    assert (angles <= math.pi).all()
    np.testing.assert_allclose(
        np.exp(1j * angles), np.exp(2j * np.pi * sign * np.array(counts) / TURN), atol=1e-14
    )
    assert spec.values(angles).tolist() == counts


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("turn", [TURN, 4095])
def test_half_a_turn_is_plus_pi(sign: int, turn: int) -> None:
    half = np.array([turn // 2])
    assert angles_from_counts(half, np.array([sign]), turn)[0] * sign == pytest.approx(
        math.tau * (turn // 2) / turn * (sign if turn % 2 == 0 else 1), abs=1e-15
    )
    exact = angles_from_values(np.array([180.0]), np.array([sign]), 360.0)
    assert exact.tolist() == [math.pi]


@pytest.mark.parametrize(
    ("unit", "expected"), [("counts", 4096 - 512), ("deg", -45.0), ("rad", -math.pi / 4)]
)
def test_values_of_lines_are_in_the_unit_of_the_device(unit: str, expected: float) -> None:
    spec = device(format="lines", unit=unit, counts_per_turn=4096, joints=(JointSpec("a", -1),))
    assert spec.values([math.pi / 4]) == pytest.approx(expected)
