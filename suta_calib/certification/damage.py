"""Pillars that are not as the others are, or not as drawn, beyond what the touches scatter.

What is judged of each landmark, all of it as a length at the pillar: how its top leans, whether the
diagonals of its holes halve each other, their lengths, the distance of its flats and, against a
drawing, its place, its height and its turn.

Without a tolerance the artefact itself says how well it was made: a pillar is damaged that stands
out from the others' scatter. With a tolerance a pillar is damaged that is out of it for certain,
its uncertainty taken into account (ISO 14253-1's rule for proving nonconformity).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.certification.comparison import DrawingComparison
from suta_calib.certification.frame import Sources
from suta_calib.certification.measuring import DIAGONALS, SLOPES, UNEVEN, WIDTH, MeasuredArtefact
from suta_calib.certification.plane import MAD
from suta_calib.certification.result import CertifiedLandmark, Fault
from suta_calib.certification.scatter import FALSE_ALARM, RISK, STANDS_OUT, deviates


@dataclass(frozen=True, eq=False)
class Quantity:
    """One thing judged of every landmark."""

    name: str  # what it is, as a reader is told
    value: FloatArray  # (n, c) lengths, m; NaN where a landmark has none
    std: FloatArray  # (n, c) their standard deviations, m
    nominal: bool  # whether zero is right; otherwise what most landmarks have is


def faults(
    names: Sequence[str], quantities: Sequence[Quantity], freedom: float, tolerance: float | None
) -> tuple[Fault, ...]:
    """What is wrong, landmark by landmark in the order of ``names``.

    ``freedom`` is of the noise (inf where it is stated), ``tolerance`` the largest acceptable
    departure, m, if there is one.
    """
    tests = max(sum(int(np.isfinite(q.value).sum()) for q in quantities), 1)
    chance = FALSE_ALARM / tests / 2 if tolerance is None else RISK
    factor = deviates(chance, freedom)
    every_fault = [fault for q in quantities for fault in _faults_of(names, q, factor, tolerance)]
    return tuple(sorted(every_fault, key=lambda fault: list(names).index(fault.landmark)))


def _faults_of(
    names: Sequence[str], quantity: Quantity, factor: float, tolerance: float | None
) -> list[Fault]:
    # Five pillars say what is usual.
    enough = int(np.isfinite(quantity.value).all(axis=1).sum()) >= 5
    if not (enough or quantity.nominal):
        return []
    usual = spread = np.zeros(quantity.value.shape[1])
    if enough:
        # The median of the landmarks, and their scatter beyond that of the touches.
        usual = np.nanmedian(quantity.value, axis=0)
        scatter = MAD * np.nanmedian(np.abs(quantity.value - usual), axis=0)
        noise = np.nanmedian(quantity.std, axis=0)
        spread = np.sqrt(np.maximum(scatter**2 - noise**2, 0.0))
    # A tolerance is about the drawing; without one, what all pillars share is no pillar's fault.
    if quantity.nominal and tolerance is not None:
        usual = np.zeros_like(usual)
    off = np.abs(quantity.value - usual)
    allowance = STANDS_OUT * spread if tolerance is None else tolerance
    limit = factor * quantity.std + allowance
    faults = []
    for row, name in enumerate(names):
        over = np.nan_to_num(off[row] / limit[row], nan=0.0)
        worst = int(np.argmax(over))
        if over[worst] > 1.0:
            size, most = float(off[row, worst]), float(limit[row, worst])
            faults.append(Fault(name, quantity.name, size, most))
    return faults


def judged(
    measured: MeasuredArtefact,
    jacobians: Sequence[FloatArray],
    by: Sources,
    landmarks: Sequence[CertifiedLandmark],
    comparison: DrawingComparison | None,
) -> list[Quantity]:
    """Every quantity of every pillar; ``jacobians`` are of each by everything touched (``by``)."""

    def rows(which: slice) -> tuple[FloatArray, FloatArray]:
        value = np.full((len(jacobians), which.stop - which.start), np.nan)
        std = np.ones_like(value)
        for k, (g, j) in enumerate(zip(measured.geometry, jacobians, strict=True)):
            if which.stop <= len(g.values):
                value[k] = g.values[which]
                std[k] = np.linalg.norm(j[which] * by.sigma, axis=1)
        return value, std

    # From the middle of a top to its outermost touch: over it a lean becomes a length.
    tops = [pillar.top.position for pillar in measured.pillars]
    radius = np.array([[np.linalg.norm(top - top.mean(axis=0), axis=1).max()] for top in tops])
    slope, slope_std = rows(SLOPES)
    quantities = [
        Quantity("slope of its top", radius * slope, radius * slope_std, True),
        Quantity("distance between the midpoints of its diagonals", *rows(UNEVEN), True),
        Quantity("length of a diagonal", *rows(DIAGONALS), False),
        Quantity("distance between its flats", *rows(slice(WIDTH, WIDTH + 1)), False),
    ]
    if comparison is None:
        return quantities
    std = np.array([mark.shape_std for mark in landmarks])
    # Deviations are in the drawing's axes, which may be turned about z.
    across = np.tile(std[:, :2].max(axis=1)[:, None], 2)
    arm = np.array([(m.flats or np.nan) / 2 for m in landmarks])
    turned = np.array([np.nan if m.yaw_std is None else m.yaw_std for m in landmarks])
    turn, turn_std = arm * comparison.turn, np.nan_to_num(arm * turned, nan=1.0)
    return [
        *quantities,
        Quantity("position in the plane", comparison.deviation[:, :2], across, True),
        Quantity("height", comparison.deviation[:, 2:], std[:, 2:], True),
        Quantity("rotation of its flats", turn[:, None], turn_std[:, None], False),
    ]


def uneven_tops(measured: MeasuredArtefact, noise: float, tolerance: float | None) -> list[Fault]:
    """Tops that are no plane, whichever touch is left out."""
    faults = []
    # An uneven top is one whose touches no plane explains; what a reader is given to compare with.
    limit = 3.0 * noise if tolerance is None else tolerance
    for pillar, top in zip(measured.pillars, measured.tops, strict=True):
        size = float(np.abs(top.residuals[top.inliers]).max())
        if not top.even and (tolerance is None or size > limit):
            faults.append(Fault(pillar.name, "unevenness of its top", size, limit))
    return faults
