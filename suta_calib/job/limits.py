"""Maximum permissible errors, the uncertainty of a test, and the rule that decides with both.

First what they are, then how they stand in a job file: µm, mm, checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, cast

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.measurements.keys import Key, Keys
from suta_calib.measurements.yaml_file import YamlSection
from suta_calib.units import from_um

Decision = Literal["pass", "undecided", "fail", "no limit"]
Rule = Literal["guarded", "simple"]
# Expanded uncertainties are given, as usual, for twice the standard uncertainty.
EXPANDED: Final = 2.0
# What is limited, and the section of the job that tests it.
_TESTED_BY: Final = {
    "length": "lengths",
    "location": "articulation",
    "size": "probing",
    "form": "probing",
    "repeatability": "repeatability",
}
LENGTH_LIMIT_KEYS: Final = Keys(
    Key("a_um", "µm", "A of A + L/K."),
    Key("k", "number", "K of A + L/K, with L in mm, as ISO 10360 writes it."),
    Key("max_um", "µm", "B: at most that, however long."),
)
_OF_PLACES: Final = (
    ("location", "the location of one point from several articulations"),
    ("size", "the size of a probed sphere"),
    ("form", "the form of a probed sphere"),
    ("repeatability", "repeated visits of one point"),
)
LIMIT_KEYS: Final = Keys(
    Key("length", "mapping", "Of a length: A + L/K, at most B.", inside=LENGTH_LIMIT_KEYS),
    *(Key(f"{name}_mm", "mm", f"Of {what}.") for name, what in _OF_PLACES),
)
UNCERTAINTY_KEYS: Final = Keys(
    Key("length_mm", "mm", "Of a length."),
    *(Key(f"{name}_mm", "mm", f"Of {what}.") for name, what in _OF_PLACES),
    Key("length_um_per_m", "µm/m", "Of a length, beside length_mm, by its length."),
)
JUDGED_KEYS: Final = Keys(
    Key("mpe", "mapping", "Maximum permissible errors; without it no limits.", inside=LIMIT_KEYS),
    Key(
        "uncertainty",
        "mapping",
        "Expanded uncertainties (k = 2) of the test itself; zero without it.",
        inside=UNCERTAINTY_KEYS,
    ),
    Key(
        "decision_rule",
        "text",
        "guarded (the default: an error that is within its uncertainty of a limit is undecided) "
        "or simple.",
    ),
    Key("coverage_factor", "number", "Of the guard band; 2 without it."),
)
_PLACES: Final = tuple(name for name, _ in _OF_PLACES)
_WORST: Final[tuple[Decision, ...]] = ("fail", "undecided", "pass", "no limit")


@dataclass(frozen=True)
class LengthLimit:
    """Maximum permissible error of a length, ``min(A + L/K, B)``; either part may be missing.

    The three forms in which ISO 10360 lets a maker state it: A + L/K, B, or the smaller of both.

    Attributes:
        constant: A, m; None where only the largest is given.
        slope: 1/K with A and L in one unit, m/m.
        largest: B, m; None where there is none.
    """

    constant: float | None = None
    slope: float = 0.0
    largest: float | None = None

    def at(self, length: FloatArray) -> FloatArray:
        """Limit (n,) at lengths (n,), m."""
        limit = np.full(len(length), np.inf)
        if self.constant is not None:
            limit = self.constant + self.slope * length
        return limit if self.largest is None else np.minimum(limit, self.largest)


@dataclass(frozen=True)
class Limits:
    """Maximum permissible errors, m; None where no limit is given.

    Attributes:
        length: of a length, E_Uni,MPE or E_Bi,MPE.
        location: of the place found from several articulations, L_Dia,MPE.
        size: of the diameter of a sphere, P_Size,MPE.
        form: of the scatter of radial distances on a sphere, P_Form,MPE.
        repeatability: of the sphere that holds repeated visits, its diameter.
    """

    length: LengthLimit | None = None
    location: float | None = None
    size: float | None = None
    form: float | None = None
    repeatability: float | None = None

    @property
    def given(self) -> bool:
        """Whether there is any limit."""
        return self != Limits()


@dataclass(frozen=True)
class StatedUncertainty:
    """What the test itself is unsure of beside the calibrated artefact, and whatever the arm is.

    Expanded (k = 2), m: fixture, temperature, form of a sphere.

    Attributes:
        length: of a length, whatever its size.
        per_length: of a length, m per m.
        location, size, form, repeatability: of these.
    """

    length: float = 0.0
    per_length: float = 0.0
    location: float = 0.0
    size: float = 0.0
    form: float = 0.0
    repeatability: float = 0.0


@dataclass(frozen=True)
class DecisionRule:
    """How a value, its uncertainty and its limit become a decision; ISO 14253-1.

    Attributes:
        kind: ``guarded``: conformity is proved where ``|value| ≤ limit - g``, non-conformity
            where ``|value| > limit + g``, and between them nothing is; ``simple``: pass up to the
            limit.
        factor: g in standard uncertainties. ISO 14253-1:2017 takes 1.65 for a limit on one side
            and 95 %; 2 is its former rule, g = U (k = 2), and on the safe side.
    """

    kind: Rule = "guarded"
    factor: float = EXPANDED

    def guard(self, expanded: FloatArray | float) -> FloatArray:
        """Guard band for an expanded uncertainty (k = 2), m."""
        if self.kind == "simple":
            return np.zeros_like(np.asarray(expanded, dtype=float))
        return np.asarray(self.factor / EXPANDED * np.asarray(expanded, dtype=float))

    def decide(self, value: float, limit: float | None, expanded: float) -> Decision:
        """On one value, m; the sign of the value does not count."""
        if limit is None:
            return "no limit"
        guard = float(self.guard(expanded))
        # A value on the limit passes, whatever is left of it in binary.
        size = abs(value) * (1 - 1e-12)
        if size <= limit - guard:
            return "pass"
        return "fail" if size > limit + guard else "undecided"


def worst(decisions: Sequence[Decision]) -> Decision:
    """Of several: all must pass."""
    return min(decisions, key=_WORST.index, default="no limit")


def read_limits(top: YamlSection) -> Limits:
    """The key ``mpe`` of a job; without it there are no limits.

    Raises:
        InputError: an unknown or unusable key, or a limit for what the job does not test.
    """
    if "mpe" not in top:
        return Limits()
    section = top.section("mpe")
    LIMIT_KEYS.check(section)
    for name, tested in _TESTED_BY.items():
        key = name if name == "length" else f"{name}_mm"
        if key in section and "job" not in top and tested not in top:
            raise section.refuse(
                "a limit for what is not tested", f"a section {tested} in the job", at=(key,)
            )
    length = _length(section.section("length")) if "length" in section else None
    places = {n: section.optional_number(f"{n}_mm", "positive", unit="m") for n in _PLACES}
    return Limits(length, **places)


def _length(section: YamlSection) -> LengthLimit:
    """``{a_um: A, k: K, max_um: B}``: A + L/K, at most B, as ISO 10360 writes it: L in mm."""
    LENGTH_LIMIT_KEYS.check(section)
    if "k" in section and "a_um" not in section:
        raise section.refuse("k without a_um", "both: A + L/K", at=("k",))
    if "a_um" not in section and "max_um" not in section:
        raise section.refuse("neither a_um nor max_um", "A + L/K, at most B: a_um and k, or max_um")
    # A in µm and L in mm make the usual K a thousandth of what it is in one unit.
    slope = 1e-3 / section.number("k", "positive") if "k" in section else 0.0
    constant = section.optional_number("a_um", "non-negative", from_um(1.0))
    return LengthLimit(constant, slope, section.optional_number("max_um", "positive", from_um(1.0)))


def read_uncertainty(top: YamlSection) -> StatedUncertainty:
    """The key ``uncertainty`` of a job: expanded uncertainties (k = 2)."""
    if "uncertainty" not in top:
        return StatedUncertainty()
    section = top.section("uncertainty")
    names = ("length", *_PLACES)
    UNCERTAINTY_KEYS.check(section)
    lengths = {
        name: section.optional_number(f"{name}_mm", "non-negative", unit="m") or 0.0
        for name in names
    }
    slope = section.optional_number("length_um_per_m", "non-negative", from_um(1.0)) or 0.0
    return StatedUncertainty(per_length=slope, **lengths)


def read_rule(top: YamlSection) -> DecisionRule:
    """The keys ``decision_rule`` (guarded, the default, or simple) and ``coverage_factor``."""
    kind = cast(Rule, top.choice("decision_rule", ("guarded", "simple"), "guarded"))
    factor = top.optional_number("coverage_factor", "positive")
    if kind == "simple" and factor is not None:
        raise top.refuse(
            "a guard band for the simple rule", "guarded, or no such key", at=("coverage_factor",)
        )
    return DecisionRule(kind, EXPANDED if factor is None else factor)
