"""An instrument, an artefact or a point that was moved between two parts of the rows."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.measurements import Samples
from suta_calib.measurements.samples import joined
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.terms.instrument_terms import InstrumentTerm
from suta_calib.trust import Reinterpretation, SpoiltData, Truth
from suta_calib.trust.simulated_faults import by_chain, displaced, with_columns

WHAT: Final = "the instrument, the artefact or the touched point"
HALVES: Final = f"{WHAT} was moved after the first half of the rows"
# Name of the part (n,) that each row is in, of samples, by what they are of.
Parts = Callable[[Samples, NDArray[np.str_] | None], NDArray[np.str_]]


class MovedBetween(Reinterpretation):
    """External things are at another place in the second half of their rows, or in each file."""

    name = "moved between"
    about = "The instrument, the artefact or a point was moved after half of the rows."
    precedence = 90
    # It leaves more open than any other reading.
    tried = "last"

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """Between the halves, of one chain too, and between the files."""
        by_file = f"{WHAT} was moved between the files"
        every = data.terms
        ways: list[tuple[str, Parts, Sequence[Term]]] = [
            *((HALVES + where, _half, terms) for where, terms in by_chain(every)),
            (by_file, lambda samples, _: samples.file_names, every),
        ]
        for description, parts, divided in ways:
            terms = [
                part
                for term in every
                for part in (_divided(term, parts) if term in divided else (term,))
            ]
            if any(term not in data.terms for term in terms):
                yield description, tuple(terms)

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """All that is seen in the second half is 5 cm elsewhere."""
        twist = np.zeros((len(data.poses), 6))
        twist[len(twist) // 2 :, 0] = 0.05
        return SpoiltData(displaced(data, values, twist), effect=HALVES)


def _divided(term: Term, parts: Parts) -> Iterator[Term]:
    """The term with a place of its own for each part; a term for each part without places."""
    samples = term.poses.samples
    part = parts(samples, samples.labels.get(term.place))
    if term.place in samples.labels and term.own_parameters:
        label = joined({"": samples.labels[term.place], "part": part}, ("", "part"))
        labels = {**samples.labels, term.place: label}
        yield with_columns(term, labels=labels)
    elif isinstance(term, InstrumentTerm):
        for name in np.unique(part):
            rows = np.flatnonzero(part == name)
            yield replace(term.take(rows), label=f"{term.label} {name}")
    else:
        yield term


def _half(samples: Samples, place: NDArray[np.str_] | None) -> NDArray[np.str_]:
    """Which half of the rows each row is in, of those at one place where there are places."""
    later, rows = np.zeros(len(samples), dtype=bool), np.arange(len(samples))
    groups = [rows] if place is None else [rows[place == name] for name in np.unique(place)]
    for group in groups:
        later[group[len(group) // 2 :]] = True
    return np.where(later, "second half", "first half")
