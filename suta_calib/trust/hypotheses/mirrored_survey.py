"""Given positions that were surveyed in a left-handed frame."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust import Reinterpretation, SpoiltData, Truth


class MirroredSurvey(Reinterpretation):
    """One coordinate of all given positions with the other sign."""

    name = "mirrored survey"
    about = "Given positions were surveyed in a left-handed frame."
    precedence = 61

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """Three, where positions are given."""
        if any(term.given for term in data.terms):
            for axis, sign in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
                yield _description(axis), tuple(mirrored(term, sign) for term in data.terms)

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The y of all given positions with the other sign."""
        if not data.given:
            raise SamplesError("no given positions", "a term with given positions", where=data.kind)
        return SpoiltData(mirrored(data, np.array([1.0, -1.0, 1.0])), effect=_description("y"))


def _description(axis: str) -> str:
    return f"the given positions are mirrored: their {axis} has the wrong sign"


def mirrored(term: Term, sign: FloatArray) -> Term:
    """The term with its given positions times signs (3,)."""
    given = {
        label: replace(pose, position=pose.position * sign) for label, pose in term.given.items()
    }
    return replace(term, given=given)
