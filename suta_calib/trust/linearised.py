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
from suta_calib.trust.accuracy import (
    TermAccuracy,
    block_residuals,
    fit_own,
    term_accuracies,
)
from suta_calib.trust.cross_validation import CrossValidation, Fold, FoldErrors, limited_rms
from suta_calib.trust.examination import Examination
from suta_calib.trust.score_tests import Residuals, noise_ratio
from suta_calib.units import Unit

# Times that rows are weighed anew by what is left of them, and a change of weight that is none.
ROUNDS: Final = 8
SAME_WEIGHT: Final = 1e-3
# Information below which a direction stays where it was: half of what the solver asks for, because
# what the whole data tell well enough, a part of them must not lose by a hair.
OPEN: Final = 0.25 * WEAK**-2

# A normal matrix (p, p) and its right side (p,).
Normal = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class _Block:
    """Where the rows of one block lie among all, and what they are counted in.

    Attributes:
        rows: slice of the rows; numbers: slice of their components.
        size: components of a row.
        sigma, threshold: (n,) noise, and Huber's threshold in units of it.
        held: (n,) number of the fold that holds each row out; -1 where none or several do.
        first: whether the errors are lengths of the first term's kind.
        level: noise that errors are counted in.
    """

    rows: slice
    numbers: slice
    size: int
    sigma: FloatArray
    threshold: FloatArray
    held: IntArray
    first: bool
    level: float


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
        self.problem, self.x, self.rows = answer.problem, answer.x, answer.rows
        self._jacobian = np.vstack([r.jacobian for r in self.rows])
        self._residual = np.concatenate(
            [(r.line.residual / r.line.sigma[:, None]).reshape(-1) for r in self.rows]
        )
        self._weight = np.concatenate([r.line.weight for r in self.rows])
        self._blocks, involved = self._laid_out(noise)
        self._row_of = np.concatenate(
            [np.repeat(np.arange(b.rows.start, b.rows.stop), b.size) for b in self._blocks]
        )
        # Per fold, the rows that look at any of its samples: those it is not fitted to.
        self._involved = [np.flatnonzero(mask[self._row_of]) for mask in involved]
        self._index = {name: k for k, name in enumerate(self.problem.names)}
        self._prior()

    def _laid_out(self, noise: Sequence[float]) -> tuple[list[_Block], BoolArray]:
        terms, lines = self.problem.terms, iter(zip(self.rows, noise, strict=True))
        blocks, involved = list[_Block](), list[BoolArray]()
        row = number = 0
        for k, term in enumerate(terms):
            fold = np.full(len(term.poses), -1, dtype=np.intp)
            for f, left_out_fold in enumerate(self.folds):
                fold[left_out_fold.samples[k]] = f
            counted = np.array([k in left_out.held_out for left_out in self.folds])
            for b, block in enumerate(term.blocks):
                (r, level), n = next(lines), len(block)
                of_samples = fold[block.samples]
                same = (of_samples == of_samples[:, :1]).all(axis=1)
                held = np.where(same & counted[of_samples[:, 0]], of_samples[:, 0], -1)
                involved.append(
                    np.array([(of_samples == f).any(axis=1) for f in range(len(self.folds))])
                )
                rows, numbers = slice(row, row + n), slice(number, number + n * block.size)
                first = b == 0 and term.kind == terms[0].kind
                threshold = r.line.view.threshold / r.line.sigma
                blocks.append(
                    _Block(rows, numbers, block.size, r.line.sigma, threshold, held, first, level)
                )
                row, number = rows.stop, numbers.stop
        return blocks, np.concatenate(involved, axis=1)

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
        for _ in range(ROUNDS):
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
        rows = []
        for block, r in zip(self._blocks, self.rows, strict=True):
            residual = fit.residual[block.numbers].reshape(-1, block.size) * block.sigma[:, None]
            line = replace(r.line, residual=residual, weight=fit.weight[block.rows])
            rows.append(replace(r, line=line))
        fitted = frozenset((*self.solution.problem.names, *fit.added))
        level = noise_ratio(self.solution)
        return Residuals(self.problem, rows, fitted, len(fit.free), level)

    def rms(self, fit: ModelFit) -> float:
        """RMS of the fitted errors of the first kind, m, none beyond its Huber threshold."""
        lengths = [
            np.minimum(size, block.threshold) * block.sigma
            for block, size in zip(self._blocks, self._sizes(fit.residual), strict=True)
            if block.first
        ]
        return float(np.sqrt(np.mean(np.concatenate(lengths) ** 2)))

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
        identified = values > max(OPEN, 1e-12 * float(values[-1]))
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
        squares, count, lengths = 0.0, 0, [np.zeros(0)]
        for block, size in zip(self._blocks, self._sizes(residual), strict=True):
            held = block.held == fold
            limited = (np.minimum(size, block.threshold) * block.sigma)[held]
            squares += float(np.sum((limited / block.level) ** 2))
            count += len(limited) * block.size
            lengths += [limited] if block.first else []
        return FoldErrors(squares, count, np.concatenate(lengths))

    def _sizes(self, residual: FloatArray) -> list[FloatArray]:
        """Norms (n,) of the whitened rows, block by block."""
        return [
            np.linalg.norm(residual[b.numbers].reshape(-1, b.size), axis=1) for b in self._blocks
        ]

    def _weights(self, residual: FloatArray) -> FloatArray:
        sizes = self._sizes(residual)
        pairs = zip(self._blocks, sizes, strict=True)
        return np.concatenate([huber_weight(size**2, block.threshold) for block, size in pairs])


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
