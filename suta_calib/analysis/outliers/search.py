"""The search for outliers in a job: which landmark, placement, set, point or row is unlike others.

Two fits are looked at. In the *job's own* fit every touch counts and the thesis' thresholds are
taken as they are: these are the figures `calibrate` lives with, but landmarks exceed thresholds in
them because of what the job's few parameters leave out of the arm. In the *judged* fit the whole
geometry of the arm is free (`whole_arm`), and gross single touches are set aside and named. There
a metric is flagged if it exceeds the same threshold *and* chance (`chance`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Final

from suta_calib.analysis.outliers.answer import (
    Outliers,
    Thresholds,
)
from suta_calib.analysis.outliers.groups import groupings
from suta_calib.analysis.outliers.term_search import TermSearch, arm_of, chosen_groups, not_searched
from suta_calib.errors import SamplesError
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Parameter, ParameterSet
from suta_calib.solver.ipopt import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms.term import Term
from suta_calib.threads import single_threaded
from suta_calib.units import from_deg

Progress = Callable[[int, int], None]
# Standard deviations of a built arm about its drawing or URDF, m and rad.
LENGTH: Final = 5e-3
ANGLE: Final = from_deg(1.0)


@single_threaded
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
            "at least three of something, so that one can be unlike the others",
            where="observations",
        )
    solution = solution or solve(problem, options)
    thresholds = thresholds or Thresholds()
    if not solution.converged:
        terms = [not_searched(term) for term in problem.terms]
        return Outliers(solution, terms, thresholds, ())
    arm = whole_arm(problem.arm, arm_of(problem))
    count = _Count(progress, 2 * sum(len(chosen_groups(g, None)) for own in levels for g in own))
    terms = [
        TermSearch(solution, arm, k, tuple(validation), thresholds, options.seed, count).run(own)
        for k, own in enumerate(levels)
    ]
    return Outliers(solution, terms, thresholds, tuple(p.name for p in arm.values() if p.free))


def whole_arm(arm: ArmModel | None, job: ParameterSet) -> ParameterSet:
    """The job's unknowns as they are, and the rest of the arm's geometry with priors.

    A job usually estimates fewer parameters than the arm has. What the others get wrong shows as
    errors of about a millimetre that differ from landmark to landmark, and no metric can tell such
    an error from a landmark that is not where it is certified. So every joint's placement and
    offset gives way within what a built arm departs from its drawing: priors of `LENGTH` and
    `ANGLE`, which also keep in place whatever the data cannot tell.

    Args:
        arm: the arm, or None where no term looks at one.
        job: the arm's parameters of the job.
    """
    if arm is None:
        return job
    known = {name: p for name, p in job.items() if p.free}
    for name, p in arm.select("geometric", "*.offset").items():
        if name not in known:
            known[name] = _loose(p)
    return ParameterSet(known.values())


def _loose(p: Parameter) -> Parameter:
    return replace(
        p,
        lower=-math.inf,
        upper=math.inf,
        prior=LENGTH if p.unit == "m" else ANGLE,
        plausible=math.nan,
        free=True,
    )


class _Count:
    """How many groups are done."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, max(self._total, self._done))
