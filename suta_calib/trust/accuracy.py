"""Errors before and after calibration, on fitted data and on validation data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import chdtri, fdtri, stdtrit

from suta_calib.arguments import checked
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.assessment import attempt
from suta_calib.display import Displayable
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.gauss_newton import GaussNewton
from suta_calib.solver.information import whitened_rows
from suta_calib.solver.nlp import RobustNlp
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.poses import together
from suta_calib.terms.term import Term
from suta_calib.threads import single_threaded
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.units import Unit

# Chance that an arm which is as good as the other is called better, and the same for worse.
CHANCE: Final = 0.01
# Lengths, m, that differ by less are the same: no arm resolves a tenth of a micrometre.
ROUNDING: Final = 1e-7


@dataclass(frozen=True)
class Metrics:
    """Summary of absolute errors, all with the same weight.

    Attributes:
        rms, mean, std, maximum: of the error norms, m (or rad); std about the mean.
        count: how many errors.
    """

    rms: float
    mean: float
    std: float
    maximum: float
    count: int

    @classmethod
    def of(cls, errors: FloatArray) -> Metrics:
        """Summarise non-negative errors (n,); all NaN where there are none."""
        if not len(errors):
            return cls(np.nan, np.nan, np.nan, np.nan, 0)
        rms = float(np.sqrt(np.mean(errors**2)))
        return cls(rms, float(errors.mean()), float(errors.std()), float(errors.max()), len(errors))


@dataclass(frozen=True, eq=False)
class BlockErrors(Displayable):
    """Errors of one residual block of a term.

    Attributes:
        name: ``distance``, ``position`` or ``rotation``.
        unit: m or rad.
        labels: (n,) name of the landmark, pair or row.
        rows: (n, k) samples that each error depends on.
        residual_before, residual_after: (n, d) with sign.
        pixel: length that a pixel covers, m, where they were seen in pictures.
    """

    name: str
    unit: Unit
    labels: tuple[str, ...]
    rows: IntArray
    residual_before: FloatArray
    residual_after: FloatArray
    pixel: float | None = None

    @cached_property
    def before(self) -> FloatArray:
        """Norms of the residuals (n,) with the nominal arm."""
        return np.asarray(np.linalg.norm(self.residual_before, axis=1))

    @cached_property
    def after(self) -> FloatArray:
        """Norms of the residuals (n,) with the calibrated arm."""
        return np.asarray(np.linalg.norm(self.residual_after, axis=1))


@dataclass(frozen=True, eq=False)
class TermAccuracy(Displayable):
    """Errors of one term, with the nominal and with the calibrated arm."""

    term: Term
    blocks: tuple[BlockErrors, ...]

    @property
    def before(self) -> Metrics:
        """Of the lengths (the first block), with the nominal arm."""
        return Metrics.of(self.blocks[0].before)

    @property
    def after(self) -> Metrics:
        """Of the lengths (the first block), with the calibrated arm."""
        return Metrics.of(self.blocks[0].after)


@dataclass(frozen=True)
class Gain:
    """Difference of the validation errors of nominal and calibrated arm, with its significance.

    Both arms are tested on the same rows, so squared errors are compared row by row, and rows that
    err together count once. An arm that was right before gets worse by what its estimates are
    unsure of: that alone is no reason not to use it.

    Attributes:
        before, after: root mean square errors with either arm, in ``unit``.
        mean: of the squares before less those after, in its square, as all that follow.
        std: of that mean, from its scatter among the clusters.
        clusters: how many there are.
        unsure: mean square that the estimates' covariance adds to the errors.
        unsure_std: of that, because all rows see the same estimates.
        unit: SI unit of the errors.
    """

    before: float
    after: float
    mean: float
    std: float
    clusters: int
    unsure: float = 0.0
    unsure_std: float = 0.0
    unit: Unit = "m"

    @property
    def significance(self) -> float:
        """Mean difference in standard errors (of scatter and of the estimates)."""
        differ = abs(self.before - self.after) > ROUNDING
        error = math.hypot(self.std, self.unsure_std)
        if not differ:
            return 0.0
        return self.mean / error if error > 0 else math.copysign(math.inf, self.mean)

    @property
    def better(self) -> bool:
        """Whether the calibrated arm is significantly better."""
        differ = self.before - self.after > ROUNDING
        return differ and (self.mean > self._limit * self.std or self._far(self.before, self.after))

    @property
    def worse(self) -> bool:
        """Whether it is significantly worse, also in view of the uncertainty of its estimates."""
        if self.after - self.before < ROUNDING:
            return False
        if -self.mean < self._limit * self.std and not self._far(self.after, self.before):
            return False
        explained = self.unsure + math.hypot(self._limit * self.std, self._unsure_at_most)
        # Times the error before from which on nothing excuses the error after.
        return -self.mean > explained or self.after > 1.5 * self.before

    def _far(self, larger: float, smaller: float) -> bool:
        """Whether one error is so many times the other as chance does not make it.

        Where most of a mean is one posture at which the worse arm is far off, the scatter is as
        large as the mean and hides it. The variance ratio (F) does not know that scatter; that both
        arms have the same noise in the same rows only brings the two closer.
        """
        freedom = self.clusters - 1
        if freedom < 1:
            return False
        return larger**2 > float(fdtri(freedom, freedom, 1.0 - CHANCE)) * smaller**2

    @property
    def _unsure_at_most(self) -> float:
        """What chance adds to `unsure`: a sum of few squares, as chi-squared (Satterthwaite)."""
        if not self.unsure_std > 0:
            return 0.0
        freedom = 2.0 * (self.unsure / self.unsure_std) ** 2
        return self.unsure * (float(chdtri(freedom, CHANCE)) / freedom - 1.0)

    @property
    def _limit(self) -> float:
        """Standard errors that chance exceeds with probability `CHANCE`, on one side."""
        freedom = self.clusters - 1
        return float(stdtrit(freedom, 1.0 - CHANCE)) if freedom > 0 else math.inf


@dataclass(frozen=True, eq=False)
class Accuracy(Displayable):
    """Errors of the fitted terms and of the held-out ones.

    Attributes:
        calibration, validation: one for each term.
        held_out_values: of the held-out terms' parameters, with the calibrated arm, m or rad.
        nominal_values: of the fitted terms' parameters, with the nominal arm, m or rad.
        held_out_nominal: the same of the held-out terms.
        unjudged: why the validation errors could not be computed, one sentence each.
        gain: on the held-out terms of the first one's kind; None where nothing is held out.
    """

    calibration: tuple[TermAccuracy, ...]
    validation: tuple[TermAccuracy, ...]
    held_out_values: Mapping[str, float] = field(default_factory=dict)
    gain: Gain | None = None
    nominal_values: Mapping[str, float] = field(default_factory=dict)
    held_out_nominal: Mapping[str, float] = field(default_factory=dict)
    unjudged: tuple[str, ...] = ()

    @property
    def worse(self) -> bool:
        """Whether the calibrated arm is worse than the nominal one on the held-out terms."""
        return self.gain is not None and self.gain.worse

    @staticmethod
    def overall(terms: Sequence[TermAccuracy], which: str) -> Metrics:
        """Over all terms of the first one's kind; ``which`` is ``before`` or ``after``."""
        if not terms:
            return Metrics.of(np.zeros(0))
        errors = [getattr(term.blocks[0], which) for term in _of_first_kind(terms)]
        return Metrics.of(np.concatenate(errors))


def _of_first_kind(terms: Sequence[TermAccuracy]) -> list[TermAccuracy]:
    return [term for term in terms if term.term.kind == terms[0].term.kind]


@single_threaded
@checked
def assess(solution: Solution, validation: Sequence[Term] = ()) -> Accuracy:
    """Errors with the nominal and with the calibrated arm; the arm itself is not fitted.

    A term's own unknown keeps the value fitted on the observations where its name occurs there;
    otherwise it is fitted on the validation rows alone, for the nominal arm as for the calibrated.
    """
    fitted, failed = _fitted(solution), list[str]()
    held_out = attempt(
        "judged: validation data",
        lambda: _held_out(solution, validation, fitted) if validation else fitted,
        fitted,
        failed,
    )
    return replace(held_out, unjudged=tuple(failed))


def _fitted(solution: Solution) -> Accuracy:
    """Errors of the fitted terms alone."""
    problem = solution.problem
    arm, after = problem.arm_parameters, solution.values
    before = attempt(
        "judged: the nominal arm",
        lambda: fit_own(problem.terms, arm, {p.name: p.nominal for p in arm.values()}),
        after,
    )
    # What is known of the solution is asked for there: of many rows it takes as long as a fit.
    found = [line.error for line in problem.linearise(solution.x, problem.assumed_sigmas())]
    residuals = block_residuals(problem.terms, arm, before), found
    return Accuracy(term_accuracies(problem.terms, *residuals), (), nominal_values=before)


def _held_out(solution: Solution, validation: Sequence[Term], fitted: Accuracy) -> Accuracy:
    """The same with errors of the held-out terms."""
    problem = solution.problem
    arm, nominal = problem.arm_parameters, fitted.nominal_values
    before, after = (fit_own(validation, arm, v) for v in (nominal, solution.values))
    residuals = (block_residuals(validation, arm, values) for values in (before, after))
    terms = term_accuracies(validation, *residuals)
    judged = [term.term for term in _of_first_kind(terms)]
    covariance = solution.covariance_seen_by(judged)
    unsure = added_by_estimates(judged, arm, after, problem.names, covariance)
    gain = gain_of(terms, *unsure)
    return Accuracy(fitted.calibration, terms, after, gain, nominal, before)


def gain_of(
    terms: Sequence[TermAccuracy], unsure: float = 0.0, unsure_std: float = 0.0
) -> Gain | None:
    """What is gained over all terms of the first one's kind; None without terms.

    Args:
        terms: held out.
        unsure: mean square that the estimates' covariance adds to the errors, m².
        unsure_std: standard deviation of that, m².
    """
    if not terms:
        return None
    same = _of_first_kind(terms)
    squares = [t.blocks[0].before ** 2 - t.blocks[0].after ** 2 for t in same]
    mean = float(np.mean(np.concatenate(squares)))
    rows, variance, clusters = sum(map(len, squares)), 0.0, 0
    for term, square in zip(same, squares, strict=True):
        members = term.term.clusters[term.blocks[0].rows]
        variance += _variance_of_sum(square - mean, members)
        clusters += int(np.count_nonzero(np.bincount(members.reshape(-1))))
    variance *= clusters / max(clusters - 1, 1)
    before, after = (Accuracy.overall(terms, which).rms for which in ("before", "after"))
    std = math.sqrt(variance) / rows
    unit = same[0].term.error_unit
    return Gain(before, after, mean, std, clusters, unsure, unsure_std, unit)


def _variance_of_sum(values: FloatArray, members: IntArray) -> float:
    """Of centred values (n,), of which those that share a member (n, k) go together."""
    fit = LinearFit(np.zeros((len(values), 0)), values, clusters=members)
    variance = float(fit.score_variance(np.ones((len(values), 1)), values)[0, 0])
    return max(variance, float(np.sum(values**2))) if members.shape[1] > 1 else variance


def added_by_estimates(
    terms: Sequence[Term],
    arm: ParameterSet,
    values: Mapping[str, float],
    names: Sequence[str],
    covariance: FloatArray,
) -> tuple[float, float]:
    """Mean square, m², that estimates' covariance adds to the terms' lengths, and its scatter, m².

    Args:
        terms: whose first blocks are looked at.
        arm: the arm's parameters.
        values: of all parameters.
        names: what was estimated (n,).
        covariance: (n, n) of it, m and rad.
    """
    problem = Problem(terms, arm)
    x = np.array([values[name] for name in problem.names])
    index = {name: k for k, name in enumerate(names)}
    shared = [k for k, name in enumerate(problem.names) if name in index]
    at = [index[problem.names[k]] for k in shared]
    firsts = {id(term.blocks[0]) for term in terms}
    rows, squares = 0, np.zeros((len(shared), len(shared)))
    for r in whitened_rows(problem, x, problem.assumed_sigmas()):
        block = r.line.view.block
        if id(block) in firsts:
            n, size = r.line.residual.shape
            scale = np.broadcast_to(r.line.sigma[:, None] * block.relative, (n, size))
            jacobian = r.jacobian[:, shared] * scale.reshape(-1, 1)
            squares += jacobian.T @ jacobian
            rows += n
    added = covariance[np.ix_(at, at)] @ squares / rows
    return float(np.trace(added)), math.sqrt(max(2.0 * float(np.trace(added @ added)), 0.0))


def fit_own(
    terms: Sequence[Term], arm: ParameterSet, fixed: Mapping[str, float]
) -> dict[str, float]:
    """Values of all parameters: the known ones as they are, the terms' other unknowns fitted."""
    problem = Problem(terms, arm)
    x, names = problem.start(fixed), problem.names
    x = np.array([fixed.get(name, value) for name, value in zip(names, x, strict=True)])
    unknown = [
        k
        for k, p in enumerate(problem.parameters.values())
        if k >= problem.arm_count and p.free and p.name not in fixed
    ]
    free = np.array(unknown, dtype=np.intp)
    nlp = RobustNlp(problem, free, problem.assumed_sigmas())
    return dict(fixed) | problem.values(GaussNewton(confirm=False).minimise(nlp, x).x)


def block_residuals(
    terms: Sequence[Term], arm: ParameterSet, values: Mapping[str, float]
) -> list[FloatArray]:
    """Residuals (n, d), m or rad, of every block of the terms, in their order.

    Args:
        terms: what is looked at.
        arm: the arm's parameters; empty where the terms' own arm is as it is.
        values: of all parameters, the terms' own among them.
    """
    problem = Problem(terms, arm)
    x = np.array([values[name] for name in problem.names])
    return [line.error for line in problem.linearise(x, problem.assumed_sigmas())]


def term_accuracies(
    terms: Sequence[Term], before: Sequence[FloatArray], after: Sequence[FloatArray]
) -> tuple[TermAccuracy, ...]:
    """Terms with the residuals of their blocks, as `block_residuals` gives them."""
    pairs = iter(zip(before, after, strict=True))
    return tuple(
        TermAccuracy(
            term,
            tuple(
                BlockErrors(b.name, b.unit, b.labels, b.samples, *next(pairs), b.pixel)
                for b in term.blocks
            ),
        )
        for term in terms
    )


def fitted_too(fitted: Sequence[Term], held_out: Sequence[Term]) -> BoolArray:
    """Validation rows, (n,) of all terms in order, that are also among the fitted rows."""
    fitted_keys = {key for term in fitted for key in term.poses.samples.as_keys()}
    keys = [key for term in held_out for key in term.poses.samples.as_keys()]
    return np.array([key in fitted_keys for key in keys], dtype=np.bool_)


def read_where_fitted(fitted: Sequence[Term], held_out: Sequence[Term]) -> BoolArray:
    """Likewise which were read where fitted ones were, without moving or back there."""
    if not held_out:
        return np.zeros(0, dtype=np.bool_)
    count = sum(len(term.poses) for term in fitted)
    rests = together(np.vstack([term.poses.samples.q for term in (*fitted, *held_out)]))
    return np.isin(rests[count:], rests[:count])
