"""A camera, a target, a tip or a post that was moved while rows were measured, or drifts."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import tangent_of_vector
from suta_calib.terms.external_frame import pose_named
from suta_calib.terms.fixed_point import FixedPoint
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.tracked_point import TrackedPoint
from suta_calib.trust import (
    AddedVariable,
    Effect,
    Evidence,
    Examination,
    LinearFit,
    Rule,
    SpoiltData,
    Truth,
    weigh_effects,
)
from suta_calib.trust.serial_correlation import correlation_length
from suta_calib.trust.simulated_faults import random_shift, seen_elsewhere
from suta_calib.units import with_std

# Rows before and after a step, and rows (evenly spaced ones) at which it is tried.
FEWEST: Final = 4
TIMES: Final = 40
# Share of a block's squared residuals that a change must explain. A hand that errs alike in like
# poses seems to change on its way: where the residuals that are left are correlated from row to
# row, or are too few to tell, the share must be 0.7. Elsewhere `WORTH` is enough: of many rows any
# change is significant.
WORTH: Final = 0.1


@dataclass(frozen=True, eq=False)
class MovedPart:
    """Of what an effect is.

    Attributes:
        what: was moved, in words.
        starts: of the windows but the last, which is a drift, among the rows that were fitted.
        numbers: (n,) of the rows that were fitted, in their file, from 0.
        rows: what the rows are, in the plural.
        correlated: whether neighbouring rows err alike, or too few rows tell whether they do.
    """

    what: str
    starts: IntArray
    numbers: IntArray
    rows: str
    correlated: bool = False

    def since(self, evidence: Evidence) -> int | None:
        """Row of the file, from 0, at which it begins; None where it drifts."""
        assert evidence.window is not None
        if evidence.window == len(self.starts):
            return None
        return int(self.numbers[self.starts[evidence.window]])


class Moved(AddedVariable):
    """An unknown frame or point is at another place from a row on, or drifts with the row number.

    Its columns are those of the unknown, in windows: 0 before a row and 1 from there on, or from 0
    to 1. The size is a displacement, m, and a turn, rad, if it has one. As the change makes the
    scatter of displacements and of turns larger, each is weighed again by what the best change
    leaves of it.
    """

    name = "moved"
    about = "A camera, a target, a tip or a post was moved between two rows."
    applies_to = (FixedPoint, HandEye, TrackedPoint)
    needs_arm = False
    by_itself = True
    worth = WORTH
    # Of the displacement or of the turn.
    times_std = 3.0

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each unknown frame or point, with all windows."""
        assert answer.measured is not None
        rows = answer.measured.numbers[answer.measured.inliers]
        count = len(rows)
        if count < 2 * FEWEST:
            return
        starts = np.unique(np.linspace(FEWEST, count - FEWEST, TIMES).astype(np.intp))
        row = np.arange(count)
        windows = [answer.row_of_sample(row >= start).astype(bool) for start in starts]
        windows.append(answer.row_of_sample(row / (count - 1.0)))
        for owner, (at, per_unit) in unknowns(answer).items():
            columns = np.vstack([r.jacobian[:, at] for r in answer.rows]) @ np.linalg.inv(per_unit)
            what = answer.measured.called.get(owner, owner)
            about = MovedPart(what, starts, rows, answer.measured.rows)
            yield Effect(what, columns, windows=windows, about=about)

    def weigh(self, answer: Examination) -> list[Evidence]:
        """The best change of one unknown; blocks are weighed again by what it leaves of them."""
        fit, effects = answer.plain_fit, [*self.effects(answer)]
        first = next(iter(weigh_effects(fit, effects)), None)
        if first is None:
            return []
        ends = np.cumsum([r.line.residual.size for r in answer.rows])[:-1]
        left = np.split(fit.settled + first.explained(fit), ends)
        before = np.split(fit.residual, ends)
        share = max(
            1.0 - float(b @ b) / max(float(a @ a), 1e-300)
            for a, b in zip(before, left, strict=True)
        )
        if share <= WORTH:
            return []
        # What is left of exact poses, in units of their standard deviation before.
        exact = 1e-6
        # What the change made of the noise of places must not hide it, nor of that of turns.
        scale = np.concatenate(
            [np.full(len(r), 1.0 / max(math.sqrt(float(r @ r) / len(r)), exact)) for r in left]
        )
        weighed = LinearFit(fit.jacobian * scale[:, None], fit.residual * scale)
        effects = [replace(e, columns=e.columns * scale[:, None]) for e in effects]
        best = weigh_effects(weighed, effects)[0]
        effect, window = best.effect, best.window
        assert effect.windows is not None
        assert window is not None
        white = np.split(weighed.settled + best.explained(weighed), ends)
        count = len(effect.about.numbers)
        # Neighbours with a common error count less, and seem to change somewhere.
        length = correlation_length(np.hstack([r.reshape(count, -1) for r in white]))
        about = replace(effect.about, correlated=length > 1.0 or count < 60)
        assert answer.measured is not None
        length = max(length, answer.measured.alike)
        tried = sum(len(each.windows or ()) for each in effects)
        return [
            replace(
                evidence,
                effect=replace(effect, about=about),
                window=window,
                share=share,
                p_value=min(1.0, evidence.p_single * tried),
            )
            for evidence in weigh_effects(
                replace(weighed, rows_per_independent_row=length),
                [replace(effect, windows=[effect.windows[window]])],
            )
        ]

    def supported(self, evidence: Evidence, rule: Rule = Rule()) -> bool:
        """Whether it is reported: see `WORTH`."""
        change, several = evidence.effect.about, min(rule.times_std, self.times_std)
        return (
            evidence.p_value < rule.false_alarm
            and evidence.share > (0.7 if change.correlated else WORTH)
            and any(length > several * std for length, std in sizes(evidence))
        )

    def sentence(self, evidence: Evidence) -> str:
        """What was moved, since when, by how much, and what to do."""
        return moved_text(evidence, evidence.effect.about.rows)

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """What was seen or touched is 5 mm elsewhere from the middle on."""
        by = random_shift(rng, 5e-3)
        late = np.arange(len(data.poses)) >= len(data.poses) // 2
        size = by if isinstance(data, FixedPoint) else np.concatenate([by, np.zeros(3)])
        if isinstance(data, HandEye):
            size[:3] = pose_named(values, HandEye.frames[1].owner)[0] @ by
        return SpoiltData(seen_elsewhere(data, late[:, None] * by), size)


def moved_text(evidence: Evidence, rows: str, images: Sequence[str] = ()) -> str:
    """What was moved, since which row or picture, by how much, and what to do.

    Args:
        evidence: on `Moved`.
        rows: what the rows are, in the plural.
        images: names of pictures by the number of a row, if rows are pictures.
    """
    change, row = evidence.effect.about, "picture" if images else "row"
    (shift, std), *turn = sizes(evidence)
    by = with_std(shift, std, "m")
    by += "".join(f" and {with_std(angle, its, 'rad')}" for angle, its in turn)
    since = change.since(evidence)
    if since is None:
        return (
            f"From the first {row} to the last {change.what} drifts, by {by} in all. Something "
            f"creeps, slips or warms up. Fix it, or use {rows} of a shorter time."
        )
    which = f"{since} on (rows from 0)" if not images else f"{images[since]} on"
    return (
        f"From {row} {which} {change.what} is at another place, by {by}: it was moved. Use only "
        f"the {rows} before or only those after this {row}."
    )


def sizes(evidence: Evidence) -> list[tuple[float, float]]:
    """Displacement, m, and turn, rad (if there is one), each with its standard deviation."""
    parts = (slice(0, 3), slice(3, 6))[: len(evidence.size) // 3]
    return [evidence.length(part) for part in parts]


def unknowns(answer: Examination) -> dict[str, tuple[list[int], FloatArray]]:
    """By owner, the indices of an unknown's parameters, and displacement, m, and turn per unit."""
    by_owner: dict[str, tuple[list[int], FloatArray]] = {}
    owners = [parameter.owner for parameter in answer.problem.parameters.values()]
    for owner in dict.fromkeys(owners):
        at = [k for k, name in enumerate(owners) if name == owner]
        per_unit = answer.length * np.eye(len(at))
        if len(at) > 3:
            per_unit[3:, 3:] = tangent_of_vector(answer.x[at[3:]])
        by_owner[owner] = at, per_unit
    return by_owner
