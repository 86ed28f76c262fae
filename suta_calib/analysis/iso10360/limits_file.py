"""Limits, uncertainty and decision rule as they stand in a job file: µm, mm, checked."""

from __future__ import annotations

from typing import Final, cast

from suta_calib.analysis.iso10360.limits import (
    EXPANDED,
    DecisionRule,
    LengthLimit,
    Limits,
    Rule,
    StatedUncertainty,
)
from suta_calib.measurements import YamlSection

JUDGED_KEYS: Final = ("mpe", "uncertainty", "decision_rule", "coverage_factor")
# What is limited, and the section of the job that tests it.
_TESTED_BY: Final = {
    "length": "lengths",
    "location": "articulation",
    "size": "probing",
    "form": "probing",
    "repeatability": "repeatability",
}
_PLACES: Final = ("location", "size", "form", "repeatability")
_M_PER_UM: Final = 1e-6
_M_PER_MM: Final = 1e-3


def read_limits(top: YamlSection) -> Limits:
    """The key ``mpe`` of a job; without it there are no limits.

    Raises:
        InputError: an unknown or unusable key, or a limit for what the job does not test.
    """
    if "mpe" not in top:
        return Limits()
    section = top.section("mpe")
    section.check_keys(("length", *(f"{name}_mm" for name in _PLACES)))
    for name, tested in _TESTED_BY.items():
        key = name if name == "length" else f"{name}_mm"
        if key in section and "job" not in top and tested not in top:
            raise section.refuse(
                "a limit for what is not tested", f"a section {tested} in the job", at=(key,)
            )
    length = _length(section.section("length")) if "length" in section else None
    places = {name: _mm(section, f"{name}_mm", "positive") for name in _PLACES}
    return Limits(length, **places)


def _length(section: YamlSection) -> LengthLimit:
    """``{a_um: A, k: K, max_um: B}``: A + L/K, at most B, as ISO 10360 writes it: L in mm."""
    section.check_keys(("a_um", "k", "max_um"))
    if "k" in section and "a_um" not in section:
        raise section.refuse("k without a_um", "both: A + L/K", at=("k",))
    if "a_um" not in section and "max_um" not in section:
        raise section.refuse("neither a_um nor max_um", "A + L/K, at most B: a_um and k, or max_um")
    # A in µm and L in mm make the usual K a thousandth of what it is in one unit.
    slope = 1e-3 / section.number("k", "positive") if "k" in section else 0.0
    constant = section.optional_number("a_um", "non-negative", _M_PER_UM)
    return LengthLimit(constant, slope, section.optional_number("max_um", "positive", _M_PER_UM))


def read_uncertainty(top: YamlSection) -> StatedUncertainty:
    """The key ``uncertainty`` of a job: expanded uncertainties (k = 2)."""
    if "uncertainty" not in top:
        return StatedUncertainty()
    section = top.section("uncertainty")
    names = ("length", *_PLACES)
    section.check_keys((*(f"{name}_mm" for name in names), "length_um_per_m"))
    lengths = {name: _mm(section, f"{name}_mm", "non-negative") or 0.0 for name in names}
    slope = section.optional_number("length_um_per_m", "non-negative", _M_PER_UM) or 0.0
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


def _mm(section: YamlSection, key: str, sign: str) -> float | None:
    return section.optional_number(key, sign, _M_PER_MM)  # type: ignore[arg-type]
