"""Cross-validation of a set of unknowns: errors on left-out placements.

Whole placements are left out, because the postures at one placement resemble each other: what was
learnt at some of them would seem to hold at the rest (leave-one-group-out; Hastie, Tibshirani,
Friedman, The Elements of Statistical Learning, section 7.10). Where there are fewer than three
placements, or none, whole touches are left out, repeats together. Of a recording in motion whole
stretches of time are: rows that follow one another share what drifts, and what is learnt from one
would seem to hold of the next (Roberts et al. 2017, doi:10.1111/ecog.02881).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.model.parameters import ParameterSet
from suta_calib.terms import Term
from suta_calib.trust.accuracy import BlockErrors, TermAccuracy


@dataclass(frozen=True, eq=False)
class Fold:
    """A split into fitted and left-out samples.

    Attributes:
        label: for people.
        held_out: what is, by the number of its term; a term may be missing.
        samples: (n,) which samples of each term are left out of the training.
    """

    label: str
    held_out: Mapping[int, Term]
    samples: tuple[BoolArray, ...]


@dataclass(frozen=True, eq=False)
class FoldErrors:
    """Errors of one fold's held-out rows, none counted beyond its Huber threshold.

    Attributes:
        squares, count: sum of the squared errors in units of the noise, and numbers in them.
        lengths: (n,) error norms of the first kind's first block, m.
    """

    squares: float
    count: int
    lengths: FloatArray


@dataclass(frozen=True, eq=False)
class CrossValidation(Displayable):
    """The held-out errors of one set of unknowns, fold by fold."""

    folds: tuple[FoldErrors, ...]

    @cached_property
    def losses(self) -> FloatArray:
        """(folds,) mean squared error of each fold in units of the noise."""
        return np.array([fold.squares / fold.count for fold in self.folds])

    @property
    def loss(self) -> float:
        """Mean of `losses`, all folds alike."""
        return float(self.losses.mean())

    @property
    def rms(self) -> float:
        """Of all held-out errors of the first kind, m; none counted beyond its Huber threshold."""
        return float(np.sqrt(np.mean(np.concatenate([f.lengths for f in self.folds]) ** 2)))

    def gain_over(self, other: CrossValidation) -> tuple[float, float]:
        """Reduction of the loss, and its standard error, paired by fold."""
        change = other.losses - self.losses
        return float(change.mean()), float(change.std(ddof=1) / np.sqrt(len(change)))

    def outdoes(self, other: CrossValidation, errors: float = 1.0, share: float = 0.02) -> bool:
        """Whether it predicts left-out samples better than another, in four of five folds.

        Args:
            other: on the same folds.
            errors: standard errors by which the loss must be smaller.
            share: of the other's loss by which it must be smaller: less is not worth an unknown.
        """
        gain, error = self.gain_over(other)
        worse = np.mean(self.losses >= other.losses)
        enough = max(errors * error, share * other.loss)
        return bool(gain > enough and worse <= 0.2)


@dataclass(frozen=True, eq=False)
class ModelCandidate(Displayable):
    """One set of unknowns, cross-validated.

    Attributes:
        name: for people.
        geometry: whether all of the geometry is unknown, not only what the job frees.
        added: names of the parameters that are no geometry.
        parameters: the arm's unknowns.
        fitted: RMS of the errors that were fitted, m, of the same kind as those held out.
        held_out: errors on what was left out.
    """

    name: str
    geometry: bool
    added: tuple[str, ...]
    parameters: ParameterSet
    fitted: float
    held_out: CrossValidation

    def gain_over(self, other: ModelCandidate) -> tuple[float, float]:
        """As of the held-out errors."""
        return self.held_out.gain_over(other.held_out)

    def outdoes(self, other: ModelCandidate, errors: float = 1.0) -> bool:
        """As of the held-out errors."""
        return self.held_out.outdoes(other.held_out, errors)


def folds_of(terms: Sequence[Term], seed: int = 0) -> tuple[Fold, ...]:
    """Split the samples of all terms; what has no placements by time, or else at random.

    Raises:
        SamplesError: too few placements and touches to leave any out.
    """
    columns = [t.poses.samples.labels.get("placement", ()) for t in terms]
    placements = list(dict.fromkeys(str(name) for column in columns for name in column))
    fewest_placements = 3
    by_placement = len(placements) >= fewest_placements
    most_folds = 10
    folds_of_touches = 5
    surely_enough = 1000
    moving = any(_moves(term) for term in terms)
    count = min(len(placements), most_folds) if by_placement else folds_of_touches
    if moving and not by_placement:
        count = most_folds
    rng = np.random.default_rng(seed)
    number = [_fold_numbers(t, placements if by_placement else [], count, rng) for t in terms]
    folds = []
    for k in range(count):
        part = f"stretch {k + 1} of the recordings" if moving else f"part {k + 1}"
        label = ", ".join(placements[k::count]) if by_placement else part
        # What is left must be enough for every term. Of many samples it is, and to build the terms
        # takes long.
        for term, numbers in zip(terms, number, strict=True):
            if len(term.poses) < surely_enough:
                term.take(numbers != k)
        held_out = {}
        for row, (term, numbers) in enumerate(zip(terms, number, strict=True)):
            # What is too small for its kind is left out.
            with suppress(SamplesError):
                if (numbers == k).any():
                    held_out[row] = term.take(numbers == k)
        if held_out:
            samples = tuple(n == k for n in number)
            folds.append(Fold(label, held_out, samples))
    if len(folds) < 2:
        raise SamplesError(
            "too few touches to leave any out",
            "at least two placements, better five",
            where="folds",
        )
    return tuple(folds)


def _moves(term: Term) -> bool:
    """Whether its rows are of a recording in motion; an arm rests where it touches."""
    return term.medium != "touch" and term.poses.samples.time is not None


def _fold_numbers(
    term: Term, placements: Sequence[str], count: int, rng: np.random.Generator
) -> IntArray:
    labels = term.poses.samples.labels
    if placements and "placement" in labels:
        order = {name: k % count for k, name in enumerate(placements)}
        return np.array([order[str(p)] for p in labels["placement"]], dtype=np.intp)
    touch = term.clusters
    if _moves(term):
        return np.asarray(np.arange(len(touch)) * count // len(touch), dtype=np.intp)
    numbers = np.arange(int(touch.max()) + 1) % count
    return np.asarray(rng.permutation(numbers)[touch], dtype=np.intp)


def limited_rms(terms: Sequence[TermAccuracy]) -> float:
    """RMS of the errors of the first term's kind, m, none counted beyond its Huber threshold."""
    same = [t for t in terms if t.term.kind == terms[0].term.kind]
    errors = [limited_errors(t.blocks[0], t.term.blocks[0].noise.huber) for t in same]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def limited_errors(block: BlockErrors, threshold: float) -> FloatArray:
    """Error norms (n,), none beyond the threshold of the robust loss."""
    return np.minimum(block.after, threshold)
