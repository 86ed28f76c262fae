"""Choosing the artefact's frame, and putting the pillars into it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.certification.comparison import QUARTER, quarter_turns
from suta_calib.certification.frame import Placed, Sources, heading_jacobian, placed, sources
from suta_calib.certification.heading import Heading, side_heading
from suta_calib.certification.measuring import MeasuredArtefact, ProbingNoise
from suta_calib.certification.options import CertificationOptions
from suta_calib.certification.points import RawPoints
from suta_calib.errors import ArtefactError, SamplesError, did_you_mean
from suta_calib.measurements import Artefact

ORIGIN: Final = "O"


def origin_of(names: Sequence[str], options: CertificationOptions) -> int:
    """Which landmark has x = y = 0: the one asked for, ``O``, or the first.

    Raises:
        ArtefactError: the one asked for was not touched.
    """
    wanted = options.origin or (ORIGIN if ORIGIN in names else names[0])
    if wanted not in names:
        raise ArtefactError(
            f"no touched landmark {wanted!r}",
            f"one of {', '.join(names)}",
            where="origin",
            hint=did_you_mean(wanted, names),
        )
    return names.index(wanted)


def heading_of(raw: RawPoints, measured: MeasuredArtefact, noise: float) -> Heading | None:
    """The side's direction in the ground's frame; None where no side was touched.

    Raises:
        SamplesError: the side's touches lie together.
    """
    if raw.side is None:
        return None
    ground = measured.ground
    side = (raw.side.position - ground.centre) @ ground.axes.T
    if np.ptp(side[:, :2], axis=0).max() < max(1e-3, 100 * noise):
        raise SamplesError(
            "touches of the side within a millimetre of each other",
            "touches along the side, as far apart as it allows",
            file=raw.path,
            line=raw.side.lines[0],
            where="side",
        )
    middle = np.mean([g.values[:2] for g in measured.geometry], axis=0)
    return side_heading(side, middle, noise)


def sources_of(measured: MeasuredArtefact, heading: Heading | None, noise: ProbingNoise) -> Sources:
    """What was touched and is used, with the noise of every coordinate."""
    side = 0 if heading is None else int(heading.inliers.sum())
    sigmas = []
    for pillar, top in zip(measured.pillars, measured.tops, strict=True):
        each = [1.0] * (int(top.inliers.sum()) + len(pillar.holes))
        if pillar.front is not None:
            each += [count**-0.5 for count in pillar.flat_counts]
        sigmas.append(noise.touch * np.repeat(each, 3))
    ground = measured.ground, measured.ground_points
    return sources(*ground, sigmas, side, noise.ground, noise.touch)


def placed_in_frame(
    measured: MeasuredArtefact,
    jacobians: Sequence[FloatArray],
    heading: Heading | None,
    by: Sources,
    origin: int,
    options: CertificationOptions,
) -> tuple[Placed, int, FloatArray]:
    """Landmarks in the artefact's frame, quarter turns taken, derivative of the heading (c,)."""
    names = [pillar.name for pillar in measured.pillars]
    if heading is not None:
        angle, angle_by, turned = heading.angle, heading_jacobian(heading, by), 0
        where = placed(measured.geometry, jacobians, origin, angle, angle_by)
        if options.drawing is not None:
            turned = quarter_turns(names, where.position, options.drawing)
            angle -= turned * QUARTER
            where = placed(measured.geometry, jacobians, origin, angle, angle_by)
        return where, turned, angle_by
    angle, angle_by = _towards_farthest(measured, jacobians, origin, options.drawing)
    return placed(measured.geometry, jacobians, origin, angle, angle_by), 0, angle_by


def _towards_farthest(
    measured: MeasuredArtefact,
    jacobians: Sequence[FloatArray],
    origin: int,
    drawing: Artefact | None,
) -> tuple[float, FloatArray]:
    """Without a side: x from the origin to the landmark farthest from it, or as it is drawn."""
    centres = np.array([g.values[:2] for g in measured.geometry])
    away = centres - centres[origin]
    names = [pillar.name for pillar in measured.pillars]
    known = [k for k, n in enumerate(names) if drawing is None or n in drawing.landmarks]
    far = max(known, key=lambda k: float(away[k] @ away[k]), default=origin)
    if not away[far].any():
        return 0.0, np.zeros(jacobians[0].shape[1])
    angle = float(np.arctan2(away[far, 1], away[far, 0]))
    by = jacobians[far][:2] - jacobians[origin][:2]
    angle_by = np.array([-away[far, 1], away[far, 0]]) @ by / (away[far] @ away[far])
    if drawing is not None and names[origin] in drawing.landmarks:
        drawn = np.diff(drawing.position_of([names[origin], names[far]]), axis=0)[0]
        angle -= float(np.arctan2(drawn[1], drawn[0]))
    return angle, angle_by
