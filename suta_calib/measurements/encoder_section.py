"""The section ``encoders`` of a job: what is known of their noise beforehand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from suta_calib.measurements.yaml_section import YamlSection

_KEYS: Final = ("bits", "noise_deg", "noise_mm")
_MOST_BITS: Final = 52


@dataclass(frozen=True)
class EncoderSpec:
    """What is known of the encoders beforehand: only the error budget asks.

    Attributes:
        bits: revolute joints read whole steps of 2π / 2^bits; None where that is not known.
        noise_rad: standard deviation of a revolute joint's reading, rad, beside the steps.
        noise_m: the same of a prismatic joint's, m.
    """

    bits: int | None = None
    noise_rad: float = 0.0
    noise_m: float = 0.0


def read_encoders(section: YamlSection) -> EncoderSpec:
    """Read and check the section.

    Raises:
        InputError: of the section's own class: an unknown key or an unusable value.
    """
    section.check_keys(_KEYS)
    bits = section.integer("bits", 0, minimum=1) if "bits" in section else None
    if bits is not None and bits > _MOST_BITS:
        raise section.refuse(str(bits), f"at most {_MOST_BITS} bits", at=("bits",))
    return EncoderSpec(
        bits,
        section.optional_number("noise_deg", "non-negative", math.pi / 180) or 0.0,
        section.optional_number("noise_mm", "non-negative", 1e-3) or 0.0,
    )
