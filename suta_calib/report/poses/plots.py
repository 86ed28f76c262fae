"""One picture for each closed problem on poses: residuals, outliers, and how spread motions are."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.measurements.pose_files import Points, ToolPoses
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.pose_calibration.registration import Registration
from suta_calib.report.poses.sphere import MANY_MARKERS, draw_axes, draw_directions
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, plain_log, shown_array, style, svg_text
from suta_calib.units import Unit, unit_name

MM: Final = 1e3
LARGE: Final = 1.3 * WIDTH
# Outliers so many times the others' scatter would press these flat on a linear scale.
FAR: Final = 10.0
# Residuals below it, mm or degrees, are rounding: exact data have no other.
ROUNDING: Final = 1e-6
# The longest arrow, as a part of the points' extent.
ARROW: Final = 0.25
INLIER: Final[dict[str, Any]] = {"marker": "o", "color": BLUE, "linestyle": "none", "ms": 4.5}
OUTLIER: Final[dict[str, Any]] = {
    "marker": "X",
    "color": ORANGE,
    "linestyle": "none",
    "ms": 8,
    "markeredgecolor": "black",
    "markeredgewidth": 0.6,
}


def pivot_figure(found: PivotCalibration, data: ToolPoses) -> str:
    """An SVG document: residuals by pose, and the directions of the tool in the tracker."""
    with style("pivot"):
        figure = Figure(figsize=(LARGE, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.7, 1))
        _residuals(left, found.residuals, found.inliers, found.rms, "m", "pose (row, from 0)")
        left.set_title("Tip from post", pad=24)
        left.set_ylabel("distance, mm")
        draw_directions(right, _tool_directions(found, data), found.inliers)
        right.set_title("Directions of the tool in the tracker\n(angle from their mean)")
        return _document(figure, "pivot", "Pivot calibration: residuals and directions")


def hand_eye_figure(found: HandEyeCalibration) -> str:
    """An SVG document: residuals by pair in length and angle, and the axes of the motions."""
    with style("hand_eye"):
        figure = Figure(figsize=(LARGE, 4.6), layout="constrained")
        panels = figure.subplot_mosaic("LA;TA", width_ratios=(1.5, 1))
        length, turn, inliers = panels["L"], panels["T"], found.inliers
        _residuals(length, found.position_residuals, inliers, found.rms, "m", "")
        _residuals(
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
        return _document(figure, "hand_eye", "Hand-eye calibration: residuals and axes of motion")


def register_figure(found: Registration, b: Points) -> str:
    """An SVG document: residuals by point, and as arrows at the points, seen from two sides."""
    with style("register"):
        figure = Figure(figsize=(LARGE, 6.4), layout="constrained")
        panels = figure.subplot_mosaic("NN;PA", height_ratios=(1, 1.5))
        top = panels["N"]
        _residuals(top, found.residuals, found.inliers, found.rms, "m", "point (row, from 0)")
        top.set_title("Residuals", pad=24)
        top.set_ylabel("distance, mm")
        _arrow_views(panels["P"], panels["A"], found, b.position)
        return _document(figure, "register", "Registration: residuals by point and as vectors")


def _residuals(
    axes: Axes, residuals: FloatArray, inliers: BoolArray, rms: float, unit: Unit, what: str
) -> None:
    """Lengths of residuals by row; the inliers' scatter as a line; log where outliers are far."""
    norms, level = shown_array(np.linalg.norm(residuals, axis=1), unit), _shown(rms, unit)
    rows = np.arange(len(norms))
    far = bool((norms[~inliers] > FAR * level).any()) and level > 0
    if far:
        plain_log(axes.yaxis, axes.set_yscale)
        norms = np.maximum(norms, 0.02 * level)
    axes.axhline(level, color=GREY, lw=1.2, ls="--", label=_level_text(level, unit))
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


def _level_text(level: float, unit: Unit) -> str:
    return f"RMS of the fitted {level:.3g} {unit_name(unit)}"


def _shown(value: float, unit: Unit) -> float:
    return float(shown_array(np.array(value), unit))


def _tool_directions(found: PivotCalibration, data: ToolPoses) -> FloatArray:
    """From the tool's origin to its tip, in the tracker; the tool's z where they coincide."""
    length = float(np.linalg.norm(found.tip))
    axis = found.tip / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
    return np.asarray(data.rotation @ axis)


def _arrow_views(first: Axes, second: Axes, found: Registration, points: FloatArray) -> None:
    """Residuals in the plane that the points come nearest to, and across it."""
    centred = points - points[found.inliers].mean(axis=0)
    principal = np.linalg.svd(centred[found.inliers])[2]
    places, vectors = centred @ principal.T, found.residuals @ principal.T
    factor = _enlargement(places[found.inliers], vectors[found.inliers])
    views = ((first, 1, "2nd", "in the points' plane"), (second, 2, "3rd", "across it"))
    for axes, other, name, where in views:
        plane = [0, other]
        _arrows(axes, places[:, plane], vectors[:, plane], found.inliers, factor)
        axes.set_title(f"Residuals {where}, enlarged {factor:g} times")
        axes.set_xlabel("along the points' 1st principal axis, mm")
        axes.set_ylabel(f"along their {name}, mm")


def _arrows(
    axes: Axes, places: FloatArray, vectors: FloatArray, inliers: BoolArray, factor: float
) -> None:
    """Arrows from the fitted points; an outlier's would only hide them."""
    axes.plot(*MM * places[inliers].T, **INLIER)
    axes.plot(*MM * places[~inliers].T, **OUTLIER)
    x, y = MM * places[inliers].T
    dx, dy = MM * factor * vectors[inliers].T
    axes.quiver(x, y, dx, dy, angles="xy", scale_units="xy", scale=1.0, width=0.006)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.15)
    axes.grid()


def _enlargement(places: FloatArray, vectors: FloatArray) -> float:
    """1, 2 or 5 times a power of ten, so that the longest arrow is a fraction of the extent."""
    longest = float(np.linalg.norm(vectors, axis=1).max())
    if MM * longest < ROUNDING:
        return 1.0
    wanted = ARROW * float(np.ptp(places, axis=0).max()) / longest
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(decade * max(step for step in (1, 2, 5) if step * decade <= wanted))


def _document(figure: Figure, name: str, description: str) -> str:
    return svg_text(figure, name, description) + "\n"
