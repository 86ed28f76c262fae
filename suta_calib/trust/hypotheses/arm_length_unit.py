"""A length of the arm that is in another unit in the URDF."""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from suta_calib.errors import SutaCalibError
from suta_calib.model.lengths import OtherLength, other_lengths
from suta_calib.solver.problem import Problem
from suta_calib.terms import ArmPoses, Term
from suta_calib.trust import Reinterpretation, Rule, SpoiltData, Truth
from suta_calib.trust.rereading import nominal_cap, nominal_misfit
from suta_calib.trust.simulated_faults import arm_of


class ArmLengthUnit(Reinterpretation):
    """A joint's origin, or one of its coordinates, times 10, 100, 1000, or divided by these."""

    name = "unit of a length"
    about = "The URDF has a length of the arm in another unit."
    precedence = 70

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """As by the default rule."""
        return self.readings_by(data, Rule())

    def readings_by(self, data: Problem, rule: Rule) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """The unit of each length with which the nominal arm agrees far better than with others.

        A length that hardly matters, or had better be none, does as well in the next smaller one.
        """
        units: dict[tuple[str, ...], list[tuple[str, tuple[Term, ...]]]] = {}
        arms = dict.fromkeys(map(arm_of, data.terms))
        lengths = (length for arm in arms for length in other_lengths(arm))
        for length in {length.sentence: length for length in lengths}.values():
            with suppress(SutaCalibError):
                reading = length.sentence, tuple(_with_length(term, length) for term in data.terms)
                units.setdefault(tuple(length.values), []).append(reading)
        cap = nominal_cap(data.terms)
        for readings in units.values():
            scores = [nominal_misfit(terms, cap) for _, terms in readings]
            first, *rest = sorted(range(len(readings)), key=lambda k: scores[k])
            if all(scores[first] * rule.far_better < scores[k] for k in rest):
                yield readings[first]

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The longest coordinate of any origin, ten times as long."""
        lengths = [length for length in other_lengths(arm_of(data)) if len(length.values) == 1]
        longest = max(lengths, key=lambda length: min(map(abs, length.values.values())))
        name = next(iter(longest.values))
        wrong = _with_length(data, next(n for n in lengths if [*n.values] == [name]))
        return SpoiltData(wrong, effect=f"{name} is ")


def _with_length(term: Term, length: OtherLength) -> Term:
    return term.over_poses(ArmPoses(arm_of(term).at(length.values), term.poses.samples))
