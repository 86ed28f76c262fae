"""Observations that are misread as their kind says: pixels counted upwards, a board half-turned."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust.hypothesis import Reinterpretation, SpoiltData


class MisreadObservations(Reinterpretation):
    """What `Term.misread` of a kind yields, in all terms of this kind at once."""

    name: ClassVar[str] = "misread observations"
    about: ClassVar[str] = "Pixels are counted in another way, or pictures are mirrored."
    precedence: ClassVar[int] = 50

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """One for each way that a kind knows."""
        ways: dict[str, dict[int, Term]] = {}
        for k, term in enumerate(data.terms):
            for description, read in term.misread:
                ways.setdefault(description, {})[k] = read
        for description, way in ways.items():
            yield description, tuple(way.get(k, term) for k, term in enumerate(data.terms))

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """The first way, which undoes itself."""
        del values, rng
        term: Term = data
        for description, read in term.misread:
            return SpoiltData(read, np.zeros(0), description)
        raise SamplesError(f"the kind {term.kind}", "one that can be misread")
