"""A converged result, linearised for tests of errors that its model may lack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.solver.evaluation import PoseTable
from suta_calib.solver.information import Rows, kept_rows
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.trust.rule import Rule

if TYPE_CHECKING:
    from suta_calib.model.robot import AnyArm

# Step of numerical derivatives by something that a term was built with, relative to its unit size.
STEP: Final = 1e-6


@dataclass(frozen=True, eq=False)
class MeasuredRows:
    """The measured rows of a result on poses, and which of them are inliers.

    Attributes:
        inliers: (n,) rows that were fitted.
        numbers: (n,) of the rows in their file, from 0.
        rows: what they are, in the plural.
        called: words for what an unknown frame or point belongs to, by its owner.
        seen_by: rows that look at an unknown that not all of them look at, by its owner.
        alike: how many rows at least are worth one, because they share errors.
    """

    inliers: BoolArray
    numbers: IntArray
    rows: str = "rows"
    called: Mapping[str, str] = field(default_factory=dict)
    seen_by: Mapping[str, IntArray] = field(default_factory=dict)
    alike: float = 1.0


@dataclass(frozen=True, eq=False)
class Examination(Displayable):
    """A converged answer, linear about its solution; each part is computed once, when asked for.

    `ArmExamination` is that of a calibration over an arm.

    Attributes:
        solution: the answer.
        sigmas: standard deviation of one component of each block.
        rows_per_independent_row: see `LinearFit`.
        length: m per unit of length of the problem.
        measured: rows of an answer on poses; None of an arm.
        rule: when evidence of wrong data is reported.
    """

    solution: Solution
    sigmas: Sequence[float]
    rows_per_independent_row: float = 1.0
    length: float = 1.0
    measured: MeasuredRows | None = None
    rule: Rule = Rule()

    @classmethod
    def of_poses(
        cls,
        solution: Solution,
        sigmas: Sequence[float] | None = None,
        rows_per_independent_row: float = 1.0,
        length: float = 1.0,
        measured: MeasuredRows | None = None,
    ) -> Examination:
        """Examine an answer without an arm: pivot, hand-eye, registration.

        For a `RobustFit` it is ``Examination.of_poses(fit.solution, fit.sigmas)``.

        Args:
            solution: over the inliers.
            sigmas: scatter of one component of each block; those of the solution by default.
            rows_per_independent_row: 2.0 where neighbouring poses are so correlated that every
                two count as one.
            length: m per unit of length of the problem.
            measured: rows that were measured; those of the solution by default.
        """
        sigmas = solution.sigmas if sigmas is None else sigmas
        if measured is None:
            count = sum(len(term.poses) for term in solution.problem.terms)
            measured = MeasuredRows(np.ones(count, dtype=np.bool_), np.arange(count, dtype=np.intp))
        return cls(solution, sigmas, rows_per_independent_row, length, measured)

    @property
    def problem(self) -> Problem:
        """The problem whose unknowns may follow an effect."""
        return self.solution.problem

    @property
    def x(self) -> FloatArray:
        """(p,) parameters of `problem` about which it is linear."""
        return self.solution.x

    @property
    def follows(self) -> IntArray:
        """Indices of the unknowns of `problem` that follow an effect."""
        return self.solution.free

    @cached_property
    def rows(self) -> Sequence[Rows]:
        """Whitened rows of every block, with a column for each unknown of `problem`."""
        return kept_rows(self.problem, self.x, self.sigmas)

    @cached_property
    def everything(self) -> LinearFit:
        """The linear fit of all rows, with all unknowns of `problem`."""
        return LinearFit.of_rows(
            self.rows,
            *self._prior,
            clusters=clusters_of_rows(self.problem, self.rows),
            independent_rows=sum(term.equations() for term in self.problem.terms),
            rows_per_independent_row=self.rows_per_independent_row,
            chain=chain_of_rows(self.problem, self.rows),
        )

    @cached_property
    def fit(self) -> LinearFit:
        """The same with the unknowns that follow an effect."""
        return self.everything.only(self.follows)

    @cached_property
    def plain_fit(self) -> LinearFit:
        """The same with every row believed and independent: of few rows nothing else is known."""
        return LinearFit(self.fit.jacobian, self.fit.residual)

    @property
    def _prior(self) -> tuple[FloatArray, FloatArray]:
        """(n,) precision of every unknown before the data, and how far it is from its mean.

        What the fit did not estimate has the precision of what is plausible, so that it follows
        only as far as that.
        """
        fitted = self.solution.problem
        learned = dict(zip(fitted.names, fitted.prior_precision(), strict=True))
        plausible = self._plausible_precision
        precision = np.array(
            [learned.get(n, 0.0) or p for n, p in zip(self.problem.names, plausible, strict=True)]
        )
        stated = np.array([learned.get(n, 0.0) > 0 for n in self.problem.names])
        nominal = self.problem.parameters.array("nominal")
        return precision, np.where(stated, self.x - nominal, 0.0)

    @property
    def _plausible_precision(self) -> FloatArray:
        """(n,) precision of every unknown by what is plausible; 0 where anything is."""
        return np.zeros(len(self.problem.names))

    # ── columns of effects ──────────────────────────────────────────────────────────────────
    @property
    def arm(self) -> AnyArm | None:
        """The arm, or the robot with its chains, where there is one."""
        return self.solution.problem.arm

    @property
    def table(self) -> PoseTable:
        """Poses and velocities of the tips at the solution."""
        table = self.problem.evaluation.table
        table.update(self.x)
        return table

    @property
    def position(self) -> FloatArray:
        """(samples, 3) of the tips in the base, m."""
        return self.table.position

    @property
    def rotation(self) -> FloatArray:
        """(samples, 3, 3) ``R_base_tip``."""
        return np.swapaxes(self.table.rotation.reshape(-1, 3, 3), 1, 2)

    @cached_property
    def q(self) -> FloatArray:
        """(samples, joints) readings, rad or m."""
        return np.vstack([term.poses.samples.q for term in self.problem.terms])

    @cached_property
    def motion(self) -> FloatArray:
        """(samples, 6, movers) velocity of the tip by each of `ArmModel.movers`, per rad or m.

        Displacement in the base's axes, m, then turn about them, rad.
        """
        assert self.arm is not None
        index = [self.problem.names.index(name) for name in self.arm.offsets]
        velocity = self.table.velocity[:, index]
        return velocity.reshape(-1, 6, len(index))

    @property
    def boundaries(self) -> IntArray:
        """(terms + 1,) number of the first sample of each term, then the count of all."""
        return self.problem.evaluation.table.first

    def by_motion(self, velocity: FloatArray) -> FloatArray:
        """Whitened columns (m, k) of what moves the tips.

        Args:
            velocity: (samples, 6, k) of the tips, m and rad per unit, in the base's axes.
        """
        return by_motion(self.rows, velocity.reshape(-1, velocity.shape[2]))

    def by_shift(self, shift: FloatArray) -> FloatArray:
        """Whitened columns (m, k) of what displaces the tips: (samples, 3, k), in the base."""
        turn = np.zeros_like(shift)
        return self.by_motion(np.concatenate([shift, turn], axis=1))

    def by_terms(self, changed: Sequence[Term], step: float = STEP) -> FloatArray:
        """Whitened column (m, 1) of what the terms were built with, such as an artefact.

        Args:
            changed: the terms of `problem`, with it larger by ``step``.
            step: of the numerical derivative.
        """
        other = Problem(changed, self.problem.arm_parameters)
        lines = other.linearise(self.x, other.assumed_sigmas())
        columns = [
            ((line.residual - r.line.residual) / step / r.line.sigma[:, None]).reshape(-1, 1)
            for line, r in zip(lines, self.rows, strict=True)
        ]
        return np.vstack(columns)

    def row_of_sample(self, factor: FloatArray) -> FloatArray:
        """(m,) factors of the rows from factors (samples,): a window for an `Effect`.

        A row that looks at several samples has the mean of theirs.
        """
        return np.concatenate(
            [
                np.repeat(
                    factor[r.line.view.block.samples + r.line.view.first_sample].mean(axis=1),
                    r.line.residual.shape[1],
                )
                for r in self.rows
            ]
        )


def by_motion(rows: Sequence[Rows], velocity: FloatArray) -> FloatArray:
    """(m, k) how whitened rows change with velocities (6·samples, k) of the tips."""
    return np.vstack(
        [
            r.line.pattern.by_parameters(r.line.by_pose / r.line.sigma[:, None, None], velocity)
            for r in rows
        ]
    )


def clusters_of_rows(problem: Problem, rows: Sequence[Rows]) -> IntArray:
    """(m, c) the independent touches of every row, -1 where a row has fewer than c."""
    first = problem.evaluation.table.first
    touches = np.concatenate([k + t.clusters for k, t in zip(first, problem.terms, strict=False)])
    members = []
    for r in rows:
        touched = touches[r.line.view.block.samples + r.line.view.first_sample]
        members.append(np.repeat(touched, r.line.residual.shape[1], axis=0))
    width = max(clusters.shape[1] for clusters in members)
    padded = [
        np.pad(clusters, ((0, 0), (0, width - clusters.shape[1])), constant_values=-1)
        for clusters in members
    ]
    return np.concatenate(padded)


def chain_of_rows(problem: Problem, rows: Sequence[Rows]) -> IntArray | None:
    """(m,) number of the chain that each component is of, for `LinearFit`; None of one arm."""
    arms = [t.poses.arm if isinstance(t.poses, ArmPoses) else None for t in problem.terms]
    different = [*dict.fromkeys(arms)]
    if len(different) < 2:
        return None
    counts = [len(term.poses) for term in problem.terms]
    return np.repeat([different.index(arm) for arm in arms], counts)[samples_of(rows)]


def samples_of(rows: Sequence[Rows]) -> IntArray:
    """(m,) number of the sample that each component looks at, of all of them the first."""
    return np.concatenate(
        [
            np.repeat(
                r.line.view.block.samples[:, 0] + r.line.view.first_sample, r.line.residual.shape[1]
            )
            for r in rows
        ]
    )
