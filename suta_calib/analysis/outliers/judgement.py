"""The verdict on a search for outliers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from suta_calib.analysis.outliers.result import METRICS, Group, Level, TermOutliers
from suta_calib.assessment import Assessment
from suta_calib.solver.solution import Solution
from suta_calib.terms import GROUPINGS

GROUPING_NOUN: Final = {f"{noun}s": noun for noun in GROUPINGS}
WORDS: Final = {
    "contribution": "error contribution",
    "cooks_distance": "Cook's distance",
    "leave_one_out": "leave-one-out RMS",
    "bias": "bias",
}


def verdict_on(solution: Solution, terms: Sequence[TermOutliers]) -> Assessment:
    """What a reader must know: outliers first, then what is suspect or was set aside."""
    bad = [] if solution.converged else [f"The calibration itself: {solution.sentence}."]
    bad += [_exact(t) for t in terms if t.exact]
    outliers = [s for t in terms for level in t.levels for s in _outliers(level)]
    suspects = [s for t in terms for level in t.levels for s in _suspects(level)]
    gross = [_gross(t) for t in terms if t.touches]
    return Assessment.of(_sentence(terms), bad=bad, care=[*outliers, *suspects, *gross])


def _sentence(terms: Sequence[TermOutliers]) -> str:
    if not any(t.levels for t in terms):
        return "nothing was looked at"
    named = [
        f"{GROUPING_NOUN[level.name]} {', '.join(g.label for g in level.outliers)}"
        for t in terms
        for level in t.levels
        if level.outliers
    ]
    if named:
        return f"unlike the others: {'; '.join(named)}"
    looked = dict.fromkeys(GROUPING_NOUN[level.name] for t in terms for level in t.levels)
    return f"no {' and no '.join(looked)} is unlike the others"


def _outliers(level: Level) -> list[str]:
    return [f"{_named(level, g)}: {_told(g)}{_where(g)}." for g in level.outliers]


def _suspects(level: Level) -> list[str]:
    return [f"{_named(level, g)} is suspect, not proven: {_told(g)}." for g in level.suspects]


def _named(level: Level, group: Group) -> str:
    return f"{GROUPING_NOUN[level.name].capitalize()} {group.label}"


def _told(group: Group) -> str:
    words = ", ".join(WORDS[flag] for flag in group.flags)
    if len(group.flags) == len(METRICS):
        return f"all four metrics name it ({words})"
    return f"{len(group.flags)} of 4 metrics name it ({words})"


def _where(group: Group) -> str:
    if group.displacement is None:
        return ""
    x, y, z = 1e3 * group.displacement.vector
    std = 1e3 * float(np.max(group.displacement.std))
    return (
        f"; it was touched {x:+.2f}, {y:+.2f}, {z:+.2f} mm from its certified position "
        f"(artefact's x, y, z; ±{std:.2f} mm)"
    )


def _exact(term: TermOutliers) -> str:
    return (
        f"The {term.samples} samples of {term.kind} are fitted exactly: there are as many unknowns "
        "as data. Nothing can be unlike the others; measure more, or select fewer parameters."
    )


def _gross(term: TermOutliers) -> str:
    n = len(term.touches)
    worst = max(term.touches, key=lambda t: t.size)
    are, were, them, first = (
        ("is", "was", "it", "") if n == 1 else ("are", "were", "them", "worst ")
    )
    return (
        f"{n} of {term.samples} single touches {are} far beyond the noise of "
        f"{1e3 * term.sigma:.2g} mm per axis and {were} set aside for these figures, not for the "
        f"calibration, whose loss weighs {them} down: {first}{worst.what} "
        f"({worst.origin}), {1e3 * worst.size:.1f} mm."
    )
