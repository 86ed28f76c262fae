"""All quantities that are computed about a calibration after the solve, each once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.model.robot import AnyArm
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.term import Term
from suta_calib.trust.accuracy import Accuracy, assess
from suta_calib.trust.changes import changes
from suta_calib.trust.clocks import ClockOffset, clock_offsets
from suta_calib.trust.contradicted_priors import ContradictedBelief, contradicted_beliefs
from suta_calib.trust.contradictions import Contradiction, contradictions
from suta_calib.trust.cross_validation import folds_of
from suta_calib.trust.examination import Examination
from suta_calib.trust.explanation import Explanation, explain
from suta_calib.trust.extended_problem import (
    effective_unknowns,
    extended_problem,
    known_beforehand,
    offered_beside,
)
from suta_calib.trust.external_poses import ExternalPose, external_poses
from suta_calib.trust.held_out import HeldOutErrors, held_out_errors, widening
from suta_calib.trust.hypothesis import Finding, strongest_cause
from suta_calib.trust.in_time import ChangeInTime
from suta_calib.trust.linearised import LinearModels
from suta_calib.trust.prior_splits import PriorSplit, prior_splits
from suta_calib.trust.priors import PriorNotes, judge_priors
from suta_calib.trust.repeats import LackOfFit, TouchRepeatability, lack_of_fit, touch_repeatability
from suta_calib.trust.rereading import Rereading, explaining_reading
from suta_calib.trust.rule import Rule
from suta_calib.trust.scale_effects import ScaleEffect, scale_effects
from suta_calib.trust.score_tests import Residuals, ScoreTest
from suta_calib.trust.subsampled import thinned
from suta_calib.trust.uncertainty_budget import UncertaintyBudget, tip_budget


@dataclass(frozen=True, eq=False)
class CalibrationExamination(Examination):
    """A calibration, with everything that is computed about it.

    Reports and views read them here. Effects are tested with the whole geometry of the arm free.

    Attributes:
        validation: terms that were not fitted.
    """

    validation: tuple[Term, ...] = ()

    @classmethod
    def of(
        cls, solution: Solution, validation: Sequence[Term] = (), rule: Rule = Rule()
    ) -> CalibrationExamination:
        """Examine a solution; each quantity is computed when it is first used."""
        return cls(solution, solution.sigmas, validation=tuple(validation), rule=rule)

    # ── the problem in which effects are tested ─────────────────────────────────────────────
    @property
    def arm(self) -> AnyArm | None:
        """The arm, where there is one."""
        return self.solution.problem.arm

    @cached_property
    def _beside(self) -> tuple[Problem, FloatArray]:
        assert self.arm is not None
        names = [name for group in offered_beside(self.solution.problem).values() for name in group]
        return extended_problem(self.solution, names)

    @property
    def problem(self) -> Problem:
        """The problem with every parameter that the arm offers as an unknown."""
        return self._beside[0]

    @property
    def x(self) -> FloatArray:
        """(p,) parameters of `problem` at the solution."""
        return self._beside[1]

    @cached_property
    def follows(self) -> IntArray:
        """Indices of the unknowns of `problem` that follow an effect: all but the offered."""
        assert self.arm is not None
        fitted = self.solution.problem.parameters
        offered = {
            name for group in offered_beside(self.solution.problem).values() for name in group
        }
        names = enumerate(self.problem.names)
        return np.array([k for k, n in names if n in fitted or n not in offered], dtype=np.intp)

    @property
    def _plausible_precision(self) -> FloatArray:
        return known_beforehand(self.problem)

    @cached_property
    def fewer(self) -> CalibrationExamination:
        """The same over part of many rows, by which causes are looked for."""
        solution = thinned(self.solution)
        if solution is self.solution:
            return self
        return CalibrationExamination.of(solution, rule=self.rule)

    # ── how good the answer is ──────────────────────────────────────────────────────────────
    @cached_property
    def accuracy(self) -> Accuracy:
        """Errors of the fitted and of the held-out terms, before and after."""
        return assess(self.solution, self.validation)

    @cached_property
    def held_out(self) -> tuple[HeldOutErrors, ...]:
        """Validation errors of every block, with their prediction."""
        return held_out_errors(self.solution, self.accuracy)

    @cached_property
    def widened(self) -> CalibrationExamination:
        """The same result, with standard deviations enlarged to match the validation errors."""
        factor = widening(self.held_out)
        if factor == 1.0:
            return self
        wider = replace(self.solution, widening=factor)
        return CalibrationExamination.of(wider, self.validation, self.rule)

    @cached_property
    def lack_of_fit(self) -> tuple[LackOfFit, ...]:
        """Residuals compared with the scatter of repeats."""
        return lack_of_fit(self.solution)

    @cached_property
    def repeatability(self) -> Mapping[str, tuple[TouchRepeatability, ...]]:
        """Scatter of the tip among repeats, by set of data; terms with enough repeats only."""
        sets = {"calibration": self.accuracy.calibration, "validation": self.accuracy.validation}
        every = {
            name: (touch_repeatability(errors.term, self.solution.values) for errors in terms)
            for name, terms in sets.items()
        }
        return {
            name: tuple(repeats for repeats in terms if repeats) for name, terms in every.items()
        }

    @cached_property
    def effective_unknowns(self) -> float:
        """Number of unknowns that the data determine."""
        return effective_unknowns(self.solution)

    # ── what the data say ───────────────────────────────────────────────────────────────────
    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """Why parameters are held at nominal; empty without convergence."""
        solution = self.solution
        if not solution.converged:
            return ()
        return explain(solution.problem, solution.x, solution.identification)

    @cached_property
    def prior_splits(self) -> tuple[PriorSplit, ...]:
        """Zeros of joints that only priors tell apart; empty without convergence."""
        solution = self.solution
        if not solution.converged:
            return ()
        of = solution.problem, solution.x, solution.covariance, solution.prior_variance
        return prior_splits(*of)

    @cached_property
    def external_poses(self) -> tuple[ExternalPose, ...]:
        """Poses of cameras, instruments and artefacts; empty without convergence."""
        return external_poses(self.solution)

    @cached_property
    def clock_offsets(self) -> tuple[ClockOffset, ...]:
        """Time offsets of instruments and cameras; empty without convergence."""
        return clock_offsets(self)

    @cached_property
    def scale_effects(self) -> tuple[ScaleEffect, ...]:
        """Sources of the arm's scale, with their effects; empty without convergence."""
        return scale_effects(self.solution) if self.solution.converged else ()

    @cached_property
    def tip_budget(self) -> UncertaintyBudget | None:
        """What the uncertainty of the tip is made of; None where nothing moves it."""
        if not self.solution.converged:
            return None
        return tip_budget(self.solution, self.effective_unknowns)

    # ── what may be wrong ───────────────────────────────────────────────────────────────────
    @cached_property
    def contradictions(self) -> tuple[Contradiction, ...]:
        """Contradictions between the result and the data, the worst first."""
        return contradictions(self.solution, self.held_out)

    @cached_property
    def contradicted_beliefs(self) -> tuple[ContradictedBelief, ...]:
        """Fixed values of terms, such as intrinsics, that the data contradict."""
        return tuple(contradicted_beliefs(self.solution))

    @cached_property
    def priors(self) -> PriorNotes:
        """Whether the errors of the arm are larger than its priors allow."""
        return judge_priors(self.solution)

    @cached_property
    def other_reading(self) -> Rereading | None:
        """Another interpretation of the data, if they fit far better with it."""
        return explaining_reading(self.solution, self.rule)

    @cached_property
    def strongest_cause(self) -> Finding | None:
        """The hypothesis that explains the residuals best."""
        return strongest_cause(self, self.rule)

    @cached_property
    def changes(self) -> tuple[ChangeInTime, ...]:
        """Changes during the measurement, such as a base that moved."""
        return changes(self, self.rule)

    @cached_property
    def _residuals(self) -> Residuals:
        return Residuals.of(self, self.effective_unknowns)

    @cached_property
    def score_tests(self) -> tuple[ScoreTest, ...]:
        """Joints and families that the answer does not estimate, most suspicious first."""
        return () if self.arm is None else self._residuals.tests()

    @cached_property
    def geometry_is_held(self) -> bool:
        """Whether geometry that the job holds explains the residuals, beyond any doubt."""
        return self.arm is not None and self._residuals.geometry_is_held()

    @cached_property
    def linearised(self) -> LinearModels | None:
        """The linearised result, for fits with more unknowns; None if rows are too few."""
        try:
            folds = folds_of(self.solution.problem.terms)
        except SamplesError:
            return None
        return LinearModels(self, folds, self.solution.noise)
