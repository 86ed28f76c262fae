"""Whether a landmark is where the artefact says: what tells a mis-seated plug at once.

The arm is not yet calibrated, so a few millimetres are nothing to worry about; what stands out
among the distances of the same placement is, and so is what was elsewhere when it was touched
before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement
from typing import Final

import numpy as np
from scipy.spatial.distance import pdist

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import register_points, rms_length, wrap
from suta_calib.measurements import Artefact
from suta_calib.model.arm import ArmModel
from suta_calib.units import mm

# From here on a landmark is another one rather than badly measured, m, where the other name fits so
# many times better.
ANOTHER: Final = 15e-3
BETTER: Final = 3.0
# As many landmarks can be told from others.
CERTAIN: Final = 4


class SeatingCheck:
    """The landmarks measured so far at one placement, through the job's own URDF.

    Attributes:
        tips: (3,) position of the tip on each landmark measured, base frame, m.
    """

    def __init__(self, arm: ArmModel, artefact: Artefact) -> None:
        self._arm, self._artefact = arm, artefact
        self.tips: dict[str, FloatArray] = {}

    def tip(self, angles: FloatArray) -> FloatArray:
        """(3,) where the tip is for these readings, m."""
        return self._arm.forward(angles)[1]

    def put(self, landmark: str, angles: FloatArray) -> None:
        """Remember that the landmark was measured here."""
        self.tips[landmark] = self.tip(angles)

    def distances(self, landmark: str, angles: FloatArray) -> dict[str, float]:
        """Distances to every other landmark measured: how much longer than certified, m."""
        tip = self.tip(angles)
        return {
            other: self._error(landmark, tip, other) for other in self.tips if other != landmark
        }

    def _error(self, landmark: str, tip: FloatArray, other: str) -> float:
        certified = self._artefact.position_of([landmark, other])
        measured = np.linalg.norm(tip - self.tips[other])
        return float(measured - np.linalg.norm(certified[0] - certified[1]))

    def suspicious(self, landmark: str, angles: FloatArray) -> bool:
        """Whether these distances, or the place, stand out from those of the others."""
        errors = self.distances(landmark, angles)
        if not errors:
            return False
        # What is off across a plane of landmarks hardly shows in distances.
        if len(errors) >= CERTAIN:
            rest = list(errors)
            scatter = self.disagreement(rest, [self.tips[name] for name in rest])
            if self.misfit(landmark, angles) > max(ANOTHER, 4.0 * scatter):
                return True
        usual = [abs(self._error(a, self.tips[a], b)) for a, b in combinations(errors, 2)]
        # An arm before its calibration may be off by 10 mm without anything being wrong, and among
        # four landmarks never by 30 mm, however bad the other distances are.
        limit = max(10e-3, 4.0 * float(np.median(usual)) if usual else 0.0)
        if len(errors) >= 4:
            limit = min(limit, 30e-3)
        return float(np.median(np.abs(list(errors.values())))) > limit

    def misplaced(self, readings: Mapping[str, FloatArray]) -> list[str]:
        """Those of the landmarks measured that stand out, the worst first, by their readings."""
        others, found = SeatingCheck(self._arm, self._artefact), list[str]()
        others.tips = dict(self.tips)
        while len(others.tips) > CERTAIN:
            suspects = [name for name in others.tips if others.suspicious(name, readings[name])]
            if not suspects:
                break
            found.append(max(suspects, key=lambda name: others.misfit(name, readings[name])))
            del others.tips[found[-1]]
        return found

    def same_place(self, angles: FloatArray, other: FloatArray) -> bool:
        """Whether two readings can only belong to one landmark."""
        positions = np.array([mark.position for mark in self._artefact.landmarks.values()])
        if len(positions) < 2:
            return False
        distance = np.linalg.norm(self.tip(angles) - self.tip(other))
        return bool(distance < 0.25 * pdist(positions).min())

    def misfit(self, landmark: str, angles: FloatArray) -> float:
        """How badly a landmark of this name would fit here, m; zero while nothing can be said."""
        placed = self.placed(without=landmark)
        if placed is not None:
            predicted = placed[list(self._artefact.landmarks).index(landmark)]
            return float(np.linalg.norm(self.tip(angles) - predicted))
        errors = list(self.distances(landmark, angles).values())
        return float(np.sqrt(np.mean(np.square(errors)))) if errors else 0.0

    def placed(self, without: str = "") -> FloatArray | None:
        """(landmarks, 3) where the artefact's landmarks are by those measured, base frame, m.

        None while fewer than three that are not on a line are measured, one not counted.
        """
        measured = [name for name in self.tips if name != without]
        if len(measured) < 3:
            return None
        source = self._artefact.position_of(measured)
        extent = np.linalg.svd(source - source.mean(axis=0), compute_uv=False)
        if extent[1] <= 0.1 * extent[0]:  # on a line
            return None
        R, p = register_points(source, np.array([self.tips[name] for name in measured]))
        return np.asarray(self._artefact.position_of(list(self._artefact.landmarks)) @ R.T + p)

    def disagreement(self, names: Sequence[str], tips: Sequence[FloatArray]) -> float:
        """RMS distance of tips from landmarks of these names, laid over each other, m."""
        source, target = self._artefact.position_of(list(names)), np.array(tips)
        R, p = register_points(source, target)
        return rms_length(source @ R.T + p - target)

    def which(self, expected: str, candidates: Iterable[str], angles: FloatArray) -> str:
        """The landmark the arm rests on: a candidate only where the expected one is impossible."""
        misfits: Mapping[str, float] = {name: self.misfit(name, angles) for name in candidates}
        if not misfits or self.misfit(expected, angles) < ANOTHER:
            return expected
        best = min(misfits, key=lambda name: misfits[name])
        return best if BETTER * misfits[best] < self.misfit(expected, angles) else expected


@dataclass(frozen=True, eq=False)
class Visit:
    """A touch of the same place before: ``repeat 1``, and the readings (n,), rad."""

    name: str
    angles: FloatArray


def disagreement_with(arm: ArmModel, angles: FloatArray, visits: Iterable[Visit]) -> str:
    """What an earlier touch of the same place says against this one; empty where all agree."""
    # A plug that is seated by hand comes back to 0.1 mm. An arm before its calibration is off, by
    # another way the more it has turned: a hobby arm's servos, 3° off at 0.35 m, by so much for
    # each radian.
    seated, turned = 1e-3, 20e-3
    worst, said = 0.0, ""
    for visit in visits:
        here, there = (arm.forward(q)[1] for q in (angles, visit.angles))
        apart = float(np.linalg.norm(here - there))
        allowed = seated + turned * float(np.max(np.abs(wrap(angles - visit.angles))))
        if apart > max(allowed, worst):
            worst = apart
            said = (
                f"the tip is {mm(apart):.1f} mm from where it was in {visit.name}: seat it again, "
                "or see whether what it touches has moved"
            )
    return said


def likelier(
    seating: SeatingCheck, names: Sequence[str], taken: Sequence[int], tips: Sequence[FloatArray]
) -> tuple[int, ...] | None:
    """Places in the sequence that samples belong to rather than to those they were taken for.

    Landmarks are touched in the order of ``names``, and at most three are missed. The places that
    were ``taken`` for the tips (3,), m, stand unless they are impossible and others fit far better:
    then, or where nothing can be said, the answer is None.
    """
    count = len(tips)
    if count < CERTAIN:
        return None

    def misfit(places: Sequence[int]) -> float:
        """How badly the samples are those landmarks, m."""
        return seating.disagreement([names[k] for k in places], tips)

    now = misfit(taken)
    if now <= ANOTHER:
        return None
    most_missed = min(3, len(names) - count)
    # Only the first few missed.
    later = min((tuple(range(k, k + count)) for k in range(most_missed + 1)), key=misfit)
    if BETTER * misfit(later) < now:
        return later
    # Among so many some fit by chance: they must fit as an arm does that needs no calibration yet.
    all_missed = combinations_with_replacement(range(most_missed + 1), count)
    best = min((tuple((np.arange(count) + k).tolist()) for k in all_missed), key=misfit)
    return best if BETTER * misfit(best) < now and misfit(best) < ANOTHER else None
