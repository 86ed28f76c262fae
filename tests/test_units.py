"""Numbers as a reader sees them."""

from __future__ import annotations

import math

import pytest

from suta_calib.units import Unit, std_text, with_std


@pytest.mark.parametrize(
    ("std", "unit", "shown"),
    [
        (math.radians(0.02), "rad", "0.020 deg"),
        (math.radians(2.449), "rad", "2.4 deg"),
        (6.72e-5, "m", "0.067 mm"),
        (9.96e-5, "m", "0.10 mm"),
        (0.1234, "m", "123 mm"),
        (3e-9, "m", "0.0000030 mm"),
        (0.0, "m", "0.000 mm"),
        (math.nan, "m", "–"),
        (None, "m", "–"),
    ],
)
def test_a_standard_deviation_has_two_digits(std: float | None, unit: Unit, shown: str) -> None:
    assert std_text(std, unit).removesuffix(" mm") == shown.removesuffix(" mm")


def test_a_value_ends_where_its_standard_deviation_does() -> None:
    assert with_std(1.25e-3, 2e-5, "m") == "1.250 ± 0.020 mm"
    assert with_std(1.25e-3, 0.5, "m", sign=True) == "+1 ± 500 mm"
    assert with_std(math.radians(-0.3), math.radians(0.12), "rad") == "-0.30 ± 0.12 deg"
