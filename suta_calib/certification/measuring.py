"""Raw points in the ground's frame, checked, and what one touch is worth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import chi2, f

from suta_calib.arrays import FloatArray
from suta_calib.certification.pillar import (
    PillarGeometry,
    diagonals_cross,
    order_around,
    pillar_geometry,
)
from suta_calib.certification.plane import FINEST, Plane, Top, fit_plane, judge_tops, on_a_line
from suta_calib.certification.points import Pillar, RawPoints
from suta_calib.errors import SamplesError
from suta_calib.units import mm

# Share of a diagonal on either side of the crossing below which holes cannot be in order.
LEAST_SHARE: Final = 0.2
# Freedom from which on the touches' own scatter says what a touch is worth.
ENOUGH_FREEDOM: Final = 4
# Chance that a stated noise, or a ground as smooth as the tops, is doubted wrongly.
DOUBT: Final = 0.001


@dataclass(frozen=True, eq=False)
class MeasuredArtefact:
    """Everything before a frame is chosen.

    Attributes:
        ground: the plane; its axes and centre are the ground's frame.
        ground_points: (n, 3) its touches in use, in that frame, m.
        pillars: what was touched, in the file's order.
        tops: each top, judged.
        geometry: each pillar's numbers, in that frame.
    """

    ground: Plane
    ground_points: FloatArray
    pillars: tuple[Pillar, ...]
    tops: tuple[Top, ...]
    geometry: tuple[PillarGeometry, ...]


def measure(raw: RawPoints, sigma: float | None) -> MeasuredArtefact:
    """Fit the ground, judge the tops and work out every pillar.

    Args:
        raw: points as they were read.
        sigma: standard deviation of a touched coordinate, m, if it is stated.

    Raises:
        SamplesError: touches that define no plane or no centre, and which.
    """
    ground = _ground(raw, sigma)

    def local(points: FloatArray) -> FloatArray:
        return np.asarray((points - ground.centre) @ ground.axes.T)

    tops = [local(p.top.position) for p in raw.pillars]
    holes = [local(p.holes.position) for p in raw.pillars]
    for pillar, top, hole in zip(raw.pillars, tops, holes, strict=True):
        _check_pillar(raw, pillar, top, hole)
    judged = judge_tops(tops, sigma, ground.rms)
    geometry = []
    for pillar, points, hole, verdict in zip(raw.pillars, tops, holes, judged, strict=True):
        flats = None
        if pillar.front is not None and pillar.back is not None:
            flats = local(pillar.front), local(pillar.back)
        geometry.append(pillar_geometry(points[verdict.inliers], hole, flats))
    inside = local(raw.ground.position[ground.inliers])
    return MeasuredArtefact(ground, inside, raw.pillars, judged, tuple(geometry))


def _ground(raw: RawPoints, sigma: float | None) -> Plane:
    """The ground, its normal towards the tops."""
    if on_a_line(raw.ground.position, sigma or 0.0):
        raise SamplesError(
            f"{len(raw.ground)} touches of the ground on a line",
            "touches spread over the plane",
            file=raw.path,
            where="ground",
        )
    plane = fit_plane(raw.ground.position, sigma)
    heights = [float(np.mean((p.top.position - plane.centre) @ plane.axes[2])) for p in raw.pillars]
    if np.median(heights) < 0:
        # A half turn about the plane's first axis keeps the frame right-handed.
        plane = Plane(plane.centre, plane.axes * [[1], [-1], [-1]], plane.inliers, -plane.residuals)
    return plane


def _check_pillar(raw: RawPoints, pillar: Pillar, top: FloatArray, holes: FloatArray) -> None:
    where = f"landmark {pillar.name!r}"
    lines = ", ".join(str(line) for line in pillar.holes.lines)
    if not diagonals_cross(holes, LEAST_SHARE):
        order = order_around(holes)
        hint = ""
        if order not in ((0, 1, 2, 3), (0, 3, 2, 1)):
            hint = f"around the pillar they follow as {' '.join(map(str, order))}"
        raise SamplesError(
            f"holes (lines {lines}) whose diagonals 0-2 and 1-3 do not cross each other",
            "four holes 0 1 2 3 in order around the pillar",
            file=raw.path,
            where=where,
            hint=hint or "one of them belongs elsewhere",
        )
    if on_a_line(top * [1, 1, 0], 0.0):
        raise SamplesError(
            f"{len(top)} touches of its top on a line",
            "touches spread over the top",
            file=raw.path,
            line=pillar.top.lines[0],
            where=where,
        )
    apart = float(np.hypot(*(top.mean(axis=0) - holes.mean(axis=0))[:2]))
    around = float(np.linalg.norm(holes - holes.mean(axis=0), axis=1).max())
    if apart > 2.0 * around:
        raise SamplesError(
            f"a top {mm(apart):.1f} mm beside the middle of its holes",
            f"a top within {2e3 * around:.1f} mm of it",
            file=raw.path,
            line=pillar.top.lines[0],
            where=where,
            hint="do both belong to this landmark?",
        )


@dataclass(frozen=True)
class ProbingNoise:
    """What a touch is worth.

    Attributes:
        touch: standard deviation of a coordinate on tops, holes, flats and side, m.
        ground: of one on the ground, which may be rougher, m.
        freedom: degrees of freedom of these; inf where they are stated.
    """

    touch: float
    ground: float
    freedom: float


def noise_of(measured: MeasuredArtefact, stated: float | None, raw: RawPoints) -> ProbingNoise:
    """The stated noise where the residuals bear it out; else theirs.

    Raises:
        SamplesError: nothing is stated, and there are too few touches to learn it from.
    """
    even = [top for top in measured.tops if top.even]
    squared, freedom = sum(t.squared for t in even), sum(t.freedom for t in even)
    ground, own = measured.ground, max(measured.ground.freedom, 0)
    if stated is not None:
        scatter = max(float(np.sqrt(squared / freedom)) if freedom else 0.0, FINEST)
        doubted = freedom > 0 and squared > stated**2 * chi2.isf(DOUBT, freedom)
        touch, known = (scatter, float(freedom)) if doubted else (stated, np.inf)
        rough = own > 0 and own * ground.rms**2 > touch**2 * chi2.isf(DOUBT, own)
        return ProbingNoise(touch, max(ground.rms, touch) if rough else touch, known)
    if freedom + own < ENOUGH_FREEDOM:
        raise SamplesError(
            f"{freedom + own} touches more than planes need, too few to learn their noise from",
            "five touches on each top, or the noise of a touch",
            file=raw.path,
            hint="state it with --sigma-um",
        )
    # A ground rougher than the tops is no worse an instrument.
    alike = (
        freedom == 0
        or own == 0
        or (ground.rms**2 * freedom <= squared * f.isf(DOUBT, own, freedom))
    )
    if alike:
        squared, freedom = squared + own * ground.rms**2, freedom + own
    touch = max(float(np.sqrt(squared / freedom)), FINEST)
    return ProbingNoise(touch, touch if alike else ground.rms, float(freedom))
