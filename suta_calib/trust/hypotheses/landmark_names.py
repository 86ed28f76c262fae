"""Landmarks of an artefact whose names are exchanged, or counted from another number."""

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations
from typing import Final

from suta_calib.measurements import Samples
from suta_calib.terms import Term
from suta_calib.trust.misreadings import Change, Misreading, renamed

# The label column of what is touched on an artefact.
LANDMARK: Final = "landmark"


class LandmarkNames(Misreading):
    """Two names exchanged, or the numbers of all one too low or too high."""

    name = "landmark names"
    about = "Names of landmarks are exchanged, or the count begins at another number."
    precedence = 40

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """One for each pair, and one for each way of counting."""
        labels = (term.poses.samples.labels.get(LANDMARK, ()) for term in terms)
        names = [*dict.fromkeys(str(name) for column in labels for name in column)]
        # Pairs are exchanged only among so many landmarks: pairs grow with their square.
        if len(names) <= 40:
            for a, b in combinations(names, 2):
                change = partial(renamed, {a: b, b: a}, LANDMARK)
                yield f"landmarks {a} and {b} are exchanged", change
        for description, new in recounted(names):
            yield description, partial(renamed, new, LANDMARK)

    def fault(self, term: Term) -> tuple[str, Samples]:
        """Two landmarks exchanged; which of them is named first is open."""
        _, samples = super().fault(term)
        return "are exchanged", samples


def recounted(names: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """New names where numbers are one off: anew for each stem, or on from one to the next."""
    numbered: dict[str, list[tuple[int, str]]] = {}
    for name in names:
        stem = name.rstrip("0123456789")
        if stem != name:
            numbered.setdefault(stem, []).append((int(name[len(stem) :]), name))
    anew = [[name for _, name in sorted(group)] for group in numbered.values()]
    on = [[name for stem in sorted(numbered) for _, name in sorted(numbered[stem])]]
    for rings, counted in ((anew, ""), (on, ", counted on from one letter to the next")):
        if counted and len(anew) < 2:
            continue
        for which, steps in (("one too low", 1), ("one too high", -1)):
            new = dict[str, str]()
            for ring in rings:
                new |= zip(ring, [*ring[steps:], *ring[:steps]], strict=True)
            if any(before != after for before, after in new.items()):
                yield f"the landmarks' numbers are {which}{counted}", new
