"""How far off, before and after, on the data that were fitted and on data that were not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.ipopt import RobustNlp, SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.term import Term
from suta_calib.threads import single_threaded
from suta_calib.units import Unit


@dataclass(frozen=True)
class Metrics:
    """Summary of absolute errors: every one counts, none is down-weighted.

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
class BlockErrors:
    """Errors of one block of a term.

    Attributes:
        name: ``distance``, ``position`` or ``rotation``.
        unit: m or rad.
        labels: (n,) what was looked at: a landmark, a pair, a row.
        rows: (n, k) samples each error belongs to.
        residual_before, residual_after: (n, d) with sign.
    """

    name: str
    unit: Unit
    labels: tuple[str, ...]
    rows: IntArray
    residual_before: FloatArray
    residual_after: FloatArray

    @cached_property
    def before(self) -> FloatArray:
        """Norms of the residuals (n,) with the nominal arm."""
        return np.asarray(np.linalg.norm(self.residual_before, axis=1))

    @cached_property
    def after(self) -> FloatArray:
        """Norms of the residuals (n,) with the calibrated arm."""
        return np.asarray(np.linalg.norm(self.residual_after, axis=1))


@dataclass(frozen=True, eq=False)
class TermAccuracy:
    """One term, nominal arm against calibrated arm."""

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


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of the fitted terms and of the held-out ones.

    Attributes:
        calibration, validation: one for each term.
        held_out_values: of the held-out terms' parameters, with the calibrated arm, m or rad.
    """

    calibration: tuple[TermAccuracy, ...]
    validation: tuple[TermAccuracy, ...]
    held_out_values: Mapping[str, float] = field(default_factory=dict)

    @property
    def worse(self) -> bool:
        """Whether the calibrated arm is worse than the nominal one on the held-out terms."""
        before, after = (self.overall(self.validation, which).rms for which in ("before", "after"))
        return after > before

    @staticmethod
    def overall(terms: Sequence[TermAccuracy], which: str) -> Metrics:
        """Over all terms of the first one's kind; ``which`` is ``before`` or ``after``."""
        if not terms:
            return Metrics.of(np.zeros(0))
        same = [t for t in terms if t.term.kind == terms[0].term.kind]
        return Metrics.of(np.concatenate([getattr(t.blocks[0], which) for t in same]))


@single_threaded
def assess(solution: Solution, validation: Sequence[Term] = ()) -> Accuracy:
    """Errors with the nominal and with the calibrated arm, the arm held in both.

    A term's own unknown keeps the value fitted on the observations where its name occurs there;
    otherwise it is fitted on the validation rows alone, for the nominal arm as for the calibrated.
    """
    problem = solution.problem
    arm = problem.arm_parameters
    nominal = {p.name: p.nominal for p in arm.values()}
    before = fit_own(problem.terms, arm, nominal)
    after = solution.values
    found = (block_residuals(problem.terms, arm, values) for values in (before, after))
    calibration = term_accuracies(problem.terms, *found)
    if not validation:
        return Accuracy(calibration, ())
    before, after = (fit_own(validation, arm, values) for values in (before, after))
    found = (block_residuals(validation, arm, values) for values in (before, after))
    return Accuracy(calibration, term_accuracies(validation, *found), after)


def fit_own(
    terms: Sequence[Term], arm: ParameterSet, known: Mapping[str, float]
) -> dict[str, float]:
    """Values of all parameters: the known ones as they are, the terms' other unknowns fitted."""
    problem = Problem(terms, arm)
    x, names = problem.start(known), problem.names
    x = np.array([known.get(name, value) for name, value in zip(names, x, strict=True)])
    unknown = [k for k, name in enumerate(names) if k >= problem.arm_count and name not in known]
    free = np.array(unknown, dtype=np.intp)
    nlp = RobustNlp(problem, free, problem.assumed_sigmas(), SolverOptions())
    return dict(known) | problem.values(nlp.minimise(x).x)


def block_residuals(
    terms: Sequence[Term], arm: ParameterSet, values: Mapping[str, float]
) -> list[FloatArray]:
    """Residuals (n, d) of every block of the terms, in their order.

    Args:
        terms: what is looked at.
        arm: the arm's parameters; empty where the terms' own arm is as it is.
        values: of all parameters, the terms' own among them.
    """
    problem = Problem(terms, arm)
    x = np.array([values[name] for name in problem.names])
    return [line.residual.copy() for line in problem.linearise(x, problem.assumed_sigmas())]


def term_accuracies(
    terms: Sequence[Term], before: Sequence[FloatArray], after: Sequence[FloatArray]
) -> tuple[TermAccuracy, ...]:
    """Terms with the residuals of their blocks, as `block_residuals` gives them."""
    pairs = iter(zip(before, after, strict=True))
    return tuple(
        TermAccuracy(
            term,
            tuple(
                BlockErrors(b.name, b.unit, b.labels, b.samples, *next(pairs)) for b in term.blocks
            ),
        )
        for term in terms
    )
