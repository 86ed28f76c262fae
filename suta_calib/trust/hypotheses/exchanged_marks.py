"""Two targets on the tip that were exchanged, or one that was moved, while rows were measured."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.terms.term import Term
from suta_calib.trust import (
    AddedVariable,
    Effect,
    Evidence,
    Examination,
    SpoiltData,
    Truth,
    weigh_effects,
)
from suta_calib.trust.simulated_faults import with_columns
from suta_calib.units import with_std


class ExchangedMarks(AddedVariable):
    """From a row on, two targets have one another's label: one is off by d, the other by -d.

    In the frame of the tip; three numbers. The fit places both targets between the two places.
    """

    name = "exchanged targets"
    about = "From some row on, the labels of two targets on the tip are exchanged."

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each pair of targets of a term, with a window for each row that is tried."""
        for k, term in enumerate(answer.problem.terms):
            labels = term.poses.samples.labels[term.mark] if term.marked else np.zeros(0, np.str_)
            for pair in _pairs(labels):
                starts = _starts(labels, *pair)
                if not starts:
                    continue
                effect = _exchanged(answer, k, pair, starts)
                best = next(iter(weigh_effects(answer.fit, [effect])), None)
                # Share of the squared residuals from which on the row itself is looked for.
                if best is not None and best.window is not None and best.share > 0.1:
                    # The row itself, between the neighbours of the best one.
                    near = [0, *starts, len(labels)][best.window : best.window + 3]
                    nearer = [r for r in range(near[0] + 1, near[2]) if labels[r] in pair]
                    # Rows at which an exchange may have been.
                    effect = _exchanged(answer, k, pair, nearer[:: 1 + len(nearer) // 60])
                yield effect

    def sentence(self, evidence: Evidence) -> str:
        """Which targets, from which row on, and how far apart they are."""
        a, b, since = evidence.effect.about
        assert evidence.window is not None
        distance, std = evidence.length()
        return (
            f"The labels of targets {a} and {b} seem to be exchanged from {since[evidence.window]} "
            f"on: from there {a} is {with_std(distance, std, 'm')} away "
            f"from its place, and {b} is as far away in the opposite direction. Exchange the two "
            "labels from this row on."
        )

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The labels of two targets exchanged in the second half of the rows."""
        if not data.marked:
            raise SamplesError("samples without targets", "two targets at least", where=data.kind)
        samples = data.poses.samples
        labels = samples.labels[data.mark].copy()
        a, b = sorted(set(labels.tolist()))[:2]
        late = np.arange(len(labels)) >= len(labels) // 2
        was_a, was_b = late & (labels == a), late & (labels == b)
        labels[was_a], labels[was_b] = b, a
        changed = with_columns(data, labels={**samples.labels, data.mark: labels})
        return SpoiltData(changed, np.full(3, np.nan))


def _exchanged(
    answer: Examination, term: int, pair: tuple[str, str], starts: Sequence[int]
) -> Effect:
    """The effect of an exchange at any of some rows of a term."""
    first, end = answer.boundaries[term : term + 2].tolist()
    samples = answer.problem.terms[term].poses.samples
    labels = samples.labels[answer.problem.terms[term].mark]
    sign = np.zeros(len(answer.q))
    sign[first:end] = (labels == pair[0]) * 1.0 - (labels == pair[1])
    windows = []
    for start in starts:
        late = np.zeros(len(sign))
        late[first + start : end] = 1.0
        windows.append(answer.row_of_sample(late))
    # Targets farther apart than that are not on one tool, m.
    plausible = 0.2
    return Effect(
        " and ".join(pair),
        answer.by_shift(answer.rotation * sign[:, None, None]),
        np.full(3, plausible),
        windows,
        about=(*pair, [samples.origin[start] for start in starts]),
    )


def _pairs(labels: Any) -> list[tuple[str, str]]:
    return list(combinations(sorted(set(labels.tolist())), 2))[:10]


def _starts(labels: Any, a: str, b: str) -> Sequence[int]:
    """Rows at which an exchange is tried: evenly among those that have enough before and after."""
    # Rows of both targets before and after the exchange.
    fewest = 5
    at = [np.flatnonzero(labels == name) for name in (a, b)]
    if min(len(rows) for rows in at) < 2 * fewest:
        return []
    low = max(rows[fewest] for rows in at)
    high = min(rows[-fewest] for rows in at)
    if high < low:
        return []
    # Rows of a term at which an exchange is tried, and pairs of targets: more cost time.
    return [int(row) for row in np.unique(np.linspace(low, high, 16).astype(np.intp))]
