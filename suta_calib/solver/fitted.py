"""An estimate and what its covariance is made of: whitened rows, A⁻¹, and a wider problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.model.parameters import Parameter, ParameterSet
from suta_calib.solver.information import Rows, robust_curvature, scaled_inverse, whitened_rows
from suta_calib.solver.problem import Problem


@dataclass(frozen=True, eq=False)
class Fitted:
    """Where an estimate is.

    Attributes:
        problem: terms and parameters.
        x: (n,) the estimate.
        sigmas: noise level of each block.
        free: indices that were estimated.
    """

    problem: Problem
    x: FloatArray
    sigmas: Sequence[float]
    free: IntArray

    def rows(self) -> list[Rows]:
        """Whitened rows there."""
        return whitened_rows(self.problem, self.x, self.sigmas)

    def bread(self, rows: Sequence[Rows]) -> FloatArray:
        """A⁻¹ (n, n) of the robust cost and the stated priors; zero for what was not estimated."""
        prior, at = np.diag(self.problem.stated_precision()), np.ix_(self.free, self.free)
        inverse = np.zeros_like(prior)
        inverse[at] = scaled_inverse((prior + sum(map(robust_curvature, rows)))[at])
        return inverse

    def wider(self, held: Sequence[Parameter]) -> tuple[Fitted, IntArray]:
        """The same beside parameters of the arm that were held, and where these are in it.

        Its ``free`` are the same parameters as before, in the same order.
        """
        problem, given = self.problem, self.problem.arm_parameters
        more = [p for p in held if p.name not in given]
        wider = Problem(problem.terms, ParameterSet([*given.values(), *more]))
        values = {p.name: p.nominal for p in held} | problem.values(self.x)
        index = {name: k for k, name in enumerate(wider.names)}
        free = np.array([index[problem.names[k]] for k in self.free])
        at = np.array([values[name] for name in wider.names])
        return Fitted(wider, at, self.sigmas, free), np.array([index[p.name] for p in held])
