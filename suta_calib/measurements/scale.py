"""How well the unit of a body's, or of an instrument's, lengths is known.

Whatever makes all of them longer by one factor makes the arm longer by it, and leaves no residual.
So the factor is stated, not estimated: its relative standard deviation, by hand or by a grade.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from suta_calib.measurements.fields import Field, Fields, Value
from suta_calib.measurements.yaml_file import YamlSection

# One standard deviation of a common scale error. Certified: a coordinate measuring machine or a
# laser tracker of about 5 + L/200 µm, and a few kelvin of steel (12 ppm/K). Machined: ISO 2768-f
# over some 300 mm (0.15 mm as a limit). Printed: printers feed paper, or shrink plastic, by 0.2 to
# 1 %.
GRADES: Final = {"certified": 20e-6, "machined": 200e-6, "printed": 5000e-6}
PPM: Final = 1e-6
# Of an instrument of which nobody says it: laser trackers have 10, good camera systems 100 ppm.
INSTRUMENT_PPM: Final = 20.0


@dataclass(frozen=True)
class LengthScale:
    """Relative standard deviation of one factor on all lengths of a body or of an instrument.

    Attributes:
        std: of the factor, as a ratio (20 ppm are 2e-5).
        grade: of `GRADES` by which it is known; empty where a number was stated.
    """

    std: float
    grade: str = ""

    @classmethod
    def of_grade(cls, grade: str) -> LengthScale:
        """The scale of something of one of the `GRADES`."""
        return cls(GRADES[grade], grade)

    @property
    def ppm(self) -> float:
        """`std` in parts per million."""
        return self.std / PPM

    @property
    def measured(self) -> bool:
        """Whether somebody stated it; otherwise only the grade says it."""
        return not self.grade or self.std != GRADES[self.grade]

    @property
    def in_ppm(self) -> str:
        """`std` for a reader: ``20 ppm``, ``5,000 ppm``."""
        return f"{self.ppm:,.0f} ppm" if self.ppm >= 100 else f"{self.ppm:.3g} ppm"

    @property
    def sentence(self) -> str:
        """How it is known: ``certified, 20 ppm``."""
        return f"{self.grade}, {self.in_ppm}" if self.grade else self.in_ppm

    def row(self) -> dict[str, Any]:
        """Keys and values of a file."""
        graded = {"grade": self.grade} if self.grade else {}
        by_grade = graded and self.std == GRADES[self.grade]
        return graded if by_grade else {**graded, "scale_ppm": round(self.ppm, 9)}


def read_stretch(section: YamlSection, scale: LengthScale | None) -> float | None:
    """``stretch`` of a file: the prior of the stretch along x and y, a ratio; None where fixed."""
    printed = scale is not None and scale.grade == "printed"
    choice = section.choice("stretch", ("free", "fixed"), "free" if printed else "fixed")
    return None if choice == "fixed" else stretch_prior(scale)


def stretch_prior(scale: LengthScale | None) -> float:
    """Standard deviation of the stretch along x, and of that along y, a ratio.

    A stated scale was measured along both sides. A grade is that of the common factor, the mean of
    the two, so each of them varies by the root of two more.
    """
    if scale is None or scale.std == 0:
        scale = LengthScale.of_grade("printed")
    return scale.std if scale.measured else math.sqrt(2) * scale.std


def scale_row(scale: LengthScale | None, stretch: float | None) -> dict[str, Any]:
    """The keys ``grade``, ``scale_ppm`` and ``stretch`` of a file, but for defaults."""
    printed = scale is not None and scale.grade == "printed"
    row = {} if scale is None else scale.row()
    if printed == (stretch is not None):
        return row
    return row | {"stretch": "fixed" if printed else "free"}


def read_scale(section: YamlSection) -> LengthScale | None:
    """``grade`` and ``scale_ppm`` of a file or a row; None where it has neither."""
    if "grade" not in section and "scale_ppm" not in section:
        return None
    grade = section.choice("grade", GRADES) if "grade" in section else ""
    if "scale_ppm" not in section:
        return LengthScale.of_grade(grade)
    ppm = section.number("scale_ppm", "non-negative")
    # 10 %, beyond which it is a unit.
    largest_ppm = 1e5
    if ppm > largest_ppm:
        raise section.refuse(
            f"{ppm:g} ppm",
            f"at most {largest_ppm:g} ppm, which are {largest_ppm * PPM:.0%}",
            at=("scale_ppm",),
            hint="the lengths may be in another unit than mm",
        )
    return LengthScale(ppm * PPM, grade)


# Whichever of the two is there, both are read.
SCALE_KEYS: Final = Fields(
    Field(
        "grade",
        Value("certified, machined or printed", lambda section, _: read_scale(section)),
        "How it was made. This determines the standard deviation of the scale factor of all its "
        "lengths: 20, 200 or 5,000 ppm.",
        given_attribute="scale",
    ),
    Field(
        "scale_ppm",
        Value("ppm", lambda section, _: read_scale(section)),
        "Standard deviation of the scale factor of all its lengths, instead of that of the "
        "grade; 0 for lengths that are exact by definition.",
        given_attribute="scale",
    ),
)
# Its default follows from the grade: `read_stretch`.
STRETCH: Final = Field(
    "stretch",
    Value("free or fixed"),
    "free: the stretch along x and along y is estimated. Its prior is scale_ppm; without it, 1.4 "
    "times the standard deviation of the grade (5,000 ppm without grade), so that the mean of both "
    "varies by the grade. Default: free for the grade printed, else fixed.",
)
BODY_KEYS: Final = Fields(*SCALE_KEYS, STRETCH)
