"""A given pose of the instrument, the artefact or a point that is wrong."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust import Reinterpretation, SpoiltData, Truth
from suta_calib.trust.simulated_faults import random_shift


class WrongGivenPose(Reinterpretation):
    """One of the given poses is estimated in place of it."""

    name = "given pose"
    about = "An object is not where its given pose states."
    precedence = 80
    tried = "fitted"

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """One for each given pose."""
        for k, term in enumerate(data.terms):
            for label in term.given:
                rest = {name: pose for name, pose in term.given.items() if name != label}
                terms = (*data.terms[:k], replace(term, given=rest), *data.terms[k + 1 :])
                yield _description(term, label), terms

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The first of the given poses 5 cm elsewhere."""
        if not data.given:
            raise SamplesError("no given poses", "a term with given poses", where=data.kind)
        label, pose = next(iter(data.given.items()))
        position = pose.position + random_shift(rng, 0.05)
        given = {**data.given, label: replace(pose, position=position)}
        return SpoiltData(replace(data, given=given), effect=_description(data, label))


def _description(term: Term, label: str) -> str:
    what = f"{term.place} {label}".strip() if term.place else label or f"the {term.medium}"
    return f"{what} is not where its given pose states"
