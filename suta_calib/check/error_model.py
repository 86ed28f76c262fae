"""How large the errors of new rows are if nothing changed, as the calibration's residuals say.

The residuals of the calibrated rows have the covariance σ² V(θ) of `row_errors`, less what the fit
took. Their restricted likelihood (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545) over a
grid of θ, flat in log θ beforehand and made finer where the likelihood is sharp, with σ² integrated
out by its Jeffreys prior, says how probable each θ is; given θ, σ² is S / χ²_ν. What the rows do
not tell of the noise is thus in every figure of a check: few rows give a wide mixture.

A picture has many rows and six numbers that tell of the arm: these sums are looked at
(`SampleSums`), and what is left of its rows says what σ² is.

New rows then have, with their derivative J by what was estimated,

    Cov(r) = σ² (V_own + θ_1 V_posture + θ_2 D) + J C Jᵀ,   D = (I, -J G) V_near (I, -J G)ᵀ

where θ_2 is multiplied by the square of the factor by which validation rows widened C, C is the
covariance of the estimates, and G = A⁻¹ J_cᵀ by which they followed the calibrated
rows: of what a model lacks, the fit has taken a part, there and here alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from suta_calib.trust.subsampled import numbers_of, spread_out

# Components of calibrated rows by which the noise is learned: a variance of so many is known to a
# tenth, and their matrices take milliseconds.
ENOUGH: Final = 400
# Variances of joint errors over that of the rows' own, in eighths of a decade: from none (below a
# hundredth) to where the rows' own is nothing beside them, first by decades, then finer.
_NONE, _MOST, _STEPS = -16, 24, (8, 4, 2, 1)
# Chords that near postures share.
_REACH: Final = 0.5, 2.0
# What is less likely than the best by so many in the logarithm is not looked at more closely, and
# so many points within that describe a likelihood.
_LESS_LIKELY: Final = 4.0
_DESCRIBED: Final = 24
# Powers of the standard deviations that rows state, with which they may scatter.
_STATED: Final = 1.0, 0.5, 0.0
# Kinds of noise that stand for all that are probable, each for as much probability.
_KINDS: Final = 12


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


# θ_1 and θ_2 in eighths of a decade, and ℓ; the logarithm of its likelihood, and the rest.
_At = tuple[int, int, float]
_Tried = tuple[float, NoiseKind]


@dataclass(frozen=True, eq=False)
class LearnedErrors:
    """The errors of rows, as those of a calibration show them.

    Attributes:
        kinds: of noise, the probable ones.
        levels: by which rows are whitened, by `sort_of` their block.
        calibrated: what the calibrated rows share, those that the noise was learned by.
        unit: variance of a typical one of these by joint errors of one rad: their median, as what
            is far away may move a hundred times as far.
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
        errors = RowErrors.of(problem, x, rows, summed=True)
        names = tuple(
            name
            for name in (solution.problem.names[k] for k in solution.free)
            if name in problem.parameters
        )
        prior = dict(
            zip(solution.problem.names, solution.problem.prior_precision().tolist(), strict=True)
        )
        at = [problem.names.index(name) for name in names]
        fit = _fit(rows, errors, at, [prior[name] for name in names])
        searches = _Search.of(rows, errors, fit)
        followed = -scaled_inverse(fit.information + np.diag(fit.prior)) @ fit.jacobian.T
        share = numbers_of(terms) / numbers_of(solution.problem.terms)
        # Of other postures the validation rows said how much more a model lacks there.
        elsewhere = solution.widening**2
        return cls(
            tuple(replace(kind, near=kind.near * elsewhere) for kind in _kinds(searches)),
            levels,
            errors,
            searches[0].unit,
            searches[0].middle,
            followed,
            names,
            share,
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


def _fit(
    rows: Sequence[Rows], errors: RowErrors, free: Sequence[int], prior: Sequence[float]
) -> LinearFit:
    jacobian = np.vstack([r.jacobian[:, free] for r in rows])
    residual = np.concatenate([(r.line.residual / r.line.sigma[:, None]).ravel() for r in rows])
    return LinearFit(errors.combine(jacobian), errors.combine(residual), np.array(prior))


@dataclass(frozen=True, eq=False)
class _Search:
    """What θ is probable.

    Attributes:
        fit: of the rows.
        rest: squares, and number, of what no unknown moves.
        own: (c, c) covariance of what each row has for itself, with outliers.
        by_posture, near: the others, near by its reach.
        unit, middle: as of `LearnedErrors`.
        stated: power of the standard deviations that rows state.
    """

    fit: LinearFit
    rest: tuple[float, int]
    own: FloatArray
    by_posture: FloatArray
    near: dict[float, FloatArray]
    unit: float
    middle: float
    stated: float

    @classmethod
    def of(cls, rows: Sequence[Rows], errors: RowErrors, fit: LinearFit) -> list[_Search]:
        """Of calibrated rows: one search for each way to take what they state."""
        assert errors.sums is not None
        weight = np.concatenate([np.repeat(r.line.weight, r.line.residual.shape[1]) for r in rows])
        residual = np.concatenate([(r.line.residual / r.line.sigma[:, None]).ravel() for r in rows])
        # Rows beyond Huber's threshold scatter more.
        outlying = errors.outlying(errors.sums.weights(weight))
        middle = float(np.mean(errors.stated[errors.stated != 0])) if errors.stated.any() else 0.0
        rest = errors.sums.rest(residual, weight)
        by_posture = errors.by_posture
        moved = np.diag(by_posture)
        unit = float(np.median(moved[moved > 0])) if np.any(moved > 0) else 1.0
        near = {reach: errors.near(errors, reach) / unit for reach in _REACH}
        return [
            cls(
                fit,
                rest,
                errors.scatter(power, middle) + outlying,
                by_posture / unit,
                near,
                unit,
                middle,
                power,
            )
            for power in (_STATED if errors.stated.any() else _STATED[:1])
        ]

    def explored(self) -> dict[_At, _Tried]:
        """What was tried: all that is probable, and coarsely the rest."""
        span = range(_NONE, _MOST + 1, _STEPS[0])
        first = [(i, j, reach) for i, j, reach in product(span, span, _REACH)]
        tried = {at: self._tried(at) for at in map(_clear, first)}
        for step in _STEPS[1:]:
            if len(_likely(tried)) >= _DESCRIBED:
                break
            while True:
                beside = {_clear(at) for one in _likely(tried) for at in _beside(one, step)}
                if not (new := beside - tried.keys()):
                    break
                tried |= {at: self._tried(at) for at in new}
        return tried

    def _tried(self, at: _At) -> _Tried:
        """Logarithm of the restricted likelihood; and σ² there, with its degrees of freedom."""
        posture, common = (0.0 if k == _NONE else 10.0 ** (k / _STEPS[0]) for k in at[:2])
        covariance = self.own + posture * self.by_posture + common * self.near[at[2]]
        root = np.linalg.cholesky(covariance)
        both = np.hstack([self.fit.jacobian, self.fit.residual[:, None]])
        every = solve_triangular(root, both, lower=True, check_finite=False)
        freed = Freed.of(every, self.fit, 2.0 * float(np.sum(np.log(np.diag(root)))))
        squares, count = self.rest
        log = -0.5 * freed.beside(squares, count).of_any_noise
        freedom = max(round(len(every) - freed.fit.spent) + count, 1)
        variance = max((freed.fit.squares + squares) / freedom, 1e-12)
        return log, NoiseKind(0.0, self.stated, posture, common, at[2], variance, freedom)


def _kinds(searches: Sequence[_Search]) -> tuple[NoiseKind, ...]:
    """Some that stand for all that are probable, each with as much probability."""
    explored = [(at, *one) for search in searches for at, one in search.explored().items()]
    most = max(log for _, log, _ in explored)
    likely = [one for one in explored if one[1] > most - _LESS_LIKELY]
    likely.sort(key=lambda one: (one[2].stated, one[0]))
    share = np.cumsum([np.exp(log - most) for _, log, _ in likely])
    middles = (np.arange(_KINDS) + 0.5) / _KINDS * share[-1]
    chosen = np.bincount(np.searchsorted(share, middles), minlength=len(likely))
    return tuple(
        replace(kind, weight=float(count) / _KINDS)
        for (*_, kind), count in zip(likely, chosen.tolist(), strict=True)
        if count
    )


def _clear(at: _At) -> _At:
    """A point of the grid within its limits; without near errors they have no reach."""
    posture, near = (min(max(k, _NONE), _MOST) for k in at[:2])
    return posture, near, _REACH[0] if near == _NONE else at[2]


def _beside(at: _At, step: int) -> list[_At]:
    posture, near, reach = at
    # Out of none, near errors may have any reach.
    steps = [(posture + step, near), (posture - step, near), (posture, near - step)]
    reaches = _REACH if near == _NONE else (reach,)
    return [(*k, reach) for k in steps] + [(posture, near + step, other) for other in reaches]


def _likely(tried: Mapping[_At, _Tried]) -> list[_At]:
    """Points that are not much less likely than the best."""
    most = max(log for log, _ in tried.values())
    return [at for at, (log, _) in tried.items() if log > most - _LESS_LIKELY]
