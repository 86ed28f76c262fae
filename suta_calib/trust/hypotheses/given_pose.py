"""A given pose of the instrument, the artefact or a point that is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust.hypothesis import Reinterpretation, SpoiltData


class WrongGivenPose(Reinterpretation):
    """One of the given poses is estimated in place of it."""

    name: ClassVar[str] = "given pose"
    about: ClassVar[str] = "Something does not stand where its given pose says."
    precedence: ClassVar[int] = 80
    tried: ClassVar = "fitted"

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """One for each given pose."""
        for k, term in enumerate(data.terms):
            for label in term.given:
                rest = {name: pose for name, pose in term.given.items() if name != label}
                terms = (*data.terms[:k], replace(term, given=rest), *data.terms[k + 1 :])
                yield _description(term, label), terms

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """The first of the given poses 5 cm elsewhere."""
        del values
        term: Term = data
        if not term.given:
            raise SamplesError("no given poses", "a term with some", where=term.kind)
        label, pose = next(iter(term.given.items()))
        direction = rng.standard_normal(3)
        by = 0.05 * direction / np.linalg.norm(direction)
        given = {**term.given, label: replace(pose, position=pose.position + by)}
        return SpoiltData(replace(term, given=given), np.zeros(0), _description(term, label))


def _description(term: Term, label: str) -> str:
    what = f"{term.place} {label}".strip() if term.place else label or f"the {term.medium}"
    return f"{what} is not where its given pose says"
