"""Information of each candidate on the arm, and the subset with the least uncertainty.

Every candidate has its own unknowns (where the point is, where the artefact stands); they follow
the arm and are eliminated (Schur complement), with the solver's own formulas for curvature,
variance by sample, and what noise makes up. What is left adds up over candidates, because different
candidates share no sample. An instrument's pose is shared by all samples, so it stays in.

The choice is greedy, then Fedorov's exchange (1972, Theory of Optimal Experiments): one chosen
candidate is put back and the best one taken in its place, until no exchange helps. The criteria are
of the sandwich covariance, with what is plausible of each parameter as a prior, so that they are
finite for any data:

    d    ½ log det C / p   mean log uncertainty of a parameter (D-optimality, Wald 1943)
    tip  √ trace(W C)      root mean square uncertainty of the tip in a region (V-optimality)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg.lapack import dpstrf

from suta_calib.analysis.planning.candidates import Candidate
from suta_calib.analysis.planning.situation import Situation
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.identifiability import Identification, identify, schur_complement
from suta_calib.solver.information import Information, predicted_information
from suta_calib.solver.problem import Problem
from suta_calib.terms import KINDS

# Unknowns that belong to one place: another place has its own.
_PRIVATE: Final = tuple(
    f"{name}[" for kind in KINDS.values() for name in (kind.place_unknown, *kind.place_more) if name
)
CRITERIA: Final = ("tip", "d")


@dataclass(frozen=True, eq=False)
class SharedUnknowns(Displayable):
    """The unknowns that data from different places have in common.

    They are the arm's free ones, ``arm_count`` of them, then those of instruments and of seats.
    What the model lacks, ``lacking`` times the noise, is in every variance of information here.
    """

    parameters: ParameterSet
    arm_count: int
    lacking: float = 1.0

    @classmethod
    def of(cls, situation: Situation) -> SharedUnknowns:
        """The arm's free parameters, and unknowns of terms that are not of one place."""
        problem = situation.problem
        free = [p for p in problem.parameters.values() if p.free]
        arm = [p for p in free if p.name in problem.arm_parameters]
        shared_own = [p for p in free[len(arm) :] if not p.name.startswith(_PRIVATE)]
        return cls(ParameterSet([*arm, *shared_own]), len(arm), situation.lacking)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the unknowns, in order."""
        return self.parameters.names

    @property
    def unit(self) -> FloatArray:
        """(p,) how far off each might be: matrices here are in units of it."""
        return self.parameters.array("plausible")

    @property
    def precision(self) -> FloatArray:
        """(p,) 1/prior², in plausible units; zero where there is no prior."""
        prior = self.parameters.array("prior")
        has_prior = ~np.isnan(prior)
        return np.where(has_prior, (self.unit / np.where(has_prior, prior, 1.0)) ** 2, 0.0)

    @property
    def regulariser(self) -> FloatArray:
        """(p,) precision of what is plausible before any data, or of the prior where it is more."""
        return np.maximum(self.precision, 1.0)

    def identify(self, information: SharedInformation, fixed: Sequence[str] = ()) -> Identification:
        """What such information determines; ``fixed`` parameters are taken as known."""
        parameters = ParameterSet(
            replace(
                p,
                prior=None if p.prior is None else p.prior / p.plausible,
                plausible=1.0,
                free=p.name not in fixed,
            )
            for p in self.parameters.values()
        )
        # As a calibration does, which holds nothing for what its model lacks.
        data_information = Information(
            information.curvature, information.variance / self.lacking**2, information.noise_induced
        )
        return identify(parameters, self.arm_count, data_information, self.precision)

    def covariance(self, information: SharedInformation, estimated: IntArray) -> FloatArray:
        """Sandwich (p, p) in SI units, with all but ``estimated`` taken as known."""
        inside = np.ix_(estimated, estimated)
        prior = np.diag(self.precision)
        bread = np.zeros_like(prior)
        bread[inside] = np.linalg.pinv((information.curvature + prior)[inside], 1e-12, True)
        return self._sandwich(bread, information.variance + prior)

    def plausible_covariance(self, information: SharedInformation) -> FloatArray:
        """The same with everything estimated, and plausible ranges as priors; SI units."""
        prior = np.diag(self.regulariser)
        bread = np.asarray(np.linalg.inv(information.curvature + prior))
        return self._sandwich(bread, information.variance + prior)

    def _sandwich(self, bread: FloatArray, filling: FloatArray) -> FloatArray:
        return np.asarray(bread @ filling @ bread * np.outer(self.unit, self.unit))


class SharedInformation(Information):
    """The same matrices (p, p) over the shared unknowns, in plausible units; they add up."""

    def __add__(self, other: SharedInformation) -> SharedInformation:
        return SharedInformation(
            self.curvature + other.curvature,
            self.variance + other.variance,
            self.noise_induced + other.noise_induced,
        )

    def times(self, repeats: float) -> SharedInformation:
        """As many independent repeats."""
        return SharedInformation(
            repeats * self.curvature, repeats * self.variance, repeats * self.noise_induced
        )


def no_information(space: SharedUnknowns) -> SharedInformation:
    """No data."""
    zero = np.zeros((len(space.names),) * 2)
    return SharedInformation(zero, zero, zero)


def present_information(situation: Situation, space: SharedUnknowns) -> SharedInformation:
    """Information of the present data."""
    return _shared_information(situation.problem, situation.x, situation.sigmas, space)


def candidate_information(
    situation: Situation, space: SharedUnknowns, candidate: Candidate
) -> SharedInformation:
    """Information of a candidate with all its repeats."""
    term, arm = situation.term(candidate), situation.problem.arm_parameters
    problem = Problem([term], arm)
    values = {p.name: p.nominal for p in arm.values()} | situation.values
    # One sample is too few for the closed-form start of what is shared and known.
    if not all(p.name in values for p in term.own_parameters):
        values = term.start_values(situation.values) | values
    x = np.array([values[name] for name in problem.names])
    return _shared_information(problem, x, situation.noise(term), space).times(candidate.repeats)


def _shared_information(
    problem: Problem, x: FloatArray, sigmas: Sequence[float], space: SharedUnknowns
) -> SharedInformation:
    """Information on the shared unknowns, the private ones having followed."""
    information = predicted_information(problem, x, sigmas)
    unit = problem.parameters.array("plausible")
    scale = np.outer(unit, unit)
    variance = space.lacking**2 * information.variance
    matrices = [information.curvature, variance, information.noise_induced]
    index = {name: k for k, name in enumerate(space.names)}
    fixed = {p.name for p in problem.parameters.values() if not p.free}
    shared = [k for k, name in enumerate(problem.names) if name in index]
    private = [k for k, n in enumerate(problem.names) if n not in index and n not in fixed]
    private_precision = np.zeros(len(unit))
    private_precision[private] = (problem.prior_precision() * unit**2)[private]
    reduced = schur_complement(
        [m * scale for m in matrices],
        private_precision,
        np.array(shared, dtype=np.intp),
        np.array(private, dtype=np.intp),
    )
    places = np.ix_(*[[index[problem.names[k]] for k in shared]] * 2)
    totals = [np.zeros((len(index),) * 2) for _ in reduced]
    for target, part in zip(totals, reduced, strict=True):
        target[places] = part
    return SharedInformation(*totals)


@dataclass(frozen=True, eq=False)
class Design(Displayable):
    """Candidates, and the criterion for a choice among them.

    Matrices are kept in coordinates in which everything is uncorrelated and of variance one before
    any data, without the directions that nothing here tells anything about.

    Attributes:
        basis: (p, r) these coordinates in units of what is plausible.
        curvature, variance: (N, r, r) of each candidate.
        weight: (r, r) of the tip's variance, m².
        untold: variance of the tip that nothing here lessens, m².
        arm_count: how many parameters are the arm's.
        criterion: ``tip`` or ``d``.
    """

    basis: FloatArray
    curvature: FloatArray
    variance: FloatArray
    weight: FloatArray
    unestimated: float
    arm_count: int
    criterion: str

    @classmethod
    def over(
        cls,
        space: SharedUnknowns,
        information: Sequence[SharedInformation],
        weight: FloatArray,
        criterion: str,
        present: SharedInformation,
    ) -> Design:
        """Stack the candidates' matrices.

        Args:
            space: the unknowns.
            information: of each candidate.
            weight: (p, p) W with tip variance = trace(W C), C in SI units.
            criterion: ``tip`` or ``d``.
            present: information at hand.
        """
        scale = 1.0 / np.sqrt(space.regulariser)
        total = present.curvature + sum(t.curvature for t in information)
        values, vectors = np.linalg.eigh(scale[:, None] * total * scale)
        # Information, of what was plausible before any data, below which a direction is told by
        # nothing.
        basis = scale[:, None] * vectors[:, values > 1e-7]
        tip = weight * np.outer(space.unit, space.unit)
        inner = basis.T @ tip @ basis
        unestimated = float(scale @ (np.diag(tip) * scale) - np.trace(inner))
        return cls(
            basis,
            np.array([basis.T @ t.curvature @ basis for t in information]),
            np.array([basis.T @ t.variance @ basis for t in information]),
            inner,
            max(unestimated, 0.0),
            space.arm_count,
            criterion,
        )

    def __len__(self) -> int:
        return len(self.curvature)

    def values(self, curvature: FloatArray, variance: FloatArray) -> FloatArray:
        """The criterion, smaller is better, (...) for matrices (..., r, r)."""
        spread = self._spread(curvature, variance)
        return self._estimated(spread) if self.criterion == "tip" else self._d(spread)

    def tip(self, start: SharedInformation, chosen: Sequence[int] = ()) -> float:
        """Root mean square uncertainty of the tip, m."""
        information = float(self._estimated(self._spread(*self.of(start, chosen))))
        return math.hypot(information, math.sqrt(self.unestimated))

    def d(self, start: SharedInformation, chosen: Sequence[int] = ()) -> float:
        """Log uncertainty of all parameters per one of the arm's, up to a constant."""
        return float(self._d(self._spread(*self.of(start, chosen))))

    def of(self, start: SharedInformation, chosen: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Curvature and variance (r, r) of the start and a choice together."""
        rows = list(chosen)
        return (
            self.basis.T @ start.curvature @ self.basis + self.curvature[rows].sum(axis=0),
            self.basis.T @ start.variance @ self.basis + self.variance[rows].sum(axis=0),
        )

    def value(self, start: SharedInformation, chosen: Sequence[int]) -> float:
        """The criterion of one choice."""
        return float(self.values(*self.of(start, chosen)))

    @property
    def work(self) -> float:
        """Multiplications, about, of looking for the next candidate."""
        count, unknowns, directions = self._ranges[0].shape
        return float(8 * count * unknowns**2 * directions)

    def with_each(self, start: SharedInformation, chosen: Sequence[int] = ()) -> FloatArray:
        """The criterion (N,) with each candidate added to a choice."""
        return self._with_each(*self.of(start, chosen))

    def best_next(self, start: SharedInformation, chosen: Sequence[int]) -> tuple[int, float]:
        """The candidate to add to a choice, and the criterion with it."""
        values = self.with_each(start, chosen)
        values[list(chosen)] = np.inf
        best = int(np.argmin(values))
        return best, float(values[best])

    def _with_each(self, curvature: FloatArray, variance: FloatArray) -> FloatArray:
        """The criterion (N,) with each candidate added to matrices (r, r).

        A candidate informs about few directions: with H = (C + 1)⁻¹ without it, and Q c Qᵀ of its
        own, the inverse is H - H Q (1 + c Qᵀ H Q)⁻¹ c Qᵀ H (Woodbury).
        """
        basis, own_curvature, own_variance = self._ranges
        one, back = np.eye(len(curvature)), basis.transpose(0, 2, 1)
        bread, filling = np.linalg.inv(curvature + one), variance + one
        met = np.eye(basis.shape[2]) + own_curvature @ (back @ (bread @ basis))
        if self.criterion == "d":
            solved = back @ np.linalg.solve(filling, basis)
            logarithm = np.linalg.slogdet(bread @ filling @ bread)[1]
            logarithm = logarithm - 2.0 * np.linalg.slogdet(met)[1]
            logarithm += np.linalg.slogdet(np.eye(basis.shape[2]) + own_variance @ solved)[1]
            return np.asarray(0.5 * logarithm / self.arm_count)
        left = np.linalg.inv(met)
        less, spread = left @ own_curvature, bread @ filling @ bread
        weighted = self.weight @ bread
        by_tip = back @ (bread @ weighted @ basis)
        square = np.trace(self.weight @ spread) - 2.0 * _traces(
            less, back @ (spread @ weighted @ basis)
        )
        square += _traces(less @ (back @ (spread @ basis)), less @ by_tip)
        square += _traces(left @ own_variance @ left.transpose(0, 2, 1), by_tip)
        return np.asarray(np.sqrt(np.maximum(square, 0.0)))

    @cached_property
    def _ranges(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(N, r, m) bases of what each candidate informs about; its matrices (N, m, m) in them."""
        bases = [_range(pair) for pair in self.curvature + self.variance]
        most = max(basis.shape[1] for basis in bases)
        basis = np.stack(
            [np.pad(narrow, ((0, 0), (0, most - narrow.shape[1]))) for narrow in bases]
        )
        back = basis.transpose(0, 2, 1)
        return basis, back @ (self.curvature @ basis), back @ (self.variance @ basis)

    def _spread(self, curvature: FloatArray, variance: FloatArray) -> FloatArray:
        prior = np.eye(curvature.shape[-1])
        bread = np.linalg.inv(curvature + prior)
        return np.asarray(bread @ (variance + prior) @ bread)

    def _estimated(self, spread: FloatArray) -> FloatArray:
        """The tip's uncertainty without what nothing lessens: that would drown small gains."""
        information = np.einsum("ij,...ji->...", self.weight, spread)
        return np.asarray(np.sqrt(np.maximum(information, 0.0)))

    def _d(self, spread: FloatArray) -> FloatArray:
        _, logarithm = np.linalg.slogdet(spread)
        return np.asarray(0.5 * logarithm / self.arm_count)


def _range(matrix: FloatArray) -> FloatArray:
    """Orthonormal basis (r, m) of a matrix (r, r) without negative eigenvalues."""
    # Information below this part of the largest is rounding.
    rounding = 1e-13
    lower, pivots, rank, _ = dpstrf(matrix, tol=rounding * np.diag(matrix).max(), lower=1)
    columns = np.zeros((len(matrix), rank))
    columns[pivots - 1] = np.tril(lower)[:, :rank]
    return np.asarray(np.linalg.qr(columns)[0])


def _traces(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N,) traces of products of matrices (N, m, m)."""
    return np.asarray(np.einsum("nij,nji->n", a, b))


def greedy(design: Design, start: SharedInformation, count: int) -> list[int]:
    """``count`` candidates, each the best after those before it; fewer where there are fewer."""
    picked = list[int]()
    while len(picked) < min(count, len(design)):
        picked.append(design.best_next(start, picked)[0])
    return picked


def exchange(design: Design, start: SharedInformation, chosen: Sequence[int]) -> list[int]:
    """Exchange single candidates until none is worth it; best first in the end."""
    # An exchange must gain this share of the criterion's value to count: less is rounding.
    worth = 1e-7
    picked = list(chosen)
    # Of hundreds of candidates for hundreds of unknowns no more is tried than some seconds allow.
    most_passes = min(20, int(2e11 / (design.work * max(len(picked), 1))))
    value = design.value(start, picked)
    for _ in range(most_passes):
        before = value
        for place in range(len(picked)):
            rest = picked[:place] + picked[place + 1 :]
            other, better = design.best_next(start, rest)
            if better < value - worth * abs(value):
                picked[place], value = other, better
        if value >= before:
            break
    return ordered(design, start, picked)


def best_set(design: Design, start: SharedInformation, count: int) -> list[int]:
    """Greedy choice, improved by exchange; best first."""
    if count >= len(design):
        return [int(k) for k in np.argsort(design.with_each(start), kind="stable")]
    return exchange(design, start, greedy(design, start, count))


def ordered(design: Design, start: SharedInformation, chosen: Sequence[int]) -> list[int]:
    """The same candidates, each the best of those left after those before it."""
    left, picked = list(chosen), list[int]()
    while left:
        values = design.with_each(start, picked)[left]
        picked.append(left.pop(int(np.argmin(values))))
    return picked


def random_sets(design: Design, count: int, sets: int, seed: int) -> list[list[int]]:
    """Random choices of ``count`` different candidates."""
    rng = np.random.default_rng(seed)
    size = min(count, len(design))
    return [rng.choice(len(design), size, replace=False).tolist() for _ in range(sets)]
