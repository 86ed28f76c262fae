"""Observations that are misread, such as pixels counted upwards or a board turned by 180°."""

from collections.abc import Iterator

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust import Reinterpretation, SpoiltData, Truth
from suta_calib.trust.simulated_faults import by_chain


class MisreadObservations(Reinterpretation):
    """The data as `Term.misread` of a kind returns them, in all terms of this kind at once."""

    name = "misread observations"
    about = "Pixels are counted in another way than expected, or pictures are mirrored."
    precedence = 50

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """One for each way that a kind knows; of several chains one for each too."""
        ways: dict[str, dict[int, Term]] = {}
        misread = {term: [*term.misread] for term in data.terms}
        for where, suspects in by_chain(data.terms):
            for k, term in enumerate(data.terms):
                for description, read in misread[term] if term in suspects else ():
                    ways.setdefault(description + where, {})[k] = read
        for description, way in ways.items():
            yield description, tuple(way.get(k, term) for k, term in enumerate(data.terms))

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The first way, which undoes itself."""
        for description, read in data.misread:
            return SpoiltData(read, effect=description)
        raise SamplesError(f"the kind {data.kind}", "a kind whose observations can be misread")
