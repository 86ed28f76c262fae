"""One observation of a job, searched for outliers: every level, its chances and its flags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from suta_calib.analysis.outliers.answer import (
    AGREEMENT,
    METRICS,
    GrossTouch,
    Group,
    HeldOut,
    Level,
    Metric,
    TermOutliers,
    Thresholds,
)
from suta_calib.analysis.outliers.chance import Simulator
from suta_calib.analysis.outliers.groups import Grouping, groupings, row_names, touch_name
from suta_calib.analysis.outliers.metrics import Scene, measures
from suta_calib.analysis.outliers.reference import Judge, ReferenceFit
from suta_calib.analysis.outliers.touches import SMALLEST, Touches, explained_touches
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.term import Term

# Rows beyond which only those with the largest errors are refitted one by one.
MOST_ROWS: Final = 300
# Errors (RMS, m) that are rounding: the fit leaves none.
ROUNDING: Final = 1e-9


class TermSearch:
    """One term of a problem.

    Args:
        solution: the job's own fit.
        arm: the arm's unknowns with its whole geometry.
        index: of the term.
        validation: held-out terms.
        thresholds: of the metrics.
        seed: of the simulated noise.
        count: called for every group that is done.
    """

    def __init__(
        self,
        solution: Solution,
        arm: ParameterSet,
        index: int,
        validation: tuple[Term, ...],
        thresholds: Thresholds,
        seed: int,
        count: Callable[[], None],
    ) -> None:
        self._solution, self._arm, self._seed = solution, arm, seed
        self._thresholds, self._count = thresholds, count
        self._own = ReferenceFit.of(solution, arm_of(solution.problem), index)
        self._term = self._own.term
        self._judge = Judge(self._own, tuple(t for t in validation if t.kind == self._term.kind))

    def run(self, levels: Sequence[Grouping]) -> TermOutliers:
        """All levels of the term; none where its errors are rounding."""
        if self._fits_exactly():
            return not_searched(self._term, exact=True)
        everything = groupings(self._term)
        landmarks = next((g for g in everything if g.name == "landmarks"), None)
        touches = explained_touches(self._own, self._arm, landmarks)
        judged = self._own.freed(self._arm, ~_unlike(touches, landmarks))
        found = [self._level(judged, g, landmarks, touches) for g in levels]
        by_row = any(g.name == "rows" for g in everything)
        return TermOutliers(
            self._term.kind,
            tuple(found),
            () if by_row else self._gross(touches),
            len(self._term.poses),
            touches.sigma,
            _positions(self._term, landmarks),
            {level.name: self._held_out(g, level) for g, level in zip(levels, found, strict=True)},
            self._judge.method,
        )

    def _fits_exactly(self) -> bool:
        """There are as many unknowns as data, so that no error is left to look at."""
        equations = sum(term.equations() for term in self._own.terms)
        if equations > len(self._own.estimated):
            return False
        fit = self._own.over(np.ones(len(self._term.poses), dtype=bool))
        return fit is not None and fit.rms < ROUNDING

    def _level(
        self,
        judged: ReferenceFit,
        grouping: Grouping,
        landmarks: Grouping | None,
        touches: Touches,
    ) -> Level:
        """Values, chance and flags of every group of one level."""
        n = len(grouping.member)
        nothing, everything = np.zeros(n, dtype=bool), np.ones(n, dtype=bool)
        chosen = chosen_groups(grouping, touches)
        if grouping.name == "rows":
            scene = Scene(judged, everything, touches.gross)
        else:
            displaced = _displaced(touches, landmarks)
            scene = Scene(judged, ~touches.gross, displaced)
        own = Scene(self._own, everything, nothing)
        values = measures(scene, grouping, chosen, self._count)
        calibrated = measures(own, grouping, chosen, self._count).array()
        p = Simulator(scene, touches, self._seed).chance(grouping).p(values)
        limits = {m: self._thresholds.of(m, len(grouping)) for m in METRICS}
        groups = [
            self._group(
                grouping,
                g,
                values.array()[:, g],
                p[:, g],
                calibrated[:, g],
                limits,
                errs=_errs(scene, grouping.rows(g)),
            )
            for g in chosen
        ]
        if grouping.name == "landmarks":
            groups = [_placed(group, g, touches) for group, g in zip(groups, chosen, strict=True)]
        return Level(grouping.name, tuple(groups), limits)

    def _group(
        self,
        grouping: Grouping,
        g: int,
        values: FloatArray,
        p: FloatArray,
        calibrated: FloatArray,
        limits: dict[Metric, float],
        *,
        errs: bool,
    ) -> Group:
        flags = tuple(
            name
            for name, value, chance in zip(METRICS, values, p, strict=True)
            if errs and value > limits[name] and chance <= self._thresholds.significance
        )
        return Group(
            grouping.labels[g],
            int(grouping.rows(g).sum()),
            dict(zip(METRICS, values.tolist(), strict=True)),
            dict(zip(METRICS, p.tolist(), strict=True)),
            flags,
            dict(zip(METRICS, calibrated.tolist(), strict=True)),
            len(flags) >= AGREEMENT,
        )

    def _held_out(self, grouping: Grouping, level: Level) -> dict[str, HeldOut]:
        """The effect of excluding each group; of rows, and without validation, of flagged ones."""
        few = grouping.name == "rows" or self._judge.method != "validation"
        effects = {
            g.label: self._judge.of(grouping, grouping.labels.index(g.label))
            for g in level.groups
            if g.flags or not few
        }
        return {label: effect for label, effect in effects.items() if effect is not None}

    def _gross(self, touches: Touches) -> tuple[GrossTouch, ...]:
        names = row_names(self._term)
        size = np.linalg.norm(touches.rest, axis=1)
        return tuple(
            GrossTouch(str(names[k]), touch_name(self._term, int(k)), float(size[k]))
            for k in np.flatnonzero(touches.gross)
        )


def _errs(scene: Scene, rows: BoolArray) -> bool:
    """Whether errors of the fit that a group is judged in are more than its last digits."""
    fit, _ = scene.with_and_without(rows)
    return fit is not None and fit.rms > SMALLEST


def not_searched(term: Term, *, exact: bool = False) -> TermOutliers:
    """A term of a calibration that did not converge or fits exactly: nothing to compare with."""
    return TermOutliers(term.kind, (), (), len(term.poses), float("nan"), exact=exact)


def chosen_groups(grouping: Grouping, touches: Touches | None) -> list[int]:
    """Groups to refit: all, or of very many rows those with the largest errors."""
    if len(grouping) <= MOST_ROWS or touches is None:
        return list(range(min(len(grouping), MOST_ROWS)))
    size = np.linalg.norm(touches.rest, axis=1)
    return sorted(np.argsort(-size, kind="stable")[:MOST_ROWS].tolist())


def _displaced(touches: Touches, landmarks: Grouping | None) -> BoolArray:
    if landmarks is None:
        return np.zeros(len(touches.rest), dtype=bool)
    return np.isin(landmarks.member, list(touches.displaced))


def _unlike(touches: Touches, landmarks: Grouping | None) -> BoolArray:
    return np.asarray(touches.gross | _displaced(touches, landmarks))


def _placed(group: Group, number: int, touches: Touches) -> Group:
    return replace(group, displacement=touches.displaced.get(number))


def _positions(term: Term, landmarks: Grouping | None) -> FloatArray | None:
    if landmarks is None or term.touched is None:
        return None
    return term.touched.position_of(landmarks.labels)


def arm_of(problem: Problem) -> ParameterSet:
    """The arm's parameters of a problem, without the terms' own."""
    return ParameterSet(list(problem.parameters.values())[: problem.arm_count])
