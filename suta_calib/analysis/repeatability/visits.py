"""Repeatability: many visits to one point, as ISO 9283 asks for them, taken apart."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import pdist

from suta_calib.analysis.repeatability.directions import DirectionalForce, directional_force
from suta_calib.analysis.repeatability.scatter import (
    CONFIDENCE,
    CYCLES,
    LEAST_VISITS,
    JointScatter,
    OrientationScatter,
    PositionScatter,
    ProtocolComparison,
    compare_protocols,
    departures,
    joint_scatter,
    median_angle,
    tip_levers,
)
from suta_calib.analysis.repeatability.suspicions import Stuck, first_written, misread, stuck
from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rms_length
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.terms.block import grouped
from suta_calib.threads import single_threaded
from suta_calib.trust.repeats import about_mean
from suta_calib.trust.serial_correlation import correlation_length
from suta_calib.units import Unit, from_deg, mm

# Farther from the median than this many times the median distance: another point, or a slip.
ELSEWHERE: Final = 6.0
DIRECTION: Final = "direction"
PROTOCOL: Final = "protocol"


def elsewhere(away: FloatArray) -> tuple[int, ...]:
    """Rows of positions (n, 3) far from where most of them are."""
    size = np.linalg.norm(away - np.median(away, axis=0), axis=1)
    return tuple(int(row) for row in np.flatnonzero(size > ELSEWHERE * np.median(size)))


def places(away: FloatArray) -> tuple[IntArray, ...]:
    """Rows of positions (n, 3) by the place they lie about, where that is not one for all.

    Single linkage: a gap that parts groups of visits, against how far they scatter within.
    """
    # Groups of visits that are as far apart as this many times what they scatter about their own
    # middles, and more where there are few visits: less than one set of visits to one point in
    # 1,000 is so, whether it scatters like a ball, a disc, a ring or a line.
    separation = 3.0
    few = 10
    # The fewest that make a group and no outliers.
    least = max(3, math.ceil(0.1 * len(away)))
    merged = linkage(away, "single")
    size = np.concatenate([np.ones(len(away)), merged[:, 3]])
    gap = merged[:, 2]
    parts = (size[merged[:, :2].astype(int)] >= least).all(axis=1)
    groups_found: tuple[IntArray, ...] = ()
    clearest = separation * (1 + (few / len(away)) ** 2)
    for width in gap[parts & (gap > 0)]:
        label = fcluster(merged, width * (1 - 1e-9), "distance")
        rows = [np.flatnonzero(label == number) for number in np.unique(label)]
        groups = tuple(group for group in rows if len(group) >= least)
        off = np.concatenate([away[group] - away[group].mean(axis=0) for group in groups])
        # Of an encoder that is coarse, all visits of a group may read the same.
        scatter = max(np.sqrt(np.sum(off**2) / (len(off) - len(groups))), gap[gap > 0].min())
        if width > clearest * scatter:
            groups_found, clearest = groups, width / scatter
    return groups_found


def other_posture(columns: Iterable[tuple[str, Unit, FloatArray, float]]) -> tuple[int, ...]:
    """Rows in which some revolute joint is where it is not in most others.

    Columns are name, unit, readings (n,) and lever of every joint.
    """
    # A joint this far from its median (rad) and this many times as far as most: another posture.
    posture = from_deg(5.0)
    unusual = 10.0
    rows_elsewhere: set[int] = set()
    for _, unit, readings, _ in columns:
        if unit == "rad":
            away = np.angle(np.exp(1j * (readings - median_angle(readings))))
            size = np.abs(away - np.median(away))
            limit = max(posture, unusual * float(np.median(size)))
            rows_elsewhere |= {int(row) for row in np.flatnonzero(size > limit)}
    return tuple(sorted(rows_elsewhere))


@dataclass(frozen=True, eq=False)
class Repeatability(Displayable):
    """Visits to one point.

    Attributes:
        samples: the visits, each once.
        copies: rows that were written down again, and are no visits.
        position_of: (n, 3) of the tip at each visit, in the base, m.
        position, orientation: scatter of the tip over all visits.
        joints: scatter of every joint over all visits, in the order of the chain.
        protocols, protocol_joints: scatter of the tip, and of every joint, at the visits of each
            protocol; empty where there is but one.
        comparisons: of the first protocol with each of the others.
        directions: what the direction of the push does; None where there is but one.
        elsewhere: rows so far from the others that they may have visited another point.
        places: rows by the place they visited, where there seem to be several; else empty.
        other_posture: rows in which a joint is far from where it is in the others.
        misread: what would have to be so of the joints' columns for one point; None where they are
            right.
        stuck: joints that must have moved, and read the same.
        within: scatter of the tip about its mean at the visits of each protocol and direction, RMS,
            m.
        correlation: integrated autocorrelation of successive visits; 1 where they are independent.
        confidence: of every interval.
    """

    samples: Samples
    copies: int
    position_of: FloatArray
    position: PositionScatter
    orientation: OrientationScatter
    joints: tuple[JointScatter, ...]
    protocols: Mapping[str, PositionScatter]
    protocol_joints: Mapping[str, tuple[JointScatter, ...]]
    comparisons: tuple[ProtocolComparison, ...]
    directions: DirectionalForce | None
    elsewhere: tuple[int, ...]
    places: tuple[IntArray, ...]
    other_posture: tuple[int, ...]
    misread: str | None
    stuck: tuple[Stuck, ...]
    within: float
    correlation: float
    confidence: float

    @property
    @judged
    def assessment(self) -> Assessment:
        """What the visits say, and what must be known before the figures are used."""
        rp, inside = self.position.rp, self.position.rp.interval(self.confidence)
        sentence = (
            f"RP {mm(rp.value):.3f} mm from {self.position.count} visits "
            f"({100 * self.confidence:g} % interval {mm(inside.low):.3f} to "
            f"{mm(inside.high):.3f} mm)"
        )
        visits, effects = self._of_visits(), self._of_effects()
        if self.misread is not None:
            return Assessment.of(sentence, bad=[self.misread], care=[*visits, *effects])
        # m between two places, or that visits scatter by, RMS, which no play and no bending of an
        # arm explains: they are no visits to one point.
        several_points = 20e-3
        if self._noise_floor > several_points:
            return Assessment.of(sentence, bad=visits, care=effects)
        bad = []
        if self.within > several_points:
            bad.append(
                f"The visits scatter by {mm(self.within):.1f} mm (RMS), too much for an arm that "
                "returns to one point. Check whether these were several points, whether all "
                "columns are in rad (m) and have the right names, and whether the URDF is of "
                "this arm."
            )
        return Assessment.of(sentence, bad=bad, care=[*visits, *effects])

    @property
    def _noise_floor(self) -> float:
        """How far the places lie apart that the visits lie about, m; zero for one."""
        middles = [self.position_of[rows].mean(axis=0) for rows in self.places]
        return float(pdist(middles).max()) if len(middles) > 1 else 0.0

    def _of_visits(self) -> list[str]:
        """Visits that are copies, few, or of something else."""
        notes = []
        q = self.samples.q
        if self.copies:
            notes.append(
                f"{self.copies} of {self.copies + len(q)} rows have the readings of another row, "
                "except for digits finer than any encoder's. They are copies; each visit counts "
                "once."
            )
        # Coarse encoders may all read the same again, but hardly ever twice in a row.
        same = int(np.sum(np.all(q[1:] == q[:-1], axis=1)))
        # Share of visits that read as the one before, from which it is reported.
        if same >= 0.1 * len(q):
            notes.append(
                f"{same} of {len(q)} visits have exactly the readings of the visit before. Check "
                "whether the arm moved, or one reading was written several times."
            )
        parts = self.protocols or {"": self.position}
        few = [
            f"{part.count} visits" + (f" with protocol {name}" if name else "")
            for name, part in parts.items()
            if part.count < CYCLES
        ]
        if few:
            notes.append(
                f"{' and '.join(few)}: ISO 9283 requires {CYCLES}. The intervals are wide."
            )
        if self.places:
            groups = [self.position_of[rows] for rows in self.places]
            middles = [visits.mean(axis=0) for visits in groups]
            sizes = [rms_length(v - m) for v, m in zip(groups, middles, strict=True)]
            notes.append(
                f"The visits form {len(groups)} groups, up to {mm(self._noise_floor):.3f} mm "
                f"apart, of {', '.join(str(len(visits)) for visits in groups)} visits, which "
                f"scatter by {', '.join(f'{mm(size):.3f}' for size in sizes)} mm (RMS) within "
                "their groups. Check whether these were several points, or one point from "
                "several sides. Every figure here is for all groups together: give each group "
                "its own file, or a label protocol or direction."
            )
        elif self.elsewhere:
            notes.append(
                f"Far from the other visits: {self._rows(self.elsewhere)}. Check whether another "
                "point was visited, or the tip slipped. They are included in every figure."
            )
        if self.other_posture:
            notes.append(
                f"In another posture than the others: {self._rows(self.other_posture)}. The "
                "figures for joints and for directions are unreliable with these visits."
            )
        return notes

    def _of_effects(self) -> list[str]:
        """What makes successive visits, or those pushed another way, differ."""
        notes = [joint.sentence for joint in self.stuck]
        if self.correlation > 1.0:
            notes.append(
                f"Successive visits are correlated (they count as {1 / self.correlation:.0%} of "
                "their number): the arm drifts or warms up, and every interval here is too "
                "narrow."
            )
        loosest = None if self.directions is None else self.directions.loosest
        if loosest is not None:
            named = " or ".join([loosest.joint, *loosest.as_well])
            notes.append(
                f"{named} has play or bends: its reading changes with the direction of the push, "
                f"which moves the tip by {mm(loosest.tip):.3f} mm (p = {loosest.p_value:.2g})."
            )
        return notes

    def _rows(self, rows: tuple[int, ...]) -> str:
        named = ", ".join(self.samples.origin[row] for row in rows[:3])
        return f"{named}, …" if len(rows) > 3 else named


@single_threaded
@checked
def repeatability(
    arm: ArmModel, samples: Samples, *, confidence: float = CONFIDENCE, seed: int = 0
) -> Repeatability:
    """Take visits to one point apart.

    Args:
        arm: whose readings these are, as well calibrated as it is.
        samples: the visits in the order they were made; the labels ``direction`` and ``protocol``
            are looked at where they are there.
        confidence: of the intervals, between 0 and 1.
        seed: of the permutations that tell directions from noise.

    Raises:
        SamplesError: fewer than three visits, or fewer with one protocol or direction; copies of a
            row are none.
    """
    units = tuple(arm.units.values())
    once = first_written(samples.q, units)
    samples, copies = samples.take(np.flatnonzero(once)), int(np.sum(~once))
    _check(samples, copies)
    rotation, position = arm.forward(samples.q)
    levers = tip_levers(arm, samples.q).tolist()
    protocol, direction = _several(samples, PROTOCOL), _several(samples, DIRECTION)
    columns = list(zip(arm.joints, units, samples.q.T, levers, strict=True))
    pushed = None
    if direction is not None:
        named = list(zip(arm.joints, units, levers, strict=True))
        away = departures(samples.q, units)
        pushed = directional_force(named, away, position, direction, protocol, seed)
    groups = np.zeros(len(samples), np.intp) if protocol is None else grouped(protocol)[1]
    protocols, by_joint = {}, {}
    within = about_mean(position, groups, np.bincount(groups))
    if protocol is not None:
        for name in grouped(protocol)[0]:
            rows = protocol == name
            protocols[name] = PositionScatter.of(position[rows])
            by_joint[name] = tuple(joint_scatter(n, u, q[rows], by) for n, u, q, by in columns)
    first, *further = protocols or [""]
    # Of the principal axis along which successive visits resemble each other most.
    about = within if pushed is None else pushed.within[:, -3:]
    about = about - about.mean(axis=0)
    several = places(about)
    axes, sizes, _ = np.linalg.svd(about, full_matrices=False)
    axes = axes[:, sizes > 1e-9 * max(float(sizes[0]), 1e-300)]
    correlation = max((correlation_length(axis[:, None]) for axis in axes.T), default=1.0)
    return Repeatability(
        samples,
        copies,
        position,
        PositionScatter.of(position),
        OrientationScatter.of(rotation),
        tuple(joint_scatter(*column) for column in columns),
        protocols,
        by_joint,
        tuple(
            compare_protocols(
                first,
                protocols[first],
                other,
                protocols[other],
                confidence,
                zip(by_joint[first], by_joint[other], strict=True),
            )
            for other in further
        ),
        pushed,
        elsewhere(within),
        several,
        other_posture(columns),
        # From one point to another the joints need not undo each other.
        None if several else misread(arm, samples, position),
        () if several else stuck(arm, samples.q, groups),
        rms_length(about),
        correlation,
        confidence,
    )


def _check(samples: Samples, copies: int) -> None:
    only = f" ({copies} rows are copies of others)" if copies else ""
    if len(samples) < LEAST_VISITS:
        raise SamplesError(
            f"{len(samples)} visits{only}", f"at least {LEAST_VISITS} ({CYCLES} by ISO 9283)",
            where=samples.origin[-1],
        )  # fmt: skip
    for key in (PROTOCOL, DIRECTION):
        labels = _several(samples, key)
        for name in () if labels is None else grouped(labels)[0]:
            rows = np.flatnonzero(labels == name)
            if len(rows) < LEAST_VISITS:
                raise SamplesError(
                    f"{len(rows)} visits with {key} {name!r}{only}",
                    f"at least {LEAST_VISITS} of each {key}",
                    where=samples.origin[rows[0]],
                    hint="visit more often, or correct the label",
                )


def _several(samples: Samples, key: str) -> NDArray[np.str_] | None:
    """A label column with at least two different labels, or None."""
    labels = samples.labels.get(key)
    return None if labels is None or len(set(labels)) < 2 else labels
