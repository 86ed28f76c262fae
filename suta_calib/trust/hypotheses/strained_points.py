"""Points that are stretched along one axis in one set, or skew; a scale cannot describe it.

A distance between slices that is not what a file says stretches all points along one axis. A tilted
gantry makes two axes other than square. An instrument whose axes count differently does either.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Level
from suta_calib.geometry.numbers import rms_length, skew, tangent_of_vector
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
from suta_calib.trust.hypotheses.scaled_points import PointSets, by_scale, one_by_one
from suta_calib.trust.simulated_faults import with_columns
from suta_calib.units import text

# Symmetric matrices without a trace (5, 3, 3), each of length one.
STRAINS: Final = np.array(
    [
        np.diag([1.0, -1.0, 0.0]) / np.sqrt(2.0),
        np.diag([1.0, 1.0, -2.0]) / np.sqrt(6.0),
        *(
            (np.outer(e, d) + np.outer(d, e)) / np.sqrt(2.0)
            for e, d in ((np.eye(3)[i], np.eye(3)[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
        ),
    ]
)


@dataclass(frozen=True, eq=False)
class Strain:
    """How much farther apart points are in the second set than in the first, by direction.

    Attributes:
        sets: the points.
        stretch: (3,) factors along three directions at right angles, the greatest last.
        first: (3, 3) the directions in the first set's frame, one a column.
        second: (3, 3) the same in the second set's.
        change: (n, 3) by which the stretches, beyond a common scale, displace the points, m.
        rms: what is left of the residuals with them, root mean square, 3-D, m.
    """

    sets: PointSets
    stretch: FloatArray
    first: FloatArray
    second: FloatArray
    change: FloatArray
    rms: float

    @property
    def size(self) -> float:
        """Difference between the largest and the smallest factor."""
        return float(self.stretch[-1] - self.stretch[0])


class StrainedPoints(AddedVariable):
    """``seen = (1 + s + E) placed`` with a symmetric E of trace zero: five numbers.

    A common scale s is no part of it: it follows, as the rigid transform does. Points on a plane
    determine two of the five.
    """

    name = "strain between two sets"
    about = "The points of one set are stretched along one axis, or skew."
    applies_to = (TrackedPoint,)
    needs_arm = False
    by_itself = True
    # `PointSets.level` says from which size on it is worth a word; of five numbers each may be
    # small.
    worth = 0.0
    times_std = 0.0
    # Of real fiducials more is wrong than a rule of chance allows for.
    false_alarm = 1e-4

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """The five numbers, along the axes of the second set."""
        sets = PointSets.of(answer)
        # Of axes of the first set, in which the poses are.
        turned = sets.turn.T @ STRAINS @ sets.turn
        placed = answer.position - answer.position.mean(axis=0)
        columns = answer.by_shift(np.einsum("kij,nj->nik", turned, placed))
        yield Effect("strain", columns, about=sets)

    def weigh(self, answer: Examination) -> list[Evidence]:
        """The strain beside a scale that follows."""
        fit = one_by_one(answer)
        columns = np.hstack([fit.jacobian, by_scale(answer)])
        beside = LinearFit(columns, fit.residual, weight=fit.weight)
        weighed = list[Evidence]()
        for evidence in weigh_effects(beside, self.effects(answer)):
            strain = _strain(answer, beside, evidence)
            extent = float(np.abs(strain.sets.placed).max())
            # Displacements, relative to the points' extent, that are no more than their rounding.
            if rms_length(strain.change) > 1e-9 * extent:
                weighed.append(replace(evidence, effect=replace(evidence.effect, about=strain)))
        return weighed

    def level(self, evidence: Evidence) -> Level:
        """Verdict by the remaining residuals."""
        strain: Strain = evidence.effect.about
        return strain.sets.level(strain.size, strain.change, strain.rms)

    def sentence(self, evidence: Evidence) -> str:
        """The largest and the least factor, along axes of the set in which one axis seems wrong."""
        strain = evidence.effect.about
        low, middle, high = strain.stretch
        frames = (("first", strain.first), ("second", strain.second))
        # The other two of a frame with one wrong scale are alike, and might lie anywhere.
        wrong = 2 if high - middle > middle - low else 0
        which, axes = max(frames, key=lambda frame: float(np.abs(frame[1][:, wrong]).max()))

        def along(k: int) -> str:
            # The larger coordinate of a direction is shown as positive.
            axis = axes[:, k] * np.sign(axes[np.abs(axes[:, k]).argmax(), k])
            direction = ", ".join(f"{value + 0.0:.2f}" for value in np.round(axis, 2))
            return f"{strain.stretch[k]:.4f} times along ({direction})"

        return (
            f"The second set is not scaled equally along all directions of the {which} set: "
            f"{along(2)} and {along(0)}. Look for one axis with a wrong scale, such as a wrong "
            "distance between slices, or for axes that are not perpendicular. With these scales "
            f"the rms would be {text(strain.rms, 'm', with_unit=True)}."
        )

    def spoil(self, data: TrackedPoint, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """A second set that is 2 % longer along one axis, and 1 % shorter along the others."""
        samples, axis = data.poses.samples, int(rng.integers(3))
        assert samples.position is not None
        strain = 0.02 * (1.5 * np.diag(np.eye(3)[axis]) - 0.5 * np.eye(3))
        strained = samples.position + samples.position @ strain
        size = np.einsum("kij,ij->k", STRAINS, strain)
        return SpoiltData(with_columns(data, position=strained), size)


def _strain(answer: Examination, beside: LinearFit, evidence: Evidence) -> Strain:
    """The affine transform that the linear fit finds: it is exact, affine transforms are linear."""
    sets: PointSets = evidence.effect.about
    symmetric = np.tensordot(evidence.size, STRAINS, axes=1)
    to_turn = sets.turn @ tangent_of_vector(answer.x[3:6])

    def deformed(moves: FloatArray) -> FloatArray:
        return np.asarray(skew(to_turn @ moves[3:6]) + moves[-1] * np.eye(3))

    change = sets.placed @ (deformed(evidence.moves) + symmetric).T
    together = deformed(beside.step + evidence.moves) + symmetric
    u, stretch, vt = np.linalg.svd(np.eye(3) + together)
    order = np.argsort(stretch)
    left = sets.residual + sets.placed @ together.T
    return Strain(
        sets,
        stretch[order],
        sets.turn.T @ vt.T[:, order],
        u[:, order],
        change,
        float(rms_length(left - left.mean(axis=0))),
    )
