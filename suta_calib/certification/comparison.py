"""The certified landmarks against a drawing: one by one, and how all of them stand over the ground.

A drawing and a certificate both count height from the ground, so the motion that superposes them
best may turn and shift along the ground, but neither rise nor tilt. Where it does,
the tops and the ground were not touched alike: the ball's radius was taken off on one of them, or
the instrument or the artefact was moved between them. No landmark stands out; no residual shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.assessment import Level
from suta_calib.certification.noise import ENOUGH_FREEDOM
from suta_calib.certification.scatter import (
    FALSE_ALARM,
    FINEST,
    RISK,
    STANDS_OUT,
    Scatter,
    deviates,
)
from suta_calib.errors import ArtefactError, SamplesError, did_you_mean
from suta_calib.geometry.numbers import register_points, rpy_from_rotation, wrap
from suta_calib.measurements import Artefact
from suta_calib.pose_calibration.registration import Registration, register
from suta_calib.units import deg, mm

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
            f"{len(rows)} of the touched landmarks are in the drawing {drawing.name!r}",
            f"at least {least_points} of {', '.join(names)}",
            hint=did_you_mean(lacking, drawing.landmarks),
        )
    return rows


# Rise, and tilt about x and y.
UNKNOWNS: Final = 3
# Chance of either sign, that one of them is seen where there is none.
CHANCE: Final = FALSE_ALARM / UNKNOWNS / 2


@dataclass(frozen=True, eq=False)
class OverGround:
    """Rise and tilt of all landmarks together, certified less drawn."""

    height: float  # of the landmarks' middle, m
    tilt: FloatArray  # (2,) about the artefact's x and y, rad
    # (3,) standard deviations of height and tilt, from the ground's touches and from how well
    # single landmarks are made.
    std: FloatArray
    by_touch: FloatArray  # (3,) those from all touches, however the landmarks are made
    beyond: BoolArray  # (3,) whether they are no chance
    touch_freedom: float  # degrees of freedom of a touch's noise; inf where that is stated
    spread: float  # what one landmark's height departs from the drawing's by itself, m
    reach: float  # of the landmarks from their middle, m: over it a tilt becomes a length
    tolerance: float | None  # largest acceptable departure, m, if one was given

    @property
    def level(self) -> Level:
        """The worse of the two."""
        levels: tuple[Level, ...] = ("bad", "care")
        return next((level for level in levels if level in (self.risen, self.tilted)), "good")

    @property
    def risen(self) -> Level:
        """Whether all landmarks stand higher or lower than drawn.

        ``care`` where it is no chance; ``bad`` where it is as much as makes a single landmark a
        damaged one, and where it is out of the tolerance for certain.
        """
        return self._judged(0)

    @property
    def tilted(self) -> Level:
        """Likewise whether they lean."""
        about_x, about_y = self._judged(1), self._judged(2)
        return about_x if about_y == "good" or about_x == "bad" else about_y

    def notes(self, level: Level) -> list[str]:
        """What is said of it at this level."""
        sentences = list[str]()
        if self.risen == level:
            higher = "higher" if self.height > 0 else "lower"
            sentences.append(
                f"All landmarks are {mm(abs(self.height)):.4f} ± {mm(float(self.std[0])):.4f} mm "
                f"{higher} above the ground than in the drawing. Check whether the ball's radius "
                "was corrected on the ground and on the tops, whether anything moved between "
                "touching them, and whether the drawing counts z from the ground."
            )
        if self.tilted == level:
            size, sure = float(np.hypot(*self.tilt)), float(self.std[1:].max())
            sentences.append(
                f"All landmarks are tilted by {deg(size):.4f} ± {deg(sure):.4f}° against the "
                f"ground, which is {mm(size * self.reach):.4f} mm at the outermost landmark. "
                "Check whether anything moved between touching the ground and the pillars, and "
                "whether z is upright in the drawing."
            )
        return sentences

    def _judged(self, row: int) -> Level:
        lever = self.reach if row else 1.0
        off = lever * abs(float([self.height, *self.tilt][row]))
        factor = deviates(CHANCE if self.tolerance is None else RISK, self.touch_freedom)
        allowance = STANDS_OUT * self.spread if self.tolerance is None else self.tolerance
        # A height out of tolerance is so whether or not the landmarks scatter as much.
        certain = bool(self.beyond[row]) or (self.tolerance is not None and row == 0)
        if certain and off > factor * lever * float(self.by_touch[row]) + allowance:
            return "bad"
        return "care" if self.beyond[row] else "good"


def over_ground(
    names: Sequence[str],
    position: FloatArray,
    height_by: FloatArray,
    ground: slice,
    comparison: DrawingComparison,
    freedom: float,
    tolerance: float | None,
) -> OverGround:
    """Rise and tilt of landmarks, by the plane that fits their heights less the drawn ones best.

    ``height_by`` (n, c) is the derivative of the heights by everything touched, times the standard
    deviation of that, m, which has so many degrees of freedom (inf where it is stated); of its
    columns those of the ``ground`` are what all landmarks have in common. ``tolerance`` is the
    largest acceptable departure, m, if there is one.
    """
    drawing = comparison.drawing
    rows = np.array([k for k, name in enumerate(names) if name in drawing.landmarks])
    marks = [drawing.landmark(names[k]) for k in rows]
    off = position[rows, 2] - np.array([mark.position[2] for mark in marks])
    across = position[rows, :2] - position[rows, :2].mean(axis=0)
    # A turn about x lifts what is at y, one about y lowers what is at x.
    design = np.column_stack([np.ones(len(rows)), across[:, 1], -across[:, 0]])
    solved = np.linalg.pinv(design)
    estimate = solved @ off
    by_touch = solved @ height_by[rows]
    by_ground = np.linalg.norm(by_touch[:, ground], axis=1)
    # What has standard deviations was measured itself, over a ground touched as well as this one.
    times = 2.0 if any(mark.sigma for mark in marks) else 1.0
    by_ground = np.sqrt(times) * by_ground
    size, scatter = np.linalg.norm(solved, axis=1), off - design @ estimate
    alone = Scatter(float(scatter @ scatter), len(rows) - UNKNOWNS)
    places = float(np.sum(comparison.deviation[rows, :2] ** 2))
    # What a rigid superposition takes of three coordinates of each landmark.
    every = Scatter(alone.squared + places, 3 * len(rows) - 6)

    def beyond(chance: float, scatter: Scatter) -> BoolArray:
        if scatter.freedom < 1:
            return np.ones(UNKNOWNS, dtype=np.bool_)
        std = np.hypot(by_ground, max(scatter.sigma, FINEST) * size)
        return np.asarray(np.abs(estimate) > std * deviates(chance, scatter.freedom))

    # Where all coordinates refute a chance, the heights by themselves, which are fewer and may be
    # made worse than the places, must refute this one.
    strict, loose = beyond(CHANCE, alone), beyond(0.01 / UNKNOWNS / 2, alone)
    significant = loose & beyond(CHANCE, every) | strict & (alone.freedom > 0)
    spread = max((alone if alone.freedom >= ENOUGH_FREEDOM else every).sigma, FINEST)
    return OverGround(
        height=float(estimate[0]),
        tilt=estimate[1:],
        std=np.hypot(by_ground, spread * size),
        by_touch=np.sqrt(times) * np.linalg.norm(by_touch, axis=1),
        beyond=significant,
        touch_freedom=freedom,
        spread=spread,
        reach=float(np.linalg.norm(across, axis=1).max()),
        tolerance=tolerance,
    )
