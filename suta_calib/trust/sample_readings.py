"""Samples that are read in another way: what the hypotheses about rows and columns share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SutaCalibError
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust.hypothesis import Reinterpretation, SpoiltData
from suta_calib.trust.spoiling import arm_of

Change = Callable[[Samples], Samples]
# Files of which one alone may be out of step are tried among so many.
MOST_FILES: Final = 20


class MisreadSamples(Reinterpretation):
    """The samples of all terms, changed in the same way."""

    @abstractmethod
    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """What would have to be so, and the change of any term's samples that undoes it."""

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """The terms with all samples changed, where enough of the rows are left."""
        terms = data.terms
        for description, change in self.changes(terms):
            read = [change(term.poses.samples) for term in terms]
            with suppress(SutaCalibError):
                # Share of the rows that a reading must keep: few rows fit anything.
                if all(
                    len(samples) >= 0.33 * len(term.poses)
                    for samples, term in zip(read, terms, strict=True)
                ):
                    pairs = zip(terms, read, strict=True)
                    yield description, tuple(with_samples(*pair) for pair in pairs)

    def fault(self, term: Term) -> tuple[str, Samples]:
        """One of these changes, which undoes itself.

        Returns:
            The description that undoes it, and the samples.
        """
        changes = [*self.changes([term])]
        description, change = changes[len(changes) // 2]
        return description, change(term.poses.samples)

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """A term whose samples have the `fault`."""
        del values, rng
        term: Term = data
        description, samples = self.fault(term)
        return SpoiltData(with_samples(term, samples), np.zeros(0), description)


class MisreadJoints(MisreadSamples):
    """The readings of the joints, column by column."""

    @abstractmethod
    def of_arm(self, arm: ArmModel) -> Iterator[tuple[str, Change]]:
        """The same as `changes`, for an arm."""

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """Those of the arm of all terms."""
        return self.of_arm(arm_of(terms[0]))


def with_samples(term: Term, samples: Samples) -> Term:
    """The term over other samples of the same arm."""
    return term.over_poses(term.poses.with_samples(samples))


def mapped(matrix: FloatArray, shift: FloatArray | float, samples: Samples) -> Samples:
    """Readings times a matrix (joints, joints), plus a shift."""
    return replace(samples, q=samples.q @ matrix + shift)


def scaled(factors: FloatArray, samples: Samples) -> Samples:
    """Measured positions times factors (3,)."""
    if samples.position is None:
        return samples
    return replace(samples, position=samples.position * factors)


def renamed(names: Mapping[str, str], column: str, samples: Samples) -> Samples:
    """Labels of a column with other names."""
    if column not in samples.labels:
        return samples
    new = np.array([names.get(str(old), str(old)) for old in samples.labels[column]])
    return replace(samples, labels={**samples.labels, column: new})


# ── readings paired with the observations of other rows ─────────────────────────────────────────


def files_of(terms: Sequence[Term]) -> list[str]:
    """Names of all files, in their order."""
    return [*dict.fromkeys(f for term in terms for f in term.poses.samples.file_names.tolist())]


def slid(offset: int, file: str, samples: Samples) -> Samples:
    """Readings paired with what was observed ``offset`` rows later, in all files or in one."""
    rows = np.arange(len(samples))
    late = samples.file_names == file if file else np.ones(len(rows), dtype=np.bool_)
    return with_partners(samples, rows + offset * late, np.ones(len(rows), dtype=np.bool_))


def out_of_step(offset: int, file: str, part: int, parts: int, samples: Samples) -> Samples:
    """The same from one of ``parts`` on, which is left out: nobody knows where in it."""
    files = samples.file_names
    partner, sure = np.arange(len(samples)), np.ones(len(samples), dtype=np.bool_)
    for name in np.unique(files):
        mine = np.flatnonzero(files == name)
        # Of other terms the file has no rows, or other files of this one hardly any.
        if name != (file or name) or len(mine) < parts:
            continue
        within = np.array_split(mine, parts)[part]
        partner[mine[mine > within[-1]]] += offset
        # Nor have the first behind it a partner, if what was observed is what is missing.
        sure[mine[(mine >= within[0]) & (mine <= within[-1] + max(-offset, 0))]] = False
    return with_partners(samples, partner, sure)


def with_partners(samples: Samples, partner: IntArray, sure: BoolArray) -> Samples:
    """Readings paired with what was observed in row ``partner`` (n,), where ``sure`` (n,).

    Rows without a partner in their file are left out.
    """
    files, rows = samples.file_names, np.arange(len(samples))
    inside = np.clip(partner, 0, len(rows) - 1)
    usable = rows[(partner == inside) & (files[inside] == files) & sure]
    return paired(samples, usable, partner[usable])


def paired(samples: Samples, rows: IntArray, observed: IntArray) -> Samples:
    """Readings of some rows with what was observed in others."""
    return replace(samples.take(observed), q=samples.q[rows])
