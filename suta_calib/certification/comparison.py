"""The certified landmarks against a drawing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import ArtefactError, SamplesError, did_you_mean
from suta_calib.geometry.numbers import register_points, rpy_from_rotation, wrap
from suta_calib.measurements import Artefact
from suta_calib.pose_calibration.registration import Registration, register

QUARTER: Final = np.pi / 2


@dataclass(frozen=True, eq=False)
class DrawingComparison:
    """Best superposition of the certified landmarks onto the drawing."""

    drawing: Artefact  # what they are compared with
    registration: Registration  # ``T_drawing_artefact``, from the landmarks in both, robustly
    # (n, 3) certified less drawn, in the drawing's axes, m; NaN for landmarks that the drawing
    # lacks.
    deviation: FloatArray
    # (n,) the same of the seated tip's turn about z, rad; NaN where either has none.
    turn: FloatArray
    not_drawn: tuple[str, ...]  # landmarks that the drawing lacks
    not_touched: tuple[str, ...]  # landmarks of the drawing that were not touched

    @property
    def rms(self) -> float:
        """Root mean square length of the deviations, m."""
        return float(np.sqrt(np.nanmean(np.sum(self.deviation**2, axis=1))))

    @property
    def largest(self) -> float:
        """The longest deviation, m."""
        return float(np.nanmax(np.linalg.norm(self.deviation, axis=1)))


def quarter_turns(names: Sequence[str], position: FloatArray, drawing: Artefact) -> int:
    """Quarter turns that bring the side's direction to that of the drawing's x axis.

    Any side of a plate may be the one that was touched; the drawing says which.
    """
    rows = _shared(names, drawing)
    drawn = drawing.position_of(names[k] for k in rows)
    turn, _ = register_points(position[rows, :], drawn)
    return round(float(rpy_from_rotation(turn)[2]) / QUARTER) % 4


def compare(
    names: Sequence[str], position: FloatArray, yaw: FloatArray, drawing: Artefact
) -> DrawingComparison:
    """Register certified landmarks (positions, m; turns of the seated tip, rad) and subtract.

    Raises:
        ArtefactError: fewer than three landmarks in common, or these are on a line, or are not
            the same landmarks.
    """
    rows = _shared(names, drawing)
    drawn = drawing.position_of(names[k] for k in rows)
    try:
        registration = register(position[rows], drawn)
    except SamplesError as problem:
        raise ArtefactError(
            f"landmarks that do not fit the drawing {drawing.name!r}: {problem.found}",
            "the drawing of this artefact, with the same names of landmarks",
            where="--nominal",
        ) from None
    deviation = np.full(position.shape, np.nan)
    deviation[rows] = registration.act(position[rows]) - drawn
    turned = float(rpy_from_rotation(registration.rotation)[2])
    turn = np.full(len(names), np.nan)
    for k in rows:
        seated = drawing.landmark(names[k]).rotation
        if seated is not None:
            turn[k] = yaw[k] + turned - rpy_from_rotation(seated)[2]
    lacking = tuple(name for name in names if name not in drawing.landmarks)
    untouched = tuple(name for name in drawing.landmarks if name not in names)
    return DrawingComparison(drawing, registration, deviation, wrap(turn), lacking, untouched)


def _shared(names: Sequence[str], drawing: Artefact) -> list[int]:
    # What a rigid registration takes.
    least_points = 3
    rows = [k for k, name in enumerate(names) if name in drawing.landmarks]
    if len(rows) < least_points:
        lacking = next((name for name in names if name not in drawing.landmarks), "")
        raise ArtefactError(
            f"{len(rows)} of the touched landmarks in the drawing {drawing.name!r}",
            f"at least {least_points} of {', '.join(names)}",
            hint=did_you_mean(lacking, drawing.landmarks),
        )
    return rows
