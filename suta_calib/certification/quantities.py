"""What is judged of every pillar, as lengths with their standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.certification.comparison import DrawingComparison
from suta_calib.certification.damage import Fault, Quantity
from suta_calib.certification.frame import Sources
from suta_calib.certification.measuring import MeasuredArtefact
from suta_calib.certification.pillar import (
    DIAGONAL_02,
    DIAGONAL_13,
    SLOPE_X,
    SLOPE_Y,
    UNEVEN_X,
    UNEVEN_Y,
    WIDTH,
)
from suta_calib.certification.result import CertifiedLandmark

# An uneven top is one whose touches no plane explains; what a reader is given to compare with.
SIGMAS = 3.0


def judged(
    measured: MeasuredArtefact,
    jacobians: Sequence[FloatArray],
    by: Sources,
    landmarks: Sequence[CertifiedLandmark],
    comparison: DrawingComparison | None,
) -> list[Quantity]:
    """Every quantity of every pillar.

    Args:
        measured: pillars in the ground's frame.
        jacobians: of each pillar by everything touched.
        by: what was touched.
        landmarks: the result, for the uncertainty of places.
        comparison: with a drawing.
    """

    def rows(*which: int) -> tuple[FloatArray, FloatArray]:
        value = np.full((len(jacobians), len(which)), np.nan)
        std = np.ones_like(value)
        for k, (g, j) in enumerate(zip(measured.geometry, jacobians, strict=True)):
            if max(which) < len(g.values):
                value[k] = g.values[list(which)]
                std[k] = np.linalg.norm(j[list(which)] * by.sigma, axis=1)
        return value, std

    radius = np.array([_radius(measured, k) for k in range(len(jacobians))])[:, None]
    slope, slope_std = rows(SLOPE_X, SLOPE_Y)
    found = [
        Quantity("rise of its top", radius * slope, radius * slope_std, True),
        Quantity("middles of its diagonals apart", *rows(UNEVEN_X, UNEVEN_Y), True),
        Quantity("length of a diagonal", *rows(DIAGONAL_02, DIAGONAL_13), False),
        Quantity("distance of its flats", *rows(WIDTH), False),
    ]
    return found if comparison is None else [*found, *_against(comparison, landmarks)]


def _radius(measured: MeasuredArtefact, k: int) -> float:
    """From the middle of a top to its outermost touch, m: over it a lean becomes a length."""
    top = measured.pillars[k].top.position
    return float(np.linalg.norm(top - top.mean(axis=0), axis=1).max())


def _against(
    comparison: DrawingComparison, landmarks: Sequence[CertifiedLandmark]
) -> list[Quantity]:
    std = np.array([mark.shape_std for mark in landmarks])
    # Deviations are in the drawing's axes, which may be turned about z.
    across = np.tile(std[:, :2].max(axis=1)[:, None], 2)
    arm = np.array([(m.flats or np.nan) / 2 for m in landmarks])
    turned = np.array([np.nan if m.yaw_std is None else m.yaw_std for m in landmarks])
    turn = Quantity(
        "turn of its flats",
        (arm * comparison.turn)[:, None],
        np.nan_to_num(arm * turned, nan=1.0)[:, None],
        False,
    )
    return [
        Quantity("place in the plane", comparison.deviation[:, :2], across, True),
        Quantity("height", comparison.deviation[:, 2:], std[:, 2:], True),
        turn,
    ]


def uneven_tops(measured: MeasuredArtefact, noise: float, tolerance: float | None) -> list[Fault]:
    """Tops that are no plane, whichever touch is left out."""
    found = []
    limit = SIGMAS * noise if tolerance is None else tolerance
    for pillar, top in zip(measured.pillars, measured.tops, strict=True):
        size = float(np.abs(top.residuals[top.inliers]).max())
        if not top.even and (tolerance is None or size > limit):
            found.append(Fault(pillar.name, "unevenness of its top", size, limit))
    return found
