"""How large the errors of new rows are if nothing changed, as the calibration's residuals say.

The residuals of the calibrated rows have the covariance σ² V(θ) of `row_errors`, less what the fit
took. Their restricted likelihood (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545) over a
coarse grid of θ, flat beforehand, and σ² integrated out with its Jeffreys prior, says how probable
each θ is; given θ, σ² is S / χ²_ν. What the rows do not tell of the noise is thus in every figure
of a check: few rows give a wide mixture.

New rows then have, with their derivative J by what was estimated,

    Cov(r) = σ² (V_own + θ_1 V_posture + θ_2 D) + J C Jᵀ,   D = (I, -J G) V_near (I, -J G)ᵀ

where C is the covariance of the estimates and G = A⁻¹ J_cᵀ by which they followed the calibrated
rows: of what a model lacks, the fit has taken a part, there and here alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Final

import numpy as np
from scipy.linalg import solve_triangular

from suta_calib.arrays import FloatArray
from suta_calib.check.row_errors import RowErrors
from suta_calib.solver.information import Rows, scaled_inverse, whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.term import Term
from suta_calib.trust.extended_problem import with_geometry
from suta_calib.trust.held_out import fitted_levels, scatter_unit, sort_of
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.trust.neighbour_correlation import Freed
from suta_calib.trust.subsampled import spread_out

# Components of calibrated rows by which the noise is learned: a variance of so many is known to a
# tenth, and their matrices take milliseconds.
ENOUGH: Final = 400
# Variances of joint errors over that of the rows' own, and chords that near postures share: coarse,
# for a likelihood that is flat.
_POSTURE: Final = 0.0, 0.03, 0.1, 0.3, 1.0, 4.0
_NEAR: Final = 0.1, 0.3, 1.0, 4.0
_REACH: Final = 0.5, 2.0
# Powers of the standard deviations that rows state, with which they may scatter.
_STATED: Final = 1.0, 0.5, 0.0
# The most probable kinds of noise: of many that hardly differ, so many stand for all.
_KINDS: Final = 6


@dataclass(frozen=True)
class NoiseKind:
    """One θ, with how probable it is.

    Attributes:
        weight: its probability.
        stated: power of the standard deviations that rows state, with which they scatter.
        posture, near, reach: θ_1, θ_2 and ℓ.
        variance: estimate of σ², in units of the level that rows are whitened by.
        freedom: of it.
    """

    weight: float
    stated: float
    posture: float
    near: float
    reach: float
    variance: float
    freedom: int


@dataclass(frozen=True, eq=False)
class LearnedErrors:
    """The errors of rows, as those of a calibration show them.

    Attributes:
        kinds: of noise, the probable ones.
        levels: by which rows are whitened, by `sort_of` their block.
        calibrated: what the calibrated rows share, those that the noise was learned by.
        unit: mean variance of these by joint errors of one rad.
        middle: mean logarithm of the standard deviations that they state.
        followed: (n, m) how estimates followed errors of these rows; names: of the estimates (n,).
        share: of all rows that these are.
    """

    kinds: tuple[NoiseKind, ...]
    levels: dict[tuple[str, str, bool], float]
    calibrated: RowErrors
    unit: float
    middle: float
    followed: FloatArray
    names: tuple[str, ...]
    share: float

    @classmethod
    def of(cls, solution: Solution) -> LearnedErrors:
        """That of a calibration, or of an answer over measured poses."""
        levels = fitted_levels(solution)
        terms = spread_out(solution.problem.terms, ENOUGH)
        problem = problem_beside(solution.problem, terms)
        values = {p.name: p.nominal for p in problem.parameters.values()} | solution.values
        x = np.array([values[name] for name in problem.names])
        rows = whitened_rows(problem, x, levels_of(problem, levels))
        errors = RowErrors.of(problem, x, rows)
        names = tuple(
            name for name in (solution.problem.names[k] for k in solution.free) if name in values
        )
        prior = dict(
            zip(solution.problem.names, solution.problem.prior_precision().tolist(), strict=True)
        )
        names = tuple(name for name in names if name in problem.parameters)
        at = [problem.names.index(name) for name in names]
        fit = _fit(rows, errors, at, [prior[name] for name in names])
        by_posture, near = (
            errors.by_posture,
            {reach: errors.near(errors, reach) for reach in _REACH},
        )
        unit = float(np.mean(np.diag(by_posture))) or 1.0
        middle = float(np.mean(errors.stated[errors.stated != 0])) if errors.stated.any() else 0.0
        outlying = _outlying(rows, errors)
        powers = _STATED if errors.stated.any() else _STATED[:1]
        stated, *_ = sorted(
            powers,
            key=lambda power: -_likelihood(fit, errors.scatter(power, middle) + outlying)[0],
        )
        own = errors.scatter(stated, middle) + outlying
        kinds = list[tuple[float, NoiseKind]]()
        for posture, common, reach in _choices():
            covariance = own + (posture * by_posture + common * near[reach]) / unit
            log, variance, freedom = _likelihood(fit, covariance)
            kinds.append((log, NoiseKind(0.0, stated, posture, common, reach, variance, freedom)))
        most = max(log for log, _ in kinds)
        weights = np.exp([log - most for log, _ in kinds])
        counted = np.argsort(-weights)[:_KINDS].tolist()
        total = float(weights[counted].sum())
        return cls(
            tuple(replace(kinds[k][1], weight=float(weights[k]) / total) for k in counted),
            levels,
            errors,
            unit,
            middle,
            -scaled_inverse(fit.information + np.diag(fit.prior)) @ fit.jacobian.T,
            names,
            len(fit.residual) / max(_equations(solution.problem.terms), len(fit.residual)),
        )

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise, on average."""
        return sum(kind.weight * kind.freedom for kind in self.kinds)

    @cached_property
    def of_estimates(self) -> FloatArray:
        """(n, n) covariance of the estimates of `names` by errors like these, without priors.

        That of a calibration, by the scatter of few clusters, may be too small by chance.
        """
        total = np.zeros((len(self.names),) * 2)
        by_posture = self.calibrated.by_posture / self.unit
        for kind in self.kinds:
            own = self.calibrated.scatter(kind.stated, self.middle) + kind.posture * by_posture
            total += kind.weight * kind.variance * (self.followed @ own @ self.followed.T)
        return self.share * total

    def covariances(
        self, errors: RowErrors, jacobian: FloatArray, names: Sequence[str]
    ) -> list[FloatArray]:
        """(m, m) of new rows by each of the kinds of noise, without the estimates' covariance.

        Args:
            errors: what the rows share.
            jacobian: (m, n) by parameters of the new rows' problem.
            names: of these (n,).
        """
        place = {name: k for k, name in enumerate(names)}
        both = [(place[name], k) for k, name in enumerate(self.names) if name in place]
        mine, theirs = np.array(both, dtype=np.intp).reshape(-1, 2).T
        follow = jacobian[:, mine] @ self.followed[theirs]
        lacking = dict[float, FloatArray]()
        for reach in {kind.reach for kind in self.kinds if kind.near}:
            across = follow @ self.calibrated.near(errors, reach)
            there = self.calibrated.near(self.calibrated, reach)
            left = errors.near(errors, reach) + across + across.T + follow @ there @ follow.T
            lacking[reach] = left / self.unit
        by_posture = errors.by_posture / self.unit
        return [
            kind.variance
            * (
                errors.scatter(kind.stated, self.middle)
                + kind.posture * by_posture
                + (kind.near * lacking[kind.reach] if kind.near else 0.0)
            )
            for kind in self.kinds
        ]


def problem_beside(fitted: Problem, terms: Sequence[Term]) -> Problem:
    """A problem of other terms over the arm of a fit, with all of the arm's geometry unknown."""
    if fitted.arm is None:
        return Problem(terms, fitted.arm_parameters)
    return Problem(terms, with_geometry(fitted))


def levels_of(problem: Problem, levels: dict[tuple[str, str, bool], float]) -> list[float]:
    """Level of each block's noise."""
    assumed = iter(problem.assumed_sigmas())
    return [
        levels.get(sort_of(term, block), next(assumed) / scatter_unit(block)) * scatter_unit(block)
        for term in problem.terms
        for block in term.blocks
    ]


def _choices() -> Iterator[tuple[float, float, float]]:
    """θ_1, θ_2 and ℓ that are tried."""
    for posture in _POSTURE:
        yield posture, 0.0, _REACH[0]
        for common, reach in product(_NEAR, _REACH):
            yield posture, common, reach


def _fit(
    rows: Sequence[Rows], errors: RowErrors, free: Sequence[int], prior: Sequence[float]
) -> LinearFit:
    jacobian = np.vstack([r.jacobian[:, free] for r in rows])
    residual = np.concatenate([(r.line.residual / r.line.sigma[:, None]).ravel() for r in rows])
    return LinearFit(errors.combine(jacobian), errors.combine(residual), np.array(prior))


def _outlying(rows: Sequence[Rows], errors: RowErrors) -> FloatArray:
    """(c, c) variance by which rows beyond Huber's threshold scatter more."""
    weight = [np.repeat(r.line.weight, r.line.residual.shape[1]) for r in rows]
    more = np.diag(1.0 / np.concatenate(weight) - 1.0)
    return errors.combine(errors.combine(more).T)


def _likelihood(fit: LinearFit, covariance: FloatArray) -> tuple[float, float, int]:
    """Logarithm of the restricted likelihood, the estimate of σ², and its degrees of freedom."""
    root = np.linalg.cholesky(covariance)
    both = np.hstack([fit.jacobian, fit.residual[:, None]])
    every = solve_triangular(root, both, lower=True, check_finite=False)
    freed = Freed.of(every, fit, 2.0 * float(np.sum(np.log(np.diag(root)))))
    freedom = max(round(len(every) - freed.fit.spent), 1)
    return -0.5 * freed.of_any_noise, max(freed.fit.squares / freedom, 1e-12), freedom


def _equations(terms: Sequence[Term]) -> int:
    """How many numbers the calibrated rows are."""
    return sum(term.equations() for term in terms)
