"""Given positions that were surveyed in a left-handed frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust.hypothesis import Reinterpretation, SpoiltData


class MirroredSurvey(Reinterpretation):
    """One coordinate of all given positions with the other sign."""

    name: ClassVar[str] = "mirrored survey"
    about: ClassVar[str] = "Given positions were surveyed in a left-handed frame."
    precedence: ClassVar[int] = 61

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """Three, where positions are given."""
        if any(term.given for term in data.terms):
            for axis, sign in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
                yield _description(axis), tuple(mirrored(term, sign) for term in data.terms)

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """The y of all given positions with the other sign."""
        del values, rng
        term: Term = data
        if not term.given:
            raise SamplesError("no given positions", "a term with some", where=term.kind)
        return SpoiltData(
            mirrored(term, np.array([1.0, -1.0, 1.0])), np.zeros(0), _description("y")
        )


def _description(axis: str) -> str:
    return f"the given positions are mirrored: their {axis} has the wrong sign"


def mirrored(term: Term, sign: FloatArray) -> Term:
    """The term with its given positions times signs (3,)."""
    given = {
        label: replace(pose, position=pose.position * sign) for label, pose in term.given.items()
    }
    return replace(term, given=given)
