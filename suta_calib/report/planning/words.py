"""What the plan says in sentences: how far from the best, when to stop, what stays open."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Final

import numpy as np

from suta_calib.analysis.planning import Plan
from suta_calib.analysis.planning.remedies import Remedy
from suta_calib.report.planning.json import MM

_MOST_NAMES: Final = 5


def plan_sentences(found: Plan) -> list[str]:
    """Efficiency, the random choice, when to stop, what was looked at."""
    return [_efficiency(found), _random(found), _stop(found), _looked_at(found)]


def remedy_sentences(found: Plan) -> list[str]:
    """For every open parameter: what determines it, or that nothing here does."""
    sentences = [_able(remedy) for remedy in found.remedies if remedy.by_all]
    never = [r for r in found.remedies if not r.by_all]
    for advice, group in groupby(sorted(never, key=lambda r: r.advice), key=lambda r: r.advice):
        names = ", ".join(r.parameter for r in group)
        sentences.append(f"No candidate can determine {names}: {advice or 'all leave it open'}.")
    return sentences


def _able(remedy: Remedy) -> str:
    why = f" ({remedy.why})" if remedy.why else ""
    if not remedy.candidates:
        return f"{remedy.parameter} is open{why}; only several candidates together determine it."
    sorts = " or ".join(remedy.sorts)
    return (
        f"{remedy.parameter} is open{why}. Determined by a {sorts}: "
        f"{_some(remedy.candidates)}; by no other sort of candidate."
    )


def _efficiency(found: Plan) -> str:
    best = found.best
    if best.tip >= best.present:
        return (
            "The present data tell more of the tip than as many samples at the best of these "
            f"candidates would ({MM * best.present:.3f} mm against {MM * best.tip:.3f} mm)."
        )
    return (
        f"As many samples as there are now, at the best {best.count} candidates "
        f"({_some(best.names)}), would give {MM * best.tip:.3f} mm instead of "
        f"{MM * best.present:.3f} mm: the present data are {_percent(best.efficiency)} efficient "
        f"for the tip, {_percent(best.d_efficiency)} for the parameters as a whole."
    )


def _random(found: Plan) -> str:
    median, least = np.median(found.random), found.random.min()
    return (
        f"{len(found.random)} random choices of {len(found.chosen)} reach {MM * median:.3f} mm "
        f"(median) and {MM * least:.3f} mm at best."
    )


def _stop(found: Plan) -> str:
    stop, ahead = found.stop, len(found.stop.tips) - 1
    percent = f"{100 * stop.least_gain:.0f} %"
    if stop.worthwhile is None:
        sentence = f"Each of {ahead} further candidates lessens the tip's uncertainty by {percent}."
    elif stop.worthwhile == 0:
        sentence = f"Even the first lessens the tip's uncertainty by less than {percent}: stop now."
    else:
        sentence = (
            f"After {stop.worthwhile} more, the next one lessens the tip's uncertainty by less "
            f"than {percent}: stop there."
        )
    if stop.target is None:
        return sentence
    target = f"{MM * stop.target:.3g} mm"
    if stop.needed is None:
        return f"{sentence} {target} is not reached with {ahead}."
    return f"{sentence} {target} is reached with {stop.needed}."


def _looked_at(found: Plan) -> str:
    region = found.region
    low, high = (MM * corner for corner in (region.lower, region.upper))
    box = ", ".join(
        f"{axis} {a:.0f} … {b:.0f}" for axis, a, b in zip("xyz", low, high, strict=True)
    )
    return (
        f"{len(found.candidates)} candidates within reach, {len(found.unreachable)} not; region "
        f"{box} mm, tool within {np.degrees(region.cone):.0f}° of its usual direction; "
        f"{found.collisions}."
    )


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"


def _some(names: Sequence[str]) -> str:
    rest = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {rest} more" if rest > 0 else "")
