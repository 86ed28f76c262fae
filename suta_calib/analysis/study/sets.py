"""Measurements drawn again: which of them belong together, and terms over some of them.

A *set* is what a protocol measures in one go, so that it is drawn or left as a whole. Where samples
have a placement and a repeat, that is one round over the artefact: distances exist only within it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import IntArray
from suta_calib.errors import SamplesError, did_you_mean
from suta_calib.measurements.samples import joined
from suta_calib.terms import KINDS
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term

SAMPLE: Final = "sample"
# What may be drawn, and which label columns make two samples belong together: whatever the kinds
# group by where they touched, or samples one by one.
UNITS: Final[dict[str, tuple[str, ...]]] = {
    noun: columns
    for kind in KINDS.values()
    for noun, columns in kind.groupings.items()
    if kind.place in columns
} | {SAMPLE: ()}


@dataclass(frozen=True, eq=False)
class Sets:
    """What is drawn, and which samples it takes along."""

    unit: str  # what one set is, of `UNITS`
    names: tuple[str, ...]  # of the sets, in order of first appearance
    # For each term the set (samples,) of each sample; None for a term without such sets, which is
    # kept whole.
    members: tuple[IntArray | None, ...]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def kept_whole(self) -> tuple[int, ...]:
        """Numbers of the terms that every draw contains whole."""
        return tuple(k for k, members in enumerate(self.members) if members is None)

    def take(self, terms: Sequence[Term], chosen: Sequence[int]) -> tuple[Term, ...]:
        """The terms over the chosen sets; a term that has no sample in them is left out.

        A set that comes twice is measured twice: its copies do not pair with each other.
        """
        parts = []
        for term, members in zip(terms, self.members, strict=True):
            if members is None:
                parts.append(term)
            elif np.isin(members, chosen).any():
                parts.append(self._drawn(term, members, chosen))
        return tuple(parts)

    def rest(self, terms: Sequence[Term], chosen: Sequence[int]) -> tuple[Term, ...]:
        """The terms over the sets that were not chosen, without those that are kept whole."""
        left = np.setdiff1d(np.arange(len(self)), chosen)
        parts = []
        for term, members in zip(terms, self.members, strict=True):
            if members is not None and np.isin(members, left).any():
                parts.append(term.take(np.isin(members, left)))
        return tuple(parts)

    def _drawn(self, term: Term, members: IntArray, chosen: Sequence[int]) -> Term:
        copies = [(k, c) for k, count in Counter(chosen).items() for c in range(count)]
        rows = [np.flatnonzero(members == k) for k, _ in copies]
        copy = np.repeat([c for _, c in copies], [len(r) for r in rows])
        index = np.concatenate(rows)
        if not copy.any():
            # In the order they were measured: the same set of sets is the same problem.
            return term.take(np.sort(index))
        assert isinstance(term.poses, ArmPoses)
        samples = term.poses.samples.take(index)
        if "repeat" in samples.labels:
            # Copies are further repeats: distances are formed within a repeat.
            pairs = zip(samples.labels["repeat"], copy, strict=True)
            repeats = [f"{repeat}~{c + 1}" if c else str(repeat) for repeat, c in pairs]
            samples = replace(samples, labels={**samples.labels, "repeat": np.array(repeats)})
        return term.over_poses(ArmPoses(term.poses.arm, samples))


def sets_of(terms: Sequence[Term], unit: str | None = None) -> Sets:
    """The sets that samples of these terms form; a label in two terms is one set.

    A set is by default one placement and repeat where any term has them; else ``point``, or what
    else is touched, where there are four or more; else ``sample``.
    """
    # Fewer sets cannot be chosen from.
    fewest_sets = 2
    unit = _natural(terms) if unit is None else unit
    if unit not in UNITS:
        hint = did_you_mean(unit, UNITS)
        raise SamplesError(repr(unit), f"one of {', '.join(UNITS)}", where="unit", hint=hint)
    labelled: list[list[str] | None] = []
    for k, term in enumerate(terms):
        labels = term.poses.samples.labels
        if unit == SAMPLE:
            labelled.append([f"{k + 1}:{row + 1}" for row in range(len(term.poses))])
        elif all(name in labels for name in UNITS[unit]):
            labelled.append([str(name) for name in joined(labels, UNITS[unit])])
        else:
            labelled.append(None)
    names = tuple(dict.fromkeys(name for labels in labelled for name in labels or ()))
    if not names:
        raise SamplesError(
            f"no samples with {' and '.join(UNITS[unit])}",
            "an observation whose samples have them",
            where="observations",
            hint="draw other units, for example sample",
        )
    if len(names) < fewest_sets:
        raise SamplesError(
            f"one {unit} only ({names[0]})",
            f"at least {fewest_sets} to draw from",
            where="observations",
            hint="measure more of them, or draw smaller units, for example sample",
        )
    index = {name: k for k, name in enumerate(names)}
    members = tuple(
        None if labels is None else np.array([index[n] for n in labels], dtype=np.intp)
        for labels in labelled
    )
    return Sets(unit, names, members)


def _natural(terms: Sequence[Term]) -> str:
    """The smallest sets of the first kind that touches an artefact; else places, if enough."""
    artefacts = [list(term.groupings) for term in terms if term.needs_artefact]
    if artefacts:
        return next(unit for unit in reversed(artefacts[0]) if unit in UNITS)
    places: dict[str, set[str]] = {}
    for term in terms:
        if term.place:
            names = term.poses.samples.labels[term.place]
            places.setdefault(term.place, set()).update(map(str, names))
    # Fewer points than this, or other places, leave too few subsets to choose from: then touches
    # are drawn one by one.
    return next((place for place in places if len(places[place]) >= 4), SAMPLE)


def described(unit: str) -> str:
    """What one set is, for a sentence."""
    columns = UNITS[unit]
    if len(columns) > 1:
        return f"one {' and '.join(columns)}"
    if not columns:
        return f"one {unit}"
    on_artefact = any(kind.needs_artefact for kind in KINDS.values() if kind.place == unit)
    return f"one {unit} with all its repeats" if on_artefact else f"all touches of one {unit}"
