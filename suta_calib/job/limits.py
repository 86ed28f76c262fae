"""Maximum permissible errors, the uncertainty of a test, and the rule that decides with both.

First what they are, then how they stand in a job file: µm, mm, checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.measurements.fields import (
    LENGTH_OR_0,
    Field,
    Fields,
    Value,
    choice,
    fields_of,
    keyed,
    mapping,
    quantity,
    read_as,
)
from suta_calib.measurements.yaml_file import Sign, YamlSection
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
_PLACES: Final = {
    "location": "For the location of one point from several articulations.",
    "size": "For the size of a probed sphere.",
    "form": "For the form of a probed sphere.",
    "repeatability": "For repeated visits of one point.",
}


def _micrometres(sign: Sign) -> Value:
    return Value("µm", lambda section, name: from_um(section.number(name, sign)))


def _of_place(name: str, sign: Sign, default: float | None) -> Any:
    return keyed(quantity("m", sign), _PLACES[name], default, f"{name}_mm")


_WORST: Final[tuple[Decision, ...]] = ("fail", "undecided", "pass", "no limit")


@dataclass(frozen=True)
class LengthLimit:
    """Maximum permissible error of a length, ``min(A + L/K, B)``; either part may be missing.

    The three forms in which ISO 10360 lets a maker state it: A + L/K, B, or the smaller of both.
    A (``constant``) and B (``largest``) are in m, ``slope`` is 1/K with A and L in one unit.
    """

    constant: float | None = keyed(_micrometres("non-negative"), "A of A + L/K.", None, "a_um")
    slope: float = keyed(
        # A in µm and L in mm make the usual K a thousandth of what it is in one unit.
        Value("number", lambda section, name: 1e-3 / section.number(name, "positive")),
        "K of A + L/K, with L in mm, as ISO 10360 writes it.",
        0.0,
        "k",
    )
    largest: float | None = keyed(
        _micrometres("positive"), "B: the largest value, for any length.", None, "max_um"
    )

    @classmethod
    def read(cls, parent: YamlSection, key: str) -> LengthLimit:
        """``{a_um: A, k: K, max_um: B}``: A + L/K, at most B, as ISO 10360 writes it: L in mm.

        Raises:
            InputError: a key that is unknown or unusable, or too few of them.
        """
        section = parent.section(key)
        limit = read_as(cls, section)
        if "k" in section and limit.constant is None:
            raise section.refuse("k without a_um", "both: A + L/K", at=("k",))
        if limit.constant is None and limit.largest is None:
            raise section.refuse(
                "neither a_um nor max_um", "A + L/K, at most B: a_um and k, or max_um"
            )
        return limit

    def at(self, length: FloatArray) -> FloatArray:
        """Limit (n,) at lengths (n,), m."""
        limit = np.full(len(length), np.inf)
        if self.constant is not None:
            limit = self.constant + self.slope * length
        return limit if self.largest is None else np.minimum(limit, self.largest)


@dataclass(frozen=True)
class Limits(Displayable):
    """Maximum permissible errors, m; None where no limit is given.

    They are E_Uni,MPE or E_Bi,MPE of a length, L_Dia,MPE of a location, P_Size,MPE and P_Form,MPE
    of a sphere, and the diameter of the sphere that holds repeated visits.
    """

    length: LengthLimit | None = keyed(
        Value("mapping", LengthLimit.read, fields_of(LengthLimit)),
        "For a length: A + L/K, at most B.",
        None,
    )
    location: float | None = _of_place("location", "positive", None)
    size: float | None = _of_place("size", "positive", None)
    form: float | None = _of_place("form", "positive", None)
    repeatability: float | None = _of_place("repeatability", "positive", None)

    @property
    def given(self) -> bool:
        """Whether there is any limit."""
        return self != Limits()


@dataclass(frozen=True)
class StatedUncertainty:
    """What the test itself is unsure of beside the calibrated artefact, and whatever the arm is.

    Expanded (k = 2), m: fixture, temperature, form of a sphere.
    """

    length: float = keyed(LENGTH_OR_0, "For a length.", 0.0)
    location: float = _of_place("location", "non-negative", 0.0)
    size: float = _of_place("size", "non-negative", 0.0)
    form: float = _of_place("form", "non-negative", 0.0)
    repeatability: float = _of_place("repeatability", "non-negative", 0.0)
    per_length: float = keyed(
        replace(_micrometres("non-negative"), takes="µm/m"),
        "For a length: a part in proportion to the length, added to length_mm.",
        0.0,
        "length_um_per_m",
    )


@dataclass(frozen=True)
class DecisionRule(Displayable):
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


def _read_limits(top: YamlSection, key: str) -> Limits:
    section = top.section(key)
    limits = read_as(Limits, section)
    for name, tested in _TESTED_BY.items():
        limit = name if name == "length" else f"{name}_mm"
        if limit in section and "job" not in top and tested not in top:
            raise section.refuse(
                "a limit without a test", f"a section {tested} in the job", at=(limit,)
            )
    return limits


# What errors are judged with, by attribute: `read_judged`.
JUDGED_KEYS: Final = Fields(
    Field(
        "mpe",
        Value("mapping", _read_limits, fields_of(Limits)),
        "Maximum permissible errors; without it no limits.",
        given_attribute="limits",
    ),
    Field(
        "uncertainty",
        mapping(StatedUncertainty),
        "Expanded uncertainties (k = 2) of the test itself; zero without it.",
    ),
    Field(
        "decision_rule",
        choice(("guarded", "simple")),
        "guarded (the default: an error that is within its uncertainty of a limit is undecided) "
        "or simple.",
        given_attribute="kind",
    ),
    Field(
        "coverage_factor",
        quantity(sign="positive"),
        "Coverage factor of the guard band; 2 without it.",
        given_attribute="factor",
    ),
)


def read_judged(top: YamlSection) -> dict[str, Any]:
    """What errors are judged with: limits, uncertainty and rule, as far as a job says them.

    Raises:
        InputError: an unusable key, a limit for what the job does not test, or a guard band that
            the rule does not have.
    """
    judged = JUDGED_KEYS.values(top)
    rule = DecisionRule(**{key: judged.pop(key) for key in ("kind", "factor") if key in judged})
    if rule.kind == "simple" and "coverage_factor" in top:
        raise top.refuse(
            "a guard band for the simple rule",
            "the rule guarded, or no key coverage_factor",
            at=("coverage_factor",),
        )
    return {**judged, "rule": rule}
