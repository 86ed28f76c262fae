"""New rows, linear about what a calibration says of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.check.error_model import levels_of, problem_beside
from suta_calib.check.row_errors import RowErrors
from suta_calib.solver.problem import Problem
from suta_calib.terms.term import Term
from suta_calib.trust.accuracy import fit_own
from suta_calib.trust.examination import Examination


@dataclass(frozen=True, eq=False)
class NewRows(Examination):
    """Rows that were not calibrated, at the calibrated parameters or at others.

    Attributes:
        checked: their problem, with all of the arm's geometry.
        at: (p,) values of its parameters.
        levels: of noise, by sort of block.
        errors: what the rows share, where it is known already.
    """

    checked: Problem | None = None
    at: FloatArray | None = None
    levels: Mapping[tuple[str, str, bool], float] | None = None
    errors: RowErrors | None = None

    @classmethod
    def beside(
        cls,
        reference: Examination,
        terms: Sequence[Term],
        known: Mapping[str, float],
        levels: Mapping[tuple[str, str, bool], float],
    ) -> NewRows:
        """New rows at known values; what the rows alone must tell is fitted to them."""
        problem = problem_beside(reference.solution.problem, terms)
        values = {p.name: p.nominal for p in problem.arm_parameters.values()} | dict(known)
        values = fit_own(problem.terms, problem.arm_parameters, values)
        at = np.array([values[name] for name in problem.names])
        return cls(
            reference.solution,
            levels_of(problem, dict(levels)),
            checked=problem,
            at=at,
            levels=levels,
        )

    @property
    def problem(self) -> Problem:
        """That of the new rows."""
        assert self.checked is not None
        return self.checked

    @property
    def x(self) -> FloatArray:
        """(p,) where it is linear."""
        assert self.at is not None
        return self.at

    @property
    def values(self) -> dict[str, float]:
        """The same by name."""
        return self.problem.values(self.x)

    @cached_property
    def shared(self) -> RowErrors:
        """What the rows share."""
        if self.errors is not None:
            return self.errors
        return RowErrors.of(self.problem, self.x, self.rows)

    @cached_property
    def jacobian(self) -> FloatArray:
        """(c, p) of the whitened rows by every parameter, combined as `shared` does."""
        return self.shared.combine(np.vstack([r.jacobian for r in self.rows]))

    @cached_property
    def residual(self) -> FloatArray:
        """(c,) whitened, combined likewise."""
        return self.shared.combine(
            np.concatenate(
                [(r.line.residual / r.line.sigma[:, None]).reshape(-1) for r in self.rows]
            )
        )

    def tips_of(self, term: Term) -> FloatArray:
        """(n, 3) of the tips of a term in the base, m."""
        for mine, (a, b) in zip(
            self.problem.terms, pairwise(self.boundaries.tolist()), strict=True
        ):
            if mine is term:
                return np.asarray(self.position[a:b])
        raise ValueError("a term of another problem")

    def moved_to(self, at: FloatArray) -> NewRows:
        """The same rows at other values."""
        return replace(self, at=at, errors=self.shared)

    def with_terms(self, terms: Sequence[Term]) -> NewRows:
        """The same rows read with other assumptions, at the same values."""
        problem = Problem(terms, self.problem.arm_parameters)
        values = {p.name: p.nominal for p in problem.parameters.values()} | self.values
        at = np.array([values[name] for name in problem.names])
        return replace(self, checked=problem, at=at, errors=self.shared)
