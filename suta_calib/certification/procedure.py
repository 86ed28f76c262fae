"""The five steps of a certification: ground, tops, holes, flats, side; then spacers and a verdict.

Order and features follow the procedure of the SUTA's calibration artefact: a plane through the
ground gives z; five touches on each top its height; the diagonals of four reference holes its
centre; the flats its turn; the side plane the direction of x.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.assessment import attempt, judge
from suta_calib.certification.comparison import OverGround, compare, over_ground
from suta_calib.certification.damage import faults, judged, uneven_tops
from suta_calib.certification.frame import (
    Heading,
    Placed,
    Sources,
    heading_of,
    origin_of,
    placed_in_frame,
    shape_covariance,
    sources_of,
)
from suta_calib.certification.measuring import (
    DIAGONALS,
    SLOPES,
    UNEVEN,
    WIDTH,
    MeasuredArtefact,
    measure,
)
from suta_calib.certification.noise import noise_of
from suta_calib.certification.plane import Plane
from suta_calib.certification.points import PLAIN, CertificationOptions, ProbedPoints, RawPoints
from suta_calib.certification.result import (
    Certification,
    CertifiedLandmark,
    Fault,
    PlaneQuality,
    SpacerLength,
)
from suta_calib.errors import SamplesError, did_you_mean
from suta_calib.geometry.numbers import wrap


@checked
def certify(raw: RawPoints, options: CertificationOptions = PLAIN) -> Certification:
    """Landmarks with their uncertainty from raw points.

    First-order propagation from every touch in use through planes, crossings and the frame; the
    noise is the one stated, or pooled from the residuals of the tops' and the ground's planes;
    holes and side have one of their own where their touches scatter more.

    Raises:
        SamplesError: touches that define no plane or centre, and which; too few to learn their
            noise from.
        ArtefactError: no such origin, or a drawing of other landmarks.
    """
    names = [pillar.name for pillar in raw.pillars]
    origin = origin_of(names, options)
    measured = measure(raw, options.sigma)
    noise = noise_of(measured, options.sigma, raw)
    heading = heading_of(raw, measured, noise.touch)
    if heading is not None:
        noise = noise.beside("side", heading.scatter)
    by = sources_of(measured, heading, noise)
    jacobians = by.jacobians(measured.geometry)
    where = placed_in_frame(measured, jacobians, heading, by, origin, options.drawing)
    yaw = wrap(where.yaw - options.front)
    drawing = options.drawing
    comparison = None if drawing is None else compare(names, where.position, yaw, drawing)
    landmarks, covariance = _landmarks(measured, jacobians, where, yaw, by, options)
    side = None
    if raw.side is not None and heading is not None:
        side = _quality(raw.side, heading, by.std(by.heading_jacobian(heading)))
    ground_tilt = max(by.std(row) for row in by.ground[:2])
    failed = list[str]()

    def heights() -> OverGround | None:
        touched = where.position, where.by[:, 2] * by.sigma, by.touched_ground
        by_noise = noise.freedom, options.tolerance
        return None if comparison is None else over_ground(names, *touched, comparison, *by_noise)

    def damages() -> Iterator[Fault]:
        quantities = judged(measured, jacobians, by, landmarks, comparison)
        yield from faults(names, quantities, noise.freedom_of("hole"), options.tolerance)

    tops = judge("tops", lambda: uneven_tops(measured, noise.touch, options.tolerance), failed)
    return Certification(
        path=raw.path,
        name=options.name or raw.path.stem,
        points=raw.count,
        landmarks=landmarks,
        covariance=covariance,
        origin=names[origin],
        heading="side plane" if heading else "farthest landmark",
        turned=where.turned,
        heading_std=by.std(where.heading_by),
        ground=_quality(raw.ground, measured.ground, ground_tilt),
        side=side,
        probing=noise,
        stated_noise=options.sigma,
        spacers=_spacers(raw, options, noise.touch),
        faults=(*tops, *judge("damage", damages, failed)),
        comparison=comparison,
        over_ground=attempt("judged: heights over the ground", heights, None, failed),
        tolerance=options.tolerance,
        unjudged=tuple(failed),
    )


def _landmarks(
    measured: MeasuredArtefact,
    jacobians: Sequence[FloatArray],
    where: Placed,
    yaw: FloatArray,
    by: Sources,
    options: CertificationOptions,
) -> tuple[tuple[CertifiedLandmark, ...], FloatArray]:
    n = len(measured.pillars)
    rows = where.by.reshape(3 * n, -1) * by.sigma
    covariance = rows @ rows.T
    std = np.sqrt(np.diag(covariance)).reshape(n, 3)
    shape = np.sqrt(np.diag(shape_covariance(where.position, covariance)).clip(0)).reshape(n, 3)
    landmarks = []
    for k, (pillar, top, geometry) in enumerate(
        zip(measured.pillars, measured.tops, measured.geometry, strict=True)
    ):
        g, has = geometry.values, bool(np.isfinite(yaw[k]))
        landmarks.append(
            CertifiedLandmark(
                name=pillar.name,
                position=where.position[k],
                std=std[k],
                shape_std=shape[k],
                yaw=float(yaw[k]) if has else None,
                yaw_std=by.std(where.yaw_by[k]) if has else None,
                tilt=float(np.arctan(np.hypot(*g[SLOPES]))),
                tilt_std=max(by.std(row) for row in jacobians[k][SLOPES]),
                flatness=float(np.abs(top.residuals[top.inliers]).max()),
                symmetry=float(np.hypot(*g[UNEVEN])),
                diagonals=g[DIAGONALS],
                flats=float(g[WIDTH]) - 2 * options.probe_radius if has else None,
                touches=int(top.inliers.sum()),
                wrong_touches=pillar.top.lines_without(top.inliers),
            )
        )
    return tuple(landmarks), covariance


def _quality(touches: ProbedPoints, plane: Plane | Heading, tilt_std: float) -> PlaneQuality:
    used = plane.residuals[plane.inliers]
    wrong = touches.lines_without(plane.inliers)
    return PlaneQuality(len(used), plane.scatter.sigma, float(np.ptp(used)), tilt_std, wrong)


def _spacers(
    raw: RawPoints, options: CertificationOptions, noise: float
) -> tuple[SpacerLength, ...]:
    for name in options.spacers:
        if name not in raw.spacers:
            touched = f"one of {', '.join(raw.spacers)}"
            raise SamplesError(
                f"no touches of spacer {name!r}",
                touched if raw.spacers else "touches of the feature 'spacer'",
                file=raw.path,
                hint=did_you_mean(name, raw.spacers),
            )
    spacers = []
    for name, ends in raw.spacers.items():
        # The ball's centre stays a radius off either end.
        length = float(np.linalg.norm(np.diff(ends, axis=0))) - 2 * options.probe_radius
        spacers.append(SpacerLength(name, length, noise * 2**0.5, options.spacers.get(name)))
    return tuple(spacers)
