"""A camera with a rolling shutter: it takes one row of the picture after the other.

A point that is seen in row v of a picture was seen ``v · line delay`` later than the picture began.
Each corner has a pose of the arm of its own, so a moving arm shows how long a row takes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError
from suta_calib.measurements.fields import Field, Value, fields_of, keyed
from suta_calib.measurements.yaml_file import YamlSection
from suta_calib.model.parameters import Parameter
from suta_calib.units import from_us, us

LINE_OWNER: Final = "line_delay"
# Rows of pictures take some 5 to 50 µs; a millisecond of it would be a picture in a second.
LONGEST: Final = 1e-3


def _us(section: YamlSection, name: str) -> float:
    return _below(section, name, section.number(name, "non-negative"))


def _positive_us(section: YamlSection, name: str) -> float:
    return _below(section, name, section.number(name, "positive"))


def _below(section: YamlSection, name: str, value: float) -> float:
    if from_us(value) > LONGEST:
        expected = f"µs, at most {us(LONGEST):g}"
        hint = "it is the time of one row, not of the whole picture"
        raise section.refuse(f"{value:g}", expected, at=(name,), hint=hint)
    return from_us(value)


@dataclass(frozen=True)
class LineDelay(Displayable):
    """How long a row of a picture takes: the key ``line_delay_us`` of a camera's row.

    Attributes:
        value: as it is known, s.
        bound: largest difference from it, s; None for one that is as given.
        prior: standard deviation of the difference before any data, s; None where nobody knows.
    """

    value: float = keyed(Value("µs", _us), "Time of one row; default: 0.", 0.0, "value")
    bound: float | None = keyed(
        Value("µs", _positive_us), "Largest difference from it.", None, "bound"
    )
    prior: float | None = keyed(
        Value("µs", _positive_us),
        "Standard deviation of the difference before any data.",
        None,
        "prior",
    )

    def __post_init__(self) -> None:
        for name in ("value", "bound", "prior"):
            size = getattr(self, name)
            if size is not None and not 0.0 <= size <= LONGEST:
                expected = f"s, from 0 to {LONGEST:g}"
                raise ParameterError(f"{size!r}", expected, where=f"LineDelay: {name}")

    @property
    def longest(self) -> float:
        """As long as a row may take, s."""
        if self.bound is not None:
            return self.value + self.bound
        return self.value + 5.0 * (self.prior or 0.0)

    def parameter(self, label: str) -> Parameter:
        """The unknown ``line_delay[label]``, or what is given of it."""
        half = math.inf if self.bound is None else self.bound
        given = self.bound is None and self.prior is None
        return Parameter(
            *(f"{LINE_OWNER}[{label}]", "", "s", self.value),
            *(self.value - half, self.value + half, self.prior, math.nan),
            free=not given,
            prior_fixed=True,
        )


_KEYS: Final = fields_of(LineDelay)


def _read(section: YamlSection, name: str) -> LineDelay:
    if not isinstance(section.data.get(name), dict):
        return LineDelay(_us(section, name))
    inside = section.section(name)
    given: dict[str, Any] = _KEYS.read(inside)
    if not {"bound", "prior"} & given.keys():
        raise inside.refuse("no bound and no prior", f"one of them, or {name}: NUMBER")
    return LineDelay(**given)


LINE_DELAY: Final = Field(
    "line_delay_us",
    Value("µs, or a mapping", _read, _KEYS),
    "Rolling shutter: time from one row of the picture to the next, as a number if it is known; "
    "with bound or prior it is estimated. time_offset_ms must stand beside it.",
    given_attribute="line_delay",
)


def rolled(pixels_at: Callable[[float], FloatArray], delay: float, height: float) -> FloatArray:
    """(n, points, 2) pixels in a picture whose rows are taken one after the other.

    Args:
        pixels_at: (n, points, 2) where the points are so many seconds after the picture began.
        delay: of a row, s.
        height: of the picture, rows.
    """
    if delay == 0.0:
        return pixels_at(0.0)
    # A parabola through the beginning, the middle and the end.
    span = delay * height
    begin, middle, end = (pixels_at(share * span) for share in (0.0, 0.5, 1.0))
    slope, bend = 4.0 * middle - 3.0 * begin - end, 2.0 * (begin + end) - 4.0 * middle
    pixels = begin
    for _ in range(10):
        # What is out of the picture is in no row of it.
        share = np.clip(pixels[..., 1:] / height, 0.0, 1.0)
        pixels = begin + share * (slope + share * bend)
    return np.asarray(pixels)
