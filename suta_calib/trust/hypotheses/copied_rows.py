"""Rows that are repeated to the last digit, in two files or in one file after the arm moved."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.patterns import may_read_alike
from suta_calib.words import listed


class CopiedRows(Pattern):
    """All numbers of two rows are equal, and the arm moved between them."""

    name = "copied rows"
    about = "Rows appear twice in the files."
    precedence = 21

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """One for rows that stand twice in a file, and one for each pair of files."""
        terms = [term for term in terms if not may_read_alike(term.poses.samples)]
        hashes = [np.zeros(0, np.uint64), *(t.poses.samples.hashes() for t in terms)]
        if len(np.unique(np.concatenate(hashes))) == sum(map(len, hashes)):
            return
        first: dict[tuple[str, bytes], _Place] = {}
        again: Counter[str] = Counter()
        copies: Counter[tuple[str, str, bool]] = Counter()
        for number, term in enumerate(terms):
            samples = term.poses.samples
            visits = np.cumsum(np.diff(term.poses.rests, prepend=-1) != 0).tolist()
            rows = zip(samples.as_keys(), _labels(samples), samples.files(), visits, strict=True)
            for key, label, (file, name), visit in rows:
                place = _Place(number, file, name, visit, set())
                original = first.setdefault((term.kind, key), place)
                if (original.term, original.file) != (number, file):
                    copies[name, original.name, original.term == number] += 1
                # The same readings may be of another repeat: a socket is met again.
                elif original.visit != visit and label in original.labels:
                    again[name] += 1
                original.labels.add(label)
        if again:
            yield (
                f"{again.total()} rows of {listed([*again])} appear twice or more in the same "
                "file. They count once."
            )
        for (copy, source, once), count in copies.items():
            counted = "They count once" if once else "They count twice: name every file once"
            yield f"{count} rows of {copy} are in {source} too. {counted}."

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The first fourth of the rows again at the end."""
        count = len(data.poses)
        rows = np.concatenate([np.arange(count), np.arange(count // 4)])
        return SpoiltData(data.take(rows), effect=f"{count // 4} rows of ")


@dataclass(frozen=True)
class _Place:
    """Where a row stood first: term, file, visit of its rest; and the labels it had since."""

    term: int
    file: int
    name: str
    visit: int
    labels: set[tuple[str, ...]]


def _labels(samples: Samples) -> list[tuple[str, ...]]:
    columns = [values.tolist() for values in samples.labels.values()]
    return [tuple(values[row] for values in columns) for row in range(len(samples))]
