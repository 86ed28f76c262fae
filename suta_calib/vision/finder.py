"""Common parts of the search for any kind of board in a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import InputError
from suta_calib.vision.corner_model import FittedCorners, fit_corners
from suta_calib.vision.opencv import opencv
from suta_calib.vision.pictures import Grey

# Radius of the disc in which a corner is sought, px: more adds time and little else.
RADII: Final = (2, 8)
# How far a corner may be from where it was first seen, in ways to the next one.
REACH: Final = 0.35


class NotSeenError(InputError):
    """A picture without the board, or with more than one; ``found`` says what was seen."""


@dataclass(frozen=True, eq=False)
class DetectedBoard:
    """A board in a picture.

    Attributes:
        point: (n,) numbers of its points.
        pixel: (n, 2) where they are, px.
        std: (n,) standard deviation of each coordinate by the picture's noise, px; NaN where it
            is not known.
        blur: standard deviation of the blur of the edges, px; NaN where it is not known.
    """

    point: IntArray
    pixel: FloatArray
    std: FloatArray
    blur: float

    @classmethod
    def of(
        cls,
        saddles: FittedCorners,
        found: BoolArray,
        numbers: IntArray,
        scale: float = 1.0,
        outside: Callable[[FloatArray], FloatArray] = np.asarray,
    ) -> Self:
        """Those of saddles (n,) that were found, in a copy so many times smaller."""
        return cls(
            numbers[found],
            outside(saddles.pixel[found]),
            scale * saddles.std[found],
            scale * float(np.median(saddles.blur[found])),
        )


def refined(
    grey: Grey,
    start: FloatArray,
    spacing: float,
    *,
    most: float = 0.45,
    reach: float = REACH,
) -> tuple[FittedCorners, BoolArray]:
    """Corners between squares, and which of them are corners at all.

    Args:
        grey: the picture.
        start: (n, 2) where they are about, px.
        spacing: least way from one to the next, px.
        most: radius of the disc around each that holds nothing else, in ``spacing``.
        reach: how far a corner may be from there, in ``spacing``.
    """
    cv2 = opencv()
    radius = int(np.clip(most * spacing, *RADII))
    # Draws a rough place nearer, from farther away than the fit converges.
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)
    places = np.ascontiguousarray(start, dtype=np.float32).reshape(-1, 1, 2)
    inside = np.all((start >= 0) & (start <= np.array(grey.shape[::-1]) - 1), axis=1)
    drawn = start.copy()
    if inside.any():
        nearer = cv2.cornerSubPix(grey, places[inside], (radius, radius), (-1, -1), criteria)
        drawn[inside] = nearer.reshape(-1, 2)
    astray = np.linalg.norm(drawn - start, axis=1) > reach * spacing
    drawn[astray] = start[astray]
    saddles = fit_corners(grey, drawn, radius)
    return saddles, inside & saddles.plausible(start, reach * spacing)


def homography(a: FloatArray, b: FloatArray, tolerance: float) -> tuple[FloatArray | None, Any]:
    """Homography (3, 3) from a (n, 2) to b (n, 2), and (n,) which agree within ``tolerance``."""
    cv2 = opencv()
    H, inliers = cv2.findHomography(a, b, cv2.RANSAC, tolerance)
    if H is None:
        return None, np.zeros(len(a), dtype=np.bool_)
    return H, inliers.ravel().astype(bool)


def transformed(H: FloatArray, points: FloatArray) -> FloatArray:
    """Points (n, 2) under a homography."""
    moved = points @ H[:, :2].T + H[:, 2]
    return np.asarray(moved[:, :2] / moved[:, 2:])


def nothing_seen(grey: Grey, what: str) -> NotSeenError:
    """Error about a picture in which no board was found, to be raised by the caller."""
    dark, light = np.percentile(grey, (0.5, 99.5))
    # Greys of a picture in which there is nothing.
    if light - dark < 10.0:
        return NotSeenError(f"an empty picture: greys from {dark:.0f} to {light:.0f} of 255")
    # In how many pixels the sharpest edges go from dark to light.
    smooth = opencv().GaussianBlur(grey, (0, 0), 1.0).astype(np.float32)
    steepest = np.percentile(np.hypot(*np.gradient(smooth)), 99.9)
    width = float(light - dark) / max(float(steepest), 1e-3)
    # Wider, blur may be why nothing was found.
    if width > 6.0:
        return NotSeenError(f"no {what}; the picture is blurred: its edges are {width:.0f} px wide")
    return NotSeenError(f"no {what}")


def without(grey: Grey, pixels: NDArray[Any], margin: float) -> Grey:
    """The picture, what lies within ``margin`` px around these pixels (n, 2) painted over."""
    cv2 = opencv()
    hull = cv2.convexHull(np.round(pixels).astype(np.int32).reshape(-1, 1, 2))
    painted = grey.copy()
    colour = int(np.median(grey))
    cv2.fillConvexPoly(painted, hull, colour)
    cv2.polylines(painted, [hull], True, colour, thickness=min(2 * int(margin) + 1, 255))
    return painted
