"""An artefact that was certified in a left-handed frame."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from suta_calib.errors import SamplesError
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust import Reinterpretation, SpoiltData, Truth

DESCRIPTION = "the artefact is mirrored: its certificate's frame is left-handed"


class MirroredArtefact(Reinterpretation):
    """The x of all landmarks with the other sign."""

    name = "mirrored artefact"
    about = "The artefact was certified in a left-handed frame."
    precedence = 60

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """One, where an artefact is touched."""
        if any(term.touched for term in data.terms):
            yield DESCRIPTION, tuple(map(mirrored, data.terms))

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The artefact mirrored."""
        if data.touched is None:
            raise SamplesError(f"the kind {data.kind}", "a kind that touches an artefact")
        return SpoiltData(mirrored(data), effect=DESCRIPTION)


def mirrored(term: Term) -> Term:
    """The term with its artefact mirrored, where it touches one."""
    if term.touched is None:
        return term
    marks = {
        name: replace(mark, position=mark.position * [-1.0, 1.0, 1.0])
        for name, mark in term.touched.landmarks.items()
    }
    changed: dict[str, Any] = {"artefact": replace(term.touched, landmarks=marks)}
    return replace(term, **changed)
