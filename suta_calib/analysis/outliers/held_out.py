"""What excluding a group would do on data that were not fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from suta_calib.analysis.outliers.answer import HeldOut
from suta_calib.analysis.outliers.groups import Grouping, groupings
from suta_calib.analysis.outliers.reference import ReferenceFit
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.diagnostics.accuracy import fit_own
from suta_calib.errors import InputError
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.problem import Problem
from suta_calib.terms.term import Term

# Folds that rows without placements or points are dealt into.
FOLDS = 10


@dataclass(frozen=True, eq=False)
class Judge:
    """Held-out errors of the calibration with a group and without it.

    Attributes:
        reference: the job's own fit, nothing set aside.
        validation: terms that are never fitted; the samples' own, in turn, where there are none.
    """

    reference: ReferenceFit
    validation: tuple[Term, ...]

    @property
    def method(self) -> str:
        """How data were held out."""
        if self.validation:
            return "validation"
        return f"leave one of the {self._folds()[0]} out"

    def of(self, grouping: Grouping, group: int) -> HeldOut | None:
        """The effect of excluding one group; None where nothing would be left to fit or judge."""
        rows = grouping.rows(group)
        if self.validation:
            return self._on_validation(grouping.name, grouping.labels[group], rows)
        return self._by_folds(rows)

    def _on_validation(self, level: str, label: str, rows: BoolArray) -> HeldOut | None:
        everything = np.ones(len(rows), dtype=bool)
        before, after = self.reference.over(everything), self.reference.over(~rows)
        if before is None or after is None:
            return None
        pairs = [
            (
                *self._errors(term, before.values),
                *self._errors(term, after.values),
                _excluded(term, level, label),
            )
            for term in self.validation
            if term.kind == self.validation[0].kind
        ]
        first, second, kept = [], [], []
        for error, samples, other, _, out in pairs:
            first.append(error)
            second.append(other)
            kept.append(~out[samples].any(axis=1))
        return _summary(*(np.concatenate(part) for part in (first, second, kept)))

    def _by_folds(self, rows: BoolArray) -> HeldOut | None:
        first, second, kept = [], [], []
        for fold in self._folds()[1]:
            before, after = self.reference.over(~fold), self.reference.over(~fold & ~rows)
            if before is None or after is None:
                continue
            try:
                left_out = self.reference.term.take(np.flatnonzero(fold))
            except InputError:
                continue
            error, samples = self._errors(left_out, before.values)
            first.append(error)
            second.append(self._errors(left_out, after.values)[0])
            kept.append(~rows[fold][samples].any(axis=1))
        if not first:
            return None
        return _summary(*(np.concatenate(part) for part in (first, second, kept)))

    def _folds(self) -> tuple[str, list[BoolArray]]:
        """Placements, as their repeats are no independent witnesses; else points, else rows."""
        found = {g.name: g for g in groupings(self.reference.term)}
        for name in ("placements", "sets", "points"):
            if name in found:
                return name, [found[name].rows(k) for k in range(len(found[name]))]
        n = len(self.reference.term.poses)
        dealt = np.random.default_rng(0).permutation(n) % min(FOLDS, n)
        return f"{min(FOLDS, n)} parts", [dealt == k for k in range(min(FOLDS, n))]

    def _errors(self, term: Term, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        return held_out_errors(term, self.reference.parameters, values)


def held_out_errors(
    term: Term, parameters: ParameterSet, values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Error norms (n,) of a held-out term's first block, m, and the samples of each (n, k).

    The arm is held; the term's own unknowns keep their value where it is known and are fitted
    where it is not.
    """
    arm = {p.name: values.get(p.name, p.nominal) for p in parameters.values()}
    own = {p.name: values[p.name] for p in term.own if p.name in values}
    fitted = fit_own([term], parameters, arm | own)
    problem = Problem([term], parameters)
    x = np.array([fitted[name] for name in problem.names])
    line = problem.linearise(x, problem.assumed_sigmas())[0]
    return np.linalg.norm(line.residual, axis=1), np.asarray(term.blocks[0].samples)


def _excluded(term: Term, level: str, label: str) -> BoolArray:
    """(samples,) rows of a validation term that are the excluded landmark's too."""
    names = term.poses.samples.labels.get("landmark") if level == "landmarks" else None
    return np.zeros(len(term.poses), dtype=bool) if names is None else np.asarray(names == label)


def _summary(before: FloatArray, after: FloatArray, kept: BoolArray) -> HeldOut | None:
    if not kept.any():
        return None
    return HeldOut(_rms(before[kept]), _rms(after[kept]), _rms(after), int(kept.sum()))


def _rms(errors: Sequence[float] | FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))
