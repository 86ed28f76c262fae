"""Pictures of the answers on poses: residuals row by row, directions, axes of motions, arrows.

Directions on a sphere are flattened by Lambert's azimuthal projection, which keeps areas: crowded
places are crowded on the sphere too; rings tell the angle from the middle.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.measurements.pose_files import Points, ToolPoses
from suta_calib.plotting.factor import round_down
from suta_calib.plotting.style import BLUE, GREY, ORANGE, WIDTH, plain_log
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.pose_calibration.registration import Registration
from suta_calib.report.svg import picture, shown_array, svg_text
from suta_calib.units import Unit, deg, from_deg, mm, shown, unit_name

LARGE: Final = 1.3 * WIDTH
# Outliers so many times the others' scatter would press these flat on a linear scale.
FAR: Final = 10.0
# Residuals below it, mm or degrees, are rounding: exact data have no other.
ROUNDING: Final = 1e-6
RINGS: Final = (5, 10, 15, 30, 45, 60, 90, 120, 150, 180)  # deg
# Marks from which on they are drawn as pixels: the file would be many megabytes.
MANY_MARKERS: Final = 2000
LARGEST_MARKER: Final = 110.0  # points²
INLIER: Final[dict[str, Any]] = {"marker": "o", "color": BLUE, "linestyle": "none", "ms": 4.5}
OUTLIER: Final[dict[str, Any]] = {
    "marker": "X",
    "color": ORANGE,
    "linestyle": "none",
    "ms": 8,
    "markeredgecolor": "black",
    "markeredgewidth": 0.6,
}
# The longest arrow, as a part of the points' extent.
ARROW: Final = 0.25
_SPREAD: Final[dict[str, Any]] = {"marker": "o", "facecolor": BLUE, "edgecolor": "white"}
_ASTRAY: Final[dict[str, Any]] = {"marker": "X", "facecolor": ORANGE, "edgecolor": "black"}


def pivot_plot(found: PivotCalibration, data: ToolPoses) -> str:
    """An SVG: residuals by pose, and the directions of the tool in the tracker."""
    with picture("pivot", (LARGE, 3.6)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.7, 1))
        draw_residuals(left, found.residuals, found.inliers, found.rms, "m", "pose (row, from 0)")
        left.set_title("Tip from post", pad=24)
        left.set_ylabel("distance, mm")
        # From the tool's origin to its tip; the tool's z where they coincide.
        length = float(np.linalg.norm(found.tip))
        axis = found.tip / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
        draw_directions(right, np.asarray(data.rotation @ axis), found.inliers)
        right.set_title("Directions of the tool in the tracker\n(angle from their mean)")
        return svg_text(figure, "pivot", "Pivot calibration: residuals and directions")


def hand_eye_plot(found: HandEyeCalibration) -> str:
    """An SVG: residuals by pair in length and angle, and the axes of the motions."""
    name = "hand_eye"
    with picture(name, (LARGE, 4.6)) as figure:
        panels = figure.subplot_mosaic("LA;TA", width_ratios=(1.5, 1))
        length, turn, inliers = panels["L"], panels["T"], found.inliers
        draw_residuals(length, found.residuals, inliers, found.rms, "m", "")
        draw_residuals(
            turn, found.rotation_residuals, inliers, found.rms_angle, "rad", "pair (row, from 0)"
        )
        length.set_title("A X B from their mean", pad=24)
        length.set_ylabel("distance, mm")
        turn.set_ylabel("turn, deg")
        draw_axes(panels["A"], found.axes, inliers[1:] & inliers[:-1])
        # With the eye beside the robot the hand's poses are inverted: axes are in the base.
        frame = "hand" if found.setup == "eye-in-hand" else "base"
        panels["A"].set_title(
            f"Axes of the motions from row to row,\nin the {frame} (angle from its z);\n"
            "large marks: large turns"
        )
        return svg_text(figure, name, "Hand-eye calibration: residuals and axes of motion")


def register_plot(found: Registration, b: Points) -> str:
    """An SVG: residuals by point, and as arrows at the points, seen from two sides."""
    with picture("register", (LARGE, 6.4)) as figure:
        panels = figure.subplot_mosaic("NN;PA", height_ratios=(1, 1.5))
        top = panels["N"]
        draw_residuals(top, found.residuals, found.inliers, found.rms, "m", "point (row, from 0)")
        top.set_title("Residuals", pad=24)
        top.set_ylabel("distance, mm")
        _arrow_views(panels["P"], panels["A"], found, b.position)
        return svg_text(figure, "register", "Registration: residuals by point and as vectors")


def _arrow_views(first: Axes, second: Axes, found: Registration, points: FloatArray) -> None:
    """Residuals in the plane that the points come nearest to, and across it."""
    inliers = found.inliers
    centred = points - points[inliers].mean(axis=0)
    principal = np.linalg.svd(centred[inliers])[2]
    places, vectors = centred @ principal.T, found.residuals @ principal.T
    longest = float(np.linalg.norm(vectors[inliers], axis=1).max())
    extent = float(np.ptp(places[inliers], axis=0).max())
    factor = round_down(ARROW * extent / longest) if mm(longest) >= ROUNDING else 1.0
    views = ((first, 1, "2nd", "in the points' plane"), (second, 2, "3rd", "across it"))
    for axes, other, name, where in views:
        fitted, astray = (mm(places[which][:, [0, other]].T) for which in (inliers, ~inliers))
        axes.plot(*fitted, **INLIER)
        axes.plot(*astray, **OUTLIER)
        # An outlier's arrow would only hide the others.
        arrows = mm(factor * vectors[inliers][:, [0, other]].T)
        axes.quiver(*fitted, *arrows, angles="xy", scale_units="xy", scale=1.0, width=0.006)
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.15)
        axes.grid()
        axes.set_title(f"Residuals {where}, enlarged {factor:g} times")
        axes.set_xlabel("along the points' 1st principal axis, mm")
        axes.set_ylabel(f"along their {name}, mm")


def draw_residuals(
    axes: Axes, residuals: FloatArray, inliers: BoolArray, rms: float, unit: Unit, what: str
) -> None:
    """Lengths of residuals by row; the inliers' scatter as a line; log where outliers are far."""
    norms, level = shown_array(np.linalg.norm(residuals, axis=1), unit), shown(rms, unit)
    rows = np.arange(len(norms))
    far = bool((norms[~inliers] > FAR * level).any()) and level > 0
    if far:
        plain_log(axes.yaxis, axes.set_yscale)
        norms = np.maximum(norms, 0.02 * level)
    axes.axhline(
        level, color=GREY, lw=1.2, ls="--", label=f"RMS of the fitted {level:.3g} {unit_name(unit)}"
    )
    many = len(rows) > MANY_MARKERS
    axes.plot(rows[inliers], norms[inliers], label="fitted", rasterized=many, **INLIER)
    if not inliers.all():
        axes.plot(rows[~inliers], norms[~inliers], label="outlier", **OUTLIER)
    if not far:
        axes.set_ylim(0.0, max(1.08 * float(norms.max()), ROUNDING))
        axes.yaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="y")
    axes.set_xlabel(what)
    axes.legend(ncols=3, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)


def draw_directions(axes: Axes, directions: FloatArray, inliers: BoolArray) -> None:
    """Unit vectors (n, 3) seen from outside the sphere above their mean."""
    middle = _unit(directions[inliers].mean(axis=0))
    # Two unit vectors that make a right-handed triad with it, seen against it.
    across = _unit(np.cross(np.eye(3)[np.argmin(np.abs(middle))], middle))
    up = np.cross(middle, across)
    cosine = np.clip(directions @ middle, -1.0, 1.0)
    tangent = directions @ np.stack([across, up], axis=1)
    angle = min(1.02 * deg(float(np.arccos(cosine[inliers].min()))), 180.0)
    widest = next(ring for ring in RINGS if ring >= angle)
    _draw_rings(axes, widest)
    shown = cosine >= np.cos(from_deg(widest)) - 1e-9
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
    for which, look in ((inliers & shown, _SPREAD), (~inliers & shown, _ASTRAY)):
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
        radius = 2.0 * np.sin(from_deg(ring) / 2.0)
        rim = ring == widest
        axes.add_patch(
            Circle((0, 0), radius, fill=False, color="#555555" if rim else "#bbbbbb", lw=0.8)
        )
        corner = radius * np.sqrt(0.5)
        # Above the marks, which would make it illegible.
        label = axes.text(corner, corner, f"{ring}°", color="#333333", fontsize=8, zorder=4)
        label.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.8})
    radius = 2.0 * np.sin(from_deg(widest) / 2.0)
    axes.plot([-radius, radius], [0, 0], [0, 0], [-radius, radius], color="#dddddd", lw=0.7)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_xlim(-1.15 * radius, 1.15 * radius)
    axes.set_ylim(-1.15 * radius, 1.15 * radius)


def _unit(vector: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
