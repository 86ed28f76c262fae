"""The search for outliers in a job: which landmark, placement, set, point or row is unlike others.

Two fits are looked at. In the *job's own* fit every touch counts and the thesis' thresholds are
taken as they are: these are the figures `calibrate` lives with, but landmarks exceed thresholds in
them because of what the job's few parameters leave out of the arm. In the *judged* fit the whole
geometry of the arm is free (`whole_arm`), and gross single touches are set aside and named. There
a metric is flagged if it exceeds the same threshold *and* chance (`chance`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np

from suta_calib.analysis.outliers.chance import Simulator, chance_of
from suta_calib.analysis.outliers.metrics import JudgedFit, measures
from suta_calib.analysis.outliers.reference import (
    Grouping,
    Judge,
    ReferenceFit,
    groupings,
    row_names,
    touch_name,
)
from suta_calib.analysis.outliers.result import (
    AGREEMENT,
    METRICS,
    GrossTouch,
    Group,
    HeldOut,
    Level,
    Outliers,
    TermOutliers,
    Thresholds,
)
from suta_calib.analysis.outliers.touches import (
    SMALLEST,
    Touches,
    explained_touches,
    find_moves,
    linearised,
)
from suta_calib.arguments import checked
from suta_calib.arrays import BoolArray
from suta_calib.errors import SamplesError
from suta_calib.model.parameters import ParameterSet
from suta_calib.model.robot import AnyArm
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import Progress, solve
from suta_calib.terms.term import Term
from suta_calib.threads import single_threaded
from suta_calib.units import from_deg

# Rows beyond which only those with the largest errors are refitted one by one.
MOST_ROWS: Final = 300


@single_threaded
@checked
def find_outliers(
    problem: Problem,
    validation: Sequence[Term] = (),
    options: SolverOptions = SolverOptions(),
    thresholds: Thresholds | None = None,
    progress: Progress | None = None,
    solution: Solution | None = None,
    sorts: Collection[str] | None = None,
) -> Outliers:
    """Look for what does not agree with the rest. Nothing is excluded, and nothing is changed.

    Args:
        problem: a job's observations and unknowns.
        validation: held-out terms; without them, parts of the data are held out in turn.
        options: how the job's own fit is solved; its seed is that of the simulated noise, too.
        thresholds: from which value on a metric is conspicuous; the usual ones by default.
        progress: called with (groups done, groups).
        solution: of the problem, where it is known already.
        sorts: of groups to look at, such as ``landmarks``; all by default.

    Returns:
        Every group of every observation with its four metrics, flags and verdict; no groups where
        the calibration itself did not converge.

    Raises:
        SamplesError: no observation has three groups of any sort, or the problem cannot be solved.
    """
    levels = [
        [g for g in groupings(term) if sorts is None or g.name in sorts] for term in problem.terms
    ]
    if not any(levels):
        raise SamplesError(
            "fewer than three landmarks, placements, points or rows in every observation",
            "at least three of one of these in an observation",
            where="observations",
        )
    solution = solution or solve(problem, options)
    thresholds = thresholds or Thresholds()
    if not solution.converged:
        return Outliers(solution, [not_searched(t) for t in problem.terms], thresholds, ())
    arm = whole_arm(problem.arm, problem.arm_parameters)
    total = 2 * sum(len(chosen_groups(g, None)) for reference in levels for g in reference)
    numbers = itertools.count(1)

    def count() -> None:
        done = next(numbers)
        if progress is not None:
            progress(done, max(total, done))

    terms = []
    for k, (term, groups) in enumerate(zip(problem.terms, levels, strict=True)):
        reference = ReferenceFit.of(solution, problem.arm_parameters, k)
        judge = Judge(reference, _alike(term, validation))
        terms.append(TermSearch(reference, arm, judge, thresholds, options.seed, count).run(groups))
    return Outliers(solution, terms, thresholds, tuple(p.name for p in arm.values() if p.free))


def _alike(term: Term, others: Sequence[Term]) -> tuple[Term, ...]:
    """Those of the same kind and the same chain."""
    of = term.kind, term.poses.chain
    return tuple(other for other in others if (other.kind, other.poses.chain) == of)


def whole_arm(arm: AnyArm | None, job: ParameterSet) -> ParameterSet:
    """The job's unknowns as they are, and the rest of the arm's geometry with priors.

    A job usually estimates fewer parameters than the arm has. What the others get wrong shows as
    errors of about a millimetre that differ from landmark to landmark, and no metric can tell such
    an error from a landmark that is not where it is certified. So every joint's placement and
    offset gives way within what a built arm departs from its drawing: by priors, which also keep in
    place whatever the data cannot tell.
    """
    if arm is None:
        return job
    parameters = {name: p for name, p in job.items() if p.free}
    for name, p in arm.select("geometric", "*.offset").items():
        if name not in parameters:
            free = replace(p, lower=-math.inf, upper=math.inf, plausible=math.nan, free=True)
            # Standard deviations of a built arm about its drawing or URDF, m and rad.
            parameters[name] = replace(free, prior=5e-3 if p.unit == "m" else from_deg(1.0))
    return ParameterSet(parameters.values())


@dataclass(frozen=True, eq=False)
class TermSearch:
    """The search in one term, given the job's own fit and the arm with its whole geometry free."""

    reference: ReferenceFit
    arm: ParameterSet
    judge: Judge
    thresholds: Thresholds
    seed: int
    count: Callable[[], None]

    def run(self, levels: Sequence[Grouping]) -> TermOutliers:
        """All levels of the term; none where its errors are rounding."""
        if sum(term.equations() for term in self.reference.terms) <= len(self.reference.estimated):
            # As many unknowns as data: is any error left to look at?
            fit = self.reference.over(np.ones(len(self.reference.term.poses), dtype=bool))
            # Errors (RMS, m) that are rounding: the fit leaves none.
            if fit is not None and fit.rms < 1e-9:
                return not_searched(self.reference.term, exact=True)
        everything = groupings(self.reference.term)
        landmarks = next((g for g in everything if g.name == "landmarks"), None)
        single, unknowns, linear = linearised(self.reference, self.arm)
        touches = explained_touches(linear, self.reference.term.clusters, landmarks)
        displaced = np.zeros(len(touches.rest), dtype=bool)
        if landmarks is not None:
            displaced = np.isin(landmarks.member, list(touches.displaced))
        judged = self.reference.freed(self.arm, ~(touches.gross | displaced))
        levels_judged = self._levels(judged, levels, touches, displaced)
        gross = []
        if not any(g.name == "rows" for g in everything):
            names, size = row_names(self.reference.term), np.linalg.norm(touches.rest, axis=1)
            for k in np.flatnonzero(touches.gross):
                what = touch_name(self.reference.term, int(k))
                gross.append(GrossTouch(str(names[k]), what, float(size[k])))
        position = None
        if landmarks is not None and self.reference.term.touched is not None:
            position = self.reference.term.touched.position_of(landmarks.labels)
        return TermOutliers(
            self.reference.term.kind,
            tuple(levels_judged),
            tuple(gross),
            len(self.reference.term.poses),
            touches.sigma,
            position,
            {
                level.name: self._held_out(g, level)
                for g, level in zip(levels, levels_judged, strict=True)
            },
            self.judge.method,
            moves=find_moves(single, unknowns, linear, self.thresholds),
            unit=self.reference.term.error_unit,
            chain=self.reference.term.poses.chain,
        )

    def _levels(
        self,
        judged: ReferenceFit,
        levels: Sequence[Grouping],
        touches: Touches,
        displaced: BoolArray,
    ) -> list[Level]:
        """Every level; those that are judged in the same scene share its fits and its noise."""
        nothing = np.zeros(len(displaced), dtype=bool)
        job_scene = JudgedFit(self.reference, ~nothing, nothing)

        @cache
        def judging(*, rows: bool) -> tuple[JudgedFit, Simulator]:
            held = (~nothing, touches.gross) if rows else (~touches.gross, displaced)
            scene = JudgedFit(judged, *held)
            return scene, Simulator(scene, touches, self.seed)

        return [self._level(job_scene, *judging(rows=g.name == "rows"), g, touches) for g in levels]

    def _level(
        self,
        job_scene: JudgedFit,
        scene: JudgedFit,
        simulator: Simulator,
        grouping: Grouping,
        touches: Touches,
    ) -> Level:
        """Values, chance and flags of every group of one level."""
        chosen = chosen_groups(grouping, touches)
        values = measures(scene, grouping, chosen, self.count)
        calibrated = measures(job_scene, grouping, chosen, self.count)
        p = chance_of(values, simulator.metrics(grouping))
        limits = {m: self.thresholds.of(m, len(grouping)) for m in METRICS}
        groups = []
        for g in chosen:
            rows = grouping.rows(g)
            value, chance, as_calibrated = (
                dict(zip(METRICS, figures[:, g].tolist(), strict=True))
                for figures in (values, p, calibrated)
            )
            # Errors of the fit that a group is judged in may be no more than its last digits.
            fit, _ = scene.with_and_without(rows)
            flags = tuple(
                name
                for name in METRICS
                if fit is not None
                and fit.rms > SMALLEST
                and value[name] > limits[name]
                and chance[name] <= self.thresholds.significance
            )
            groups.append(
                Group(
                    grouping.labels[g],
                    int(rows.sum()),
                    value,
                    chance,
                    flags,
                    as_calibrated,
                    len(flags) >= AGREEMENT,
                    touches.displaced.get(g) if grouping.name == "landmarks" else None,
                )
            )
        return Level(grouping.name, tuple(groups), limits)

    def _held_out(self, grouping: Grouping, level: Level) -> dict[str, HeldOut]:
        """The effect of excluding each group; of rows, and without validation, of flagged ones."""
        few = grouping.name == "rows" or self.judge.method != "validation"
        effects = {
            g.label: self.judge.of(grouping, grouping.labels.index(g.label))
            for g in level.groups
            if g.flags or not few
        }
        return {label: effect for label, effect in effects.items() if effect is not None}


def not_searched(term: Term, *, exact: bool = False) -> TermOutliers:
    """A term of a calibration that did not converge or fits exactly: nothing to compare with."""
    return TermOutliers(
        *(term.kind, (), (), len(term.poses), float("nan")),
        exact=exact,
        unit=term.error_unit,
        chain=term.poses.chain,
    )


def chosen_groups(grouping: Grouping, touches: Touches | None) -> list[int]:
    """Groups to refit: all, or of very many rows those with the largest errors."""
    if len(grouping) <= MOST_ROWS or touches is None:
        return list(range(min(len(grouping), MOST_ROWS)))
    size = np.linalg.norm(touches.rest, axis=1)
    return sorted(np.argsort(-size, kind="stable")[:MOST_ROWS].tolist())
