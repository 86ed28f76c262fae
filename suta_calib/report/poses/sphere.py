"""Directions on a sphere, flattened: whether motions are spread is seen at a glance.

Lambert's azimuthal projection keeps areas, so crowded places are crowded on the sphere too; rings
tell the angle from the middle.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.report.svg import BLUE, ORANGE

RINGS: Final = (5, 10, 15, 30, 45, 60, 90, 120, 150, 180)  # deg
# Marks from which on they are drawn as pixels: the file would be many megabytes.
MANY_MARKERS: Final = 2000
LARGEST_MARKER: Final = 110.0  # points²
INLIER: Final[dict[str, Any]] = {"marker": "o", "facecolor": BLUE, "edgecolor": "white"}
OUTLIER: Final[dict[str, Any]] = {"marker": "X", "facecolor": ORANGE, "edgecolor": "black"}


def draw_directions(axes: Axes, directions: FloatArray, inliers: BoolArray) -> None:
    """Unit vectors (n, 3) seen from outside the sphere above their mean."""
    middle = _unit(directions[inliers].mean(axis=0))
    across, up = _plane(middle)
    cosine = np.clip(directions @ middle, -1.0, 1.0)
    tangent = directions @ np.stack([across, up], axis=1)
    widest = _ring_beyond(float(np.degrees(np.arccos(cosine[inliers].min()))))
    _draw_rings(axes, widest)
    shown = cosine >= np.cos(np.radians(widest)) - 1e-9
    _scatter(axes, _flat(tangent, cosine), np.full(len(directions), 22.0), inliers, shown)
    if not shown.all():
        note = f"outliers farther out: {np.sum(~shown)}"
        axes.text(0.5, -0.02, note, transform=axes.transAxes, fontsize=8, ha="center", va="top")


def draw_axes(axes: Axes, vectors: FloatArray, inliers: BoolArray) -> None:
    """Axes of rotation vectors (n, 3), rad, seen along z; markers grow with the angle.

    An axis has no sign: those that point down are drawn where they come out above, and opposite
    points of the rim are one.
    """
    angle = np.linalg.norm(vectors, axis=1)
    turned = angle > 1e-9
    units = vectors[turned] / angle[turned, None]
    units *= np.where(units[:, 2:] < 0, -1.0, 1.0)
    _draw_rings(axes, 90)
    sizes = LARGEST_MARKER * angle[turned] / max(float(angle.max()), 1e-9)
    everything = np.ones(len(units), dtype=np.bool_)
    _scatter(axes, _flat(units[:, :2], units[:, 2]), sizes, inliers[turned], everything)


def _scatter(
    axes: Axes, places: FloatArray, sizes: FloatArray, inliers: BoolArray, shown: BoolArray
) -> None:
    many = len(places) > MANY_MARKERS
    # Small ones on top of large ones.
    order = np.argsort(-sizes, kind="stable")
    places, sizes, inliers, shown = places[order], sizes[order], inliers[order], shown[order]
    for which, look in ((inliers & shown, INLIER), (~inliers & shown, OUTLIER)):
        if which.any():
            x, y = places[which].T
            axes.scatter(
                x, y, s=sizes[which], linewidths=0.6, alpha=0.85, zorder=3, rasterized=many, **look
            )


def _flat(tangent: FloatArray, cosine: FloatArray) -> FloatArray:
    """Lambert's projection: radius √2 · sin(angle / 2) · √2, so that 90° is √2."""
    sine = np.linalg.norm(tangent, axis=1)
    radius = np.sqrt(np.maximum(2.0 * (1.0 - cosine), 0.0))
    return np.asarray(tangent * (radius / np.maximum(sine, 1e-12))[:, None])


def _draw_rings(axes: Axes, widest: int) -> None:
    inner = [ring for ring in RINGS if widest / 4 <= ring < widest][-2:]
    for ring in (*inner, widest):
        radius = 2.0 * np.sin(np.radians(ring) / 2.0)
        rim = ring == widest
        axes.add_patch(
            Circle((0, 0), radius, fill=False, color="#555555" if rim else "#bbbbbb", lw=0.8)
        )
        corner = radius * np.sqrt(0.5)
        # Above the marks, which would make it illegible.
        label = axes.text(corner, corner, f"{ring}°", color="#333333", fontsize=8, zorder=4)
        label.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.8})
    radius = 2.0 * np.sin(np.radians(widest) / 2.0)
    axes.plot([-radius, radius], [0, 0], [0, 0], [-radius, radius], color="#dddddd", lw=0.7)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_xlim(-1.15 * radius, 1.15 * radius)
    axes.set_ylim(-1.15 * radius, 1.15 * radius)


def _ring_beyond(angle: float) -> int:
    return next(ring for ring in RINGS if ring >= min(1.02 * angle, 180.0))


def _plane(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that make a right-handed triad with ``normal``, seen against it."""
    least = np.eye(3)[np.argmin(np.abs(normal))]
    across = _unit(np.cross(least, normal))
    return across, np.cross(normal, across)


def _unit(vector: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
