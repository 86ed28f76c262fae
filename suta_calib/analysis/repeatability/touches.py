"""Repeatability from a calibration's own samples: every landmark of a placement, touched again.

Each landmark of each placement is a point with a few visits: too few for figures of its own, so the
scatter about each point's mean is pooled over the points, with the n - 1 of each (ISO 5725-2:2019,
section 7.4). Points count as wholes in the intervals.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter
from typing import Final

import numpy as np

from suta_calib.analysis.repeatability.at_rest import Stationary
from suta_calib.analysis.repeatability.scatter import (
    CONFIDENCE,
    LEAST_VISITS,
    JointSpread,
    ScatterEstimate,
    deviations,
    spread,
    tip_levers,
)
from suta_calib.analysis.repeatability.visits import ELSEWHERE, Repeatability
from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.measurements import Samples
from suta_calib.measurements.samples import joined
from suta_calib.model.arm import ArmModel
from suta_calib.terms import ArmPoses
from suta_calib.terms.block import grouped
from suta_calib.threads import single_threaded
from suta_calib.units import mm
from suta_calib.words import listed

# Labels that together name a point.
POINT: Final = ("placement", "landmark")


@dataclass(frozen=True)
class JointRepeats(JointSpread):
    """The same among repeats of many points.

    Attributes:
        largest: from the smallest to the largest reading at the point where they lie farthest
            apart.
        largest_at: which point that is, such as ``P1/M2``.
    """

    largest: float
    largest_at: str


@dataclass(frozen=True, eq=False)
class RepeatedTouches(Displayable):
    """Repeats of many points.

    Attributes:
        touches: how many touches were repeated; what was read again at one rest counts once.
        points: names of the points they are of.
        rms: root mean square distance in space from the mean of a point's touches, m.
        rms_of_others: the same of the points at which no touch is far from the others; None where
            these are too few.
        joints: in the order of the chain.
        elsewhere: origins of touches far from the others of their points.
        confidence: of every interval.
    """

    touches: int
    points: tuple[str, ...]
    rms: ScatterEstimate
    rms_of_others: ScatterEstimate | None
    joints: tuple[JointRepeats, ...]
    elsewhere: tuple[str, ...]
    confidence: float

    @property
    @judged
    def assessment(self) -> Assessment:
        """What the repeats say, and what must be known before the figures are used."""
        inside = self.rms.interval(self.confidence)
        sentence = (
            f"The tip scatters by {mm(self.rms.value):.3f} mm RMS among {self.touches} touches of "
            f"{len(self.points)} points ({100 * self.confidence:g} % interval "
            f"{mm(inside.low):.3f} to {mm(inside.high):.3f} mm)"
        )
        care = []
        if self.elsewhere:
            of_others = self.rms_of_others
            without = (
                ""
                if of_others is None
                else f"; the other points scatter by {mm(of_others.value):.3f} mm"
            )
            care.append(
                f"Far from the other repeats: {listed(self.elsewhere, 3)}. Check whether the tip "
                "slipped, or another landmark was touched. They are included in every "
                f"figure{without}."
            )
        return Assessment.of(sentence, care=care)


@single_threaded
@checked
def repeated_touches(
    arm: ArmModel, samples: Samples, *, confidence: float = CONFIDENCE
) -> RepeatedTouches:
    """Pool the scatter of all points that were touched more than once.

    Args:
        arm: whose readings these are, as well calibrated as it is.
        samples: with the labels ``placement`` and ``landmark``.
        confidence: of the intervals, between 0 and 1.

    Raises:
        SamplesError: fewer than three points were touched more than once.
    """
    once = samples.take(np.unique(ArmPoses(arm, samples).rests, return_index=True)[1])
    names, point = grouped(joined(once.labels, POINT))
    again = [rows for k in range(len(names)) if len(rows := np.flatnonzero(point == k)) > 1]
    if len(again) < LEAST_VISITS:
        raise SamplesError(
            f"{len(again)} points touched more than once",
            f"at least {LEAST_VISITS}: landmarks touched twice in the same placement",
            where=f"labels {' and '.join(POINT)}",
        )
    labels = tuple(names[point[rows[0]]] for rows in again)
    freedom = np.array([len(rows) - 1.0 for rows in again])
    _, position = arm.forward(once.q)
    away = [position[rows] - position[rows].mean(axis=0) for rows in again]
    size = [
        np.linalg.norm(position[rows] - np.median(position[rows], axis=0), axis=1) for rows in again
    ]
    limit = ELSEWHERE * float(np.median(np.concatenate(size)))
    sound = [k for k, sizes in enumerate(size) if sizes.max() <= limit]
    far = np.concatenate([rows[sizes > limit] for rows, sizes in zip(again, size, strict=True)])
    levers = tip_levers(arm, once.q).tolist()
    joints = []
    for (joint, unit), q, lever in zip(arm.units.items(), once.q.T, levers, strict=True):
        off = [deviations(q[rows], unit)[1] for rows in again]
        std, widths = _pooled(off, freedom), [float(np.ptp(away)) for away in off]
        widest, at = max(zip(widths, labels, strict=True), key=itemgetter(0))
        mean = float(np.mean(widths))
        joints.append(JointRepeats(joint, unit, std, mean, lever * std.value, widest, at))
    return RepeatedTouches(
        sum(map(len, again)),
        labels,
        _pooled(away, freedom),
        _pooled([away[k] for k in sound], freedom[sound]) if len(sound) >= LEAST_VISITS else None,
        tuple(joints),
        tuple(once.origin[row] for row in np.sort(far)),
        confidence,
    )


def _pooled(off: list[FloatArray], freedom: FloatArray) -> ScatterEstimate:
    """Of departures from the mean at each point, (n,) or (n, 3), each point a row."""
    points = np.column_stack([[float(np.sum(departures**2)) for departures in off], freedom])

    def root(drawn_points: FloatArray) -> float:
        squares, free = drawn_points.sum(axis=0)
        return float(np.sqrt(squares / free))

    return spread(root, points)


@dataclass(frozen=True, eq=False)
class RepeatabilityTest(Displayable):
    """Visits to one point, repeats of many, encoders at rest; None for what was not looked at."""

    visits: Repeatability | None = None
    rest: Stationary | None = None
    touches: RepeatedTouches | None = None

    @property
    @judged
    def assessment(self) -> Assessment:
        """The worst of them, with the notes of all."""
        looked_at = (self.visits, self.touches, self.rest)
        given = [judgement.assessment for judgement in looked_at if judgement is not None]
        bad = [note for judgement in given if not judgement.usable for note in judgement.notes]
        care = [note for judgement in given if judgement.usable for note in judgement.notes]
        return Assessment.of("; ".join(item.sentence for item in given), bad=bad, care=care)
