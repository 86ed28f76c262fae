"""Fits of many models for the price of one: the problem is linearised once, with all candidates.

At a fit that has converged, a model with more unknowns differs from it by micrometres to a tenth
of a millimetre; what the kinematics bend over so short a way is nothing. So the whitened rows and
their derivatives by whatever may be unknown are taken once, and their normal matrix summed once for
all rows and once for those of each fold. A model is then a choice of columns; a fold left out is a
subtraction; rows whose Huber weight changes are a low-rank update (Golub, Van Loan, Matrix
Computations, section 6.5.4).

A model that lacks something has residuals that look like some error. That alone is no reason to
act: only an error whose estimation lowers the errors of rows that were left out is worth a note.
This is the first step of the search of `analysis.model_selection`, with the same folds, on the fit
linearised at its solution, and judged on the validation rows as well where there are any.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.solver.identifiability import WEAK
from suta_calib.solver.losses import huber_weight
from suta_calib.trust.accuracy import TermAccuracy, block_residuals, fit_own, term_accuracies
from suta_calib.trust.cross_validation import CrossValidation, Fold, FoldErrors, limited_rms
from suta_calib.trust.examination import Examination
from suta_calib.trust.score_tests import Residuals, noise_ratio
from suta_calib.units import Unit

# A change of weight that is none.
SAME_WEIGHT: Final = 1e-3

# A normal matrix (p, p) and its right side (p,).
Normal = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class ModelFit:
    """A model fitted to all rows.

    Attributes:
        added: names beside the unknowns of the fit that was linearised.
        free: columns that were estimated; step: (free,) how far they went.
        residual: (numbers,) whitened; weight: (rows,) Huber's.
    """

    added: tuple[str, ...]
    free: IntArray
    step: FloatArray
    residual: FloatArray
    weight: FloatArray


class LinearModels:
    """A converged fit over an arm, its problem linear in all that the arm can be given.

    Args:
        answer: that fit, examined.
        folds: what is left out each time.
        noise: what held-out errors of each block are counted in.
    """

    def __init__(self, answer: Examination, folds: Sequence[Fold], noise: Sequence[float]) -> None:
        self.solution, self.folds = answer.solution, folds
        self.problem, self.x = answer.problem, answer.x
        self._everything = answer.everything
        self._jacobian, self._residual = answer.everything.jacobian, answer.everything.residual
        lines = [r.line for r in answer.rows]
        count = [len(line.residual) for line in lines]
        # (rows,) components of a row, its noise, the noise that errors are counted in, and whether
        # it is a length of the first term's kind.
        self._size = np.repeat([line.residual.shape[1] for line in lines], count)
        self._sigma = np.concatenate([line.sigma for line in lines])
        self._level = np.repeat(noise, count)
        first = [
            block is term.blocks[0] and term.kind == self.problem.terms[0].kind
            for term in self.problem.terms
            for block in term.blocks
        ]
        self._first = np.repeat(first, count)
        self._weight = np.concatenate([line.weight for line in lines])
        self._row_of = np.repeat(np.arange(len(self._size)), self._size)
        self._held, involved = self._left_out()
        # Per fold, the rows that look at any of its samples: those it is not fitted to.
        self._involved = [np.flatnonzero(mask[self._row_of]) for mask in involved]
        self._index = {name: k for k, name in enumerate(self.problem.names)}
        self._prior()

    def _left_out(self) -> tuple[IntArray, BoolArray]:
        """(rows,) number of the fold that holds each row out; -1 where none or several do.

        And (folds, rows) which look at any of its samples.
        """
        held, involved = list[IntArray](), list[BoolArray]()
        for k, term in enumerate(self.problem.terms):
            fold = np.full(len(term.poses), -1, dtype=np.intp)
            for f, left_out in enumerate(self.folds):
                fold[left_out.samples[k]] = f
            counted = np.array([k in left_out.held_out for left_out in self.folds])
            for block in term.blocks:
                of_samples = fold[block.samples]
                same = (of_samples == of_samples[:, :1]).all(axis=1)
                held.append(np.where(same & counted[of_samples[:, 0]], of_samples[:, 0], -1))
                by_fold = [(of_samples == f).any(axis=1) for f in range(len(self.folds))]
                involved.append(np.array(by_fold))
        return np.concatenate(held), np.concatenate(involved, axis=1)

    def _prior(self) -> None:
        """Priors as the fit had them, and where directions that stay open stay."""
        fitted = self.solution.problem
        learned = dict(zip(fitted.names, fitted.prior_precision(), strict=True))
        given = dict(zip(self.problem.names, self.problem.prior_precision(), strict=True))
        self._precision = np.array([learned.get(n, given[n]) for n in self.problem.names])
        nominal = self._nominal = self.problem.parameters.array("nominal")
        self._away = np.where(self._precision > 0, self.x - nominal, 0.0)
        count = self.problem.arm_count
        self._anchor = np.where(np.arange(len(nominal)) < count, nominal - self.x, 0.0)
        prior_std = 1.0 / np.sqrt(np.maximum(self._precision, 1e-300))
        plausible = self.problem.parameters.array("plausible")
        self._unit = np.where(self._precision > 0, 2.0 * prior_std / WEAK, plausible)
        self._fitted_free = np.array(
            [self._index[fitted.names[k]] for k in self.solution.free], dtype=np.intp
        )

    @cached_property
    def _gram(self) -> tuple[Normal, list[Normal]]:
        """Of all rows, and of those of each fold."""
        return self._sums(slice(None)), [self._sums(rows) for rows in self._involved]

    def _sums(self, rows: slice | IntArray) -> Normal:
        jacobian, weight = self._jacobian[rows], self._weight[self._row_of[rows]]
        believed = jacobian * weight[:, None]
        return believed.T @ jacobian, believed.T @ self._residual[rows]

    # ── fits ────────────────────────────────────────────────────────────────────────────────
    def fit(self, added: Iterable[str] = ()) -> ModelFit:
        """The model with these unknowns too, fitted to all rows.

        What would end beyond its bounds is none of them: it takes the place of something else.
        """
        added = tuple(added)
        while True:
            fit = self._fit(added)
            count = len(added)
            value = self._nominal[fit.free[-count:]] + fit.step[-count:] if count else np.zeros(0)
            arm = self.problem.parameters
            plausible = tuple(
                n for n, v in zip(added, value, strict=True) if abs(v) < arm[n].plausible
            )
            if plausible == added:
                return fit
            added = plausible

    def _fit(self, added: tuple[str, ...]) -> ModelFit:
        columns = np.array([self._index[n] for n in added], dtype=np.intp)
        free = np.concatenate([self._fitted_free, columns])
        jacobian = self._jacobian[:, free]
        step, residual, weight = np.zeros(len(free)), self._residual, self._weight
        for _ in range(8):
            step = self._solved(free, *self._reweighed(free, weight, None))
            residual = self._residual + jacobian @ step
            before, weight = weight, self._weights(residual)
            if np.abs(weight - before).max() < SAME_WEIGHT:
                break
        return ModelFit(added, free, step, residual, weight)

    @cached_property
    def as_fitted(self) -> CrossValidation:
        """Errors on each fold of the model as it was fitted."""
        return self.cross_validation(self.fit())

    def residuals(self, fit: ModelFit) -> Residuals:
        """What is left by a model, to be tested."""
        weight = fit.weight[self._row_of]
        left = replace(self._everything, residual=fit.residual, weight=weight, from_prior=None)
        fitted = frozenset((*self.solution.problem.names, *fit.added))
        level = noise_ratio(self.solution)
        return Residuals(self.problem, left, fitted, len(fit.free), level)

    def rms(self, fit: ModelFit) -> float:
        """RMS of the fitted errors of the first kind, m, none beyond its Huber threshold."""
        return float(np.sqrt(np.mean(self._limited(fit.residual)[self._first] ** 2)))

    def cross_validation(self, fit: ModelFit) -> CrossValidation:
        """Errors on each fold of the model fitted to the rest, rows weighed as the fit does."""
        errors = []
        everything = self._reweighed(fit.free, fit.weight, None)
        jacobian = self._jacobian[:, fit.free]
        for k in range(len(self.folds)):
            mine = self._reweighed(fit.free, fit.weight, k)
            step = self._solved(fit.free, *(a - b for a, b in zip(everything, mine, strict=True)))
            rows = self._involved[k]
            residual = np.zeros_like(self._residual)
            residual[rows] = self._residual[rows] + jacobian[rows] @ step
            errors.append(self._errors(k, self._registered(k, residual)))
        return CrossValidation(tuple(errors))

    def _reweighed(self, free: IntArray, weight: FloatArray, fold: int | None) -> Normal:
        """Of some columns: of all rows, or of one fold's."""
        total, parts = self._gram
        matrix, right = total if fold is None else parts[fold]
        matrix, right = matrix[np.ix_(free, free)], right[free]
        change = (weight - self._weight)[self._row_of]
        changed = np.abs(change) > 0.1 * SAME_WEIGHT
        rows = np.flatnonzero(changed)
        if fold is not None:
            rows = self._involved[fold][changed[self._involved[fold]]]
        if len(rows):
            jacobian = self._jacobian[np.ix_(rows, free)]
            more = jacobian * change[rows, None]
            matrix, right = matrix + more.T @ jacobian, right + more.T @ self._residual[rows]
        return matrix, right

    def _solved(self, free: IntArray, matrix: FloatArray, right: FloatArray) -> FloatArray:
        """Step of some columns; what is open stays where it was before any data."""
        prior, unit, anchor = self._precision[free], self._unit[free], self._anchor[free]
        curvature = matrix + np.diag(prior)
        gradient = right + prior * self._away[free] + curvature @ anchor
        values, vectors = np.linalg.eigh(curvature * np.outer(unit, unit))
        # Half of what the solver asks for, because what the whole data tell well enough, a part of
        # them must not lose by a hair.
        identified = values > max(0.25 * WEAK**-2, 1e-12 * float(values[-1]))
        directions = vectors[:, identified]
        return np.asarray(
            anchor - unit * (directions @ ((directions.T @ (unit * gradient)) / values[identified]))
        )

    def _registered(self, fold: int, residual: FloatArray) -> FloatArray:
        """The held-out residuals, own unknowns that only they look at fitted to them."""
        own_columns = self._own_of_fold[fold]
        if not len(own_columns):
            return residual
        rows = self._involved[fold]
        jacobian, registered = self._jacobian[np.ix_(rows, own_columns)], residual.copy()
        for _ in range(3):
            root = np.sqrt(self._weights(registered))[self._row_of[rows]]
            step = np.linalg.lstsq(jacobian * root[:, None], -residual[rows] * root, rcond=None)[0]
            registered[rows] = residual[rows] + jacobian @ step
        return registered

    @cached_property
    def _own_of_fold(self) -> list[IntArray]:
        """Own unknowns that no row beyond the fold's looks at."""
        count = self.problem.arm_count
        looked = self._jacobian[:, count:] != 0.0
        columns = []
        for rows in self._involved:
            rest = np.ones(len(looked), dtype=bool)
            rest[rows] = False
            only = looked[rows].any(axis=0) & ~looked[rest].any(axis=0)
            columns.append(count + np.flatnonzero(only))
        return columns

    def _errors(self, fold: int, residual: FloatArray) -> FoldErrors:
        held = self._held == fold
        limited = self._limited(residual)
        squares = float(np.sum((limited / self._level)[held] ** 2))
        return FoldErrors(squares, int(np.sum(self._size[held])), limited[held & self._first])

    def _limited(self, residual: FloatArray) -> FloatArray:
        """(rows,) lengths of the errors, none beyond its Huber threshold."""
        size = np.sqrt(self._everything.row_squares(residual))
        return np.asarray(np.minimum(size, self._threshold) * self._sigma)

    @property
    def _threshold(self) -> FloatArray:
        assert self._everything.threshold is not None
        return self._everything.threshold

    def _weights(self, residual: FloatArray) -> FloatArray:
        """(rows,) Huber's."""
        return huber_weight(self._everything.row_squares(residual), self._threshold)


# Share of the squared held-out errors that an error must explain: less changes the RMS by less than
# 5 %, which nobody notices.
WORTH_A_NOTE: Final = 0.1


@dataclass(frozen=True)
class ExtensionGain:
    """What estimating some parameters as well makes of the errors of rows that were left out.

    Attributes:
        names: the parameters.
        before, after: RMS of the held-out errors, none counted beyond its Huber threshold.
        unit: SI unit of these.
    """

    names: tuple[str, ...]
    before: float
    after: float
    unit: Unit


def best_extension(
    linear: LinearModels, validation: Sequence[TermAccuracy], choices: Sequence[Sequence[str]]
) -> ExtensionGain | None:
    """The choice that predicts left-out rows best, if any of them is worth a note.

    Args:
        linear: a converged answer over an arm.
        validation: errors of the held-out terms, which must gain as much.
        choices: names of parameters that the job does not estimate, each set tried alone.

    Returns:
        None where no choice lowers the held-out errors by more than chance and by `WORTH_A_NOTE`.
    """
    job = linear.as_fitted
    best: tuple[CrossValidation, ModelFit] | None = None
    for names in choices:
        fit = linear.fit(names)
        errors = linear.cross_validation(fit)
        if not fit.added or not errors.outdoes(job, share=WORTH_A_NOTE):
            continue
        if (best is None or errors.loss < best[0].loss) and _holds_on(validation, linear, fit):
            best = errors, fit
    if best is None:
        return None
    unit = linear.problem.terms[0].error_unit
    return ExtensionGain(best[1].added, job.rms, best[0].rms, unit)


def _holds_on(validation: Sequence[TermAccuracy], linear: LinearModels, fit: ModelFit) -> bool:
    """Whether the validation rows gain as much as is worth a note, own unknowns fitted anew.

    Folds of few placements resemble the rest; validation rows are of other days and places.
    """
    if not validation:
        return True
    problem, terms = linear.problem, [errors.term for errors in validation]
    x = linear.x.copy()
    x[fit.free] += fit.step
    arm = problem.arm_parameters
    values = fit_own(terms, arm, dict(zip(problem.names, x.tolist(), strict=True)))
    residuals = block_residuals(terms, arm, values)
    zero = [np.zeros_like(residual) for residual in residuals]
    after = limited_rms(term_accuracies(terms, zero, residuals))
    return after**2 < (1.0 - WORTH_A_NOTE) * limited_rms(validation) ** 2
