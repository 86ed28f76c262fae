"""A target that sits elsewhere on the tip's link than at the tip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust.hypothesis import Reinterpretation, SpoiltData
from suta_calib.trust.spoiling import displaced


class UnknownMount(Reinterpretation):
    """Where the target sits on the tip's link is estimated (`Term.on_unknown_mount`)."""

    name: ClassVar[str] = "unknown mount"
    about: ClassVar[str] = "The target sits on the tip's link, but not at the tip."
    precedence: ClassVar[int] = 83
    tried: ClassVar = "fitted"

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """One, where a kind knows such a mount."""
        mounted = [term.on_unknown_mount for term in data.terms]
        descriptions = [other[0] for other in mounted if other is not None]
        if descriptions:
            pairs = zip(mounted, data.terms, strict=True)
            terms = tuple(term if other is None else other[1] for other, term in pairs)
            yield descriptions[0], terms

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """The target 3 cm away from the tip."""
        term: Term = data
        direction = rng.standard_normal(3)
        by = 0.03 * direction / np.linalg.norm(direction)
        rotation, _ = term.poses.at(values)
        twist = np.zeros((len(rotation), 6))
        twist[:, :3] = rotation @ by
        reading = term.on_unknown_mount
        description = "" if reading is None else reading[0]
        return SpoiltData(displaced(term, values, twist), np.zeros(0), description)
