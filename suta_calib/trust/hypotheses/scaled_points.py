"""Points of one set that are all farther apart than the same ones of the other: a scale."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Level
from suta_calib.geometry.numbers import rms_length
from suta_calib.terms.external_frame import pose_named
from suta_calib.terms.tracked_point import TrackedPoint
from suta_calib.trust import (
    AddedVariable,
    Effect,
    Evidence,
    Examination,
    LinearFit,
    SpoiltData,
    Truth,
    weigh_effects,
)
from suta_calib.trust.simulated_faults import with_columns
from suta_calib.units import text


@dataclass(frozen=True, eq=False)
class PointSets:
    """Two sets of points, the first laid over the second.

    Attributes:
        placed: (n, 3) points of the first set in the axes of the second, about their middle, m.
        residual: (n, 3) of them, placed less seen, m.
        turn: (3, 3) from the axes of the first set to those of the second.
    """

    placed: FloatArray
    residual: FloatArray
    turn: FloatArray

    @classmethod
    def of(cls, answer: Examination) -> PointSets:
        """Those that were fitted."""
        (term,) = answer.problem.terms
        turn, shift = pose_named(answer.solution.values, TrackedPoint.frames[0].owner)
        assert term.poses.samples.position is not None
        placed = answer.position @ turn.T + shift
        residual = placed - term.poses.samples.position
        about_middle = placed - placed.mean(axis=0)
        return cls(answer.length * about_middle, answer.length * residual, turn)

    def left(self, change: FloatArray) -> float:
        """RMS that is left when the placed points are displaced by ``change`` (n, 3) too, m."""
        return float(rms_length(self.residual + change))

    def level(self, size: float, change: FloatArray, left: float) -> Level:
        """Verdict on a significant deformation: ``good`` if it is too small to be reported.

        ``bad`` where it explains most of the residuals and is more than temperature makes. Its size
        is a ratio; it displaces the points by ``change`` (n, 3) and leaves an RMS, m.
        """
        dominates = left < rms_length(self.residual) / 2
        # What a deformation displaces the points by, in units of their scatter, to be worth a word
        # however many points tell it.
        if rms_length(change) < 0.3 * left and not dominates:
            return "good"
        # Difference in scale that no temperature makes.
        return "bad" if dominates and size > 0.005 else "care"


def one_by_one(answer: Examination) -> LinearFit:
    """The fit of points that are measured one by one.

    Of five of them a variance by clusters would tell nothing.
    """
    return replace(answer.fit, clusters=None, rows_per_independent_row=1.0)


def by_scale(answer: Examination) -> FloatArray:
    """(m, 1) columns of a scale about the middle of the placed points."""
    return answer.by_shift((answer.position - answer.position.mean(axis=0))[:, :, None])


class ScaledPoints(AddedVariable):
    """``seen = (1 + s) placed`` about the middle of the placed points."""

    name = "scale between two sets"
    about = "The points of one set are farther apart than those of the other."
    applies_to = (TrackedPoint,)
    needs_arm = False
    by_itself = True
    # One number. `PointSets.level` has the size from which it is reported.
    worth = 0.0
    times_std = 0.0
    # Of six points with 0.3 mm of noise, 80 mm from their middle, 1 % is found in six of ten sets;
    # in the others ± of targets allows for it.
    false_alarm = 3e-4

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One number: the scale less one."""
        yield Effect("scale", by_scale(answer), about=PointSets.of(answer))

    def weigh(self, answer: Examination) -> list[Evidence]:
        """The scale, by points that are measured one by one."""
        return weigh_effects(one_by_one(answer), self.effects(answer))

    def level(self, evidence: Evidence) -> Level:
        """Verdict by the remaining residuals."""
        sets: PointSets = evidence.effect.about
        size = float(evidence.size[0])
        change = size * sets.placed
        return sets.level(abs(size), change, sets.left(change))

    def sentence(self, evidence: Evidence) -> str:
        """The factor and its standard deviation."""
        size, std = float(evidence.size[0]), float(evidence.std[0])
        sets = evidence.effect.about
        return (
            f"The points are {1.0 + size:.6g} ± {std:.1g} times as far apart in the second set as "
            "in the first. Check the unit and the scale of both sets. With this factor the rms "
            f"would be {text(sets.left(size * sets.placed), 'm', with_unit=True)}."
        )

    def spoil(self, data: TrackedPoint, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """A second set that is 1 % larger or smaller."""
        samples, size = data.poses.samples, float(rng.choice([-0.01, 0.01]))
        assert samples.position is not None
        larger = with_columns(data, position=(1.0 + size) * samples.position)
        return SpoiltData(larger, np.array([size]))
