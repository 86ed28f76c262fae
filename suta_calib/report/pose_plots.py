"""Pictures of the answers on poses: residuals row by row, directions, axes of motions, arrows.

Directions on a sphere are flattened by Lambert's azimuthal projection, which keeps areas: crowded
places are crowded on the sphere too; rings tell the angle from the middle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.ticker import MaxNLocator

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import right_singular
from suta_calib.plotting.look import BEHIND, BLUE, GREY, LINE, ORANGE, WIDTH, round_down
from suta_calib.plotting.style import legend_above, plain_log, thinned
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import Unit, deg, from_deg, mm, shown, unit_name

if TYPE_CHECKING:
    from suta_calib.measurements.pose_files import PointSet as MeasuredPoints
    from suta_calib.measurements.pose_files import ToolPoses
    from suta_calib.pose_calibration.depth_camera import DepthCameraCalibration
    from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
    from suta_calib.pose_calibration.line_scanner import LineScannerCalibration
    from suta_calib.pose_calibration.many_eyes import ManyEyesCalibration
    from suta_calib.pose_calibration.pivot import PivotCalibration
    from suta_calib.pose_calibration.registration import Registration

# Residuals below it, mm or degrees, are rounding: exact data have no other.
ROUNDING: Final = 1e-6
RINGS: Final = (5, 10, 15, 30, 45, 60, 90, 120, 150, 180)  # deg
# From which sides points are drawn: the axes that are seen.
_SIDES: Final = {"above": (0, 1), "beside": (0, 2)}
# How inliers and outliers are marked; sizes are points across.
_INLIER: Final[dict[str, Any]] = {"marker": "o", "color": BLUE, "ls": "none", "clip_on": False}
_OUTLIER: Final[dict[str, Any]] = _INLIER | {"marker": "X", "color": ORANGE, "mec": "black"}


def pivot_plot(calibration: PivotCalibration, data: ToolPoses) -> str:
    """An SVG: residuals by pose, and the directions of the tool in the tracker."""
    # From the tool's origin to its tip; the tool's z where they coincide.
    length = float(np.linalg.norm(calibration.tip))
    axis = calibration.tip / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
    with picture("pivot", (WIDTH, 3.4)) as figure:
        residuals, directions = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
        rows = calibration.residuals, calibration.inliers, calibration.rms
        _draw_residuals(residuals, "Tip from post", *rows, "m", "pose (row, from 0)")
        draw_directions(directions, np.asarray(data.rotation @ axis), calibration.inliers)
        directions.set_title("Directions of the tool,\nby angle from their mean")
        return svg_text(figure, "pivot", "Pivot calibration: residuals and directions")


def hand_eye_plot(calibration: HandEyeCalibration) -> str:
    """An SVG: residuals by pair in length and angle, and the axes of the motions."""
    inliers, row = calibration.inliers, "pair (row, from 0)"
    # With the eye beside the robot the hand's poses are inverted: axes are in the base.
    frame = "hand" if calibration.setup == "eye-in-hand" else "base"
    with picture("hand_eye", (WIDTH, 5.6)) as figure:
        layout: Any = [["m", "rad"], ["axes", "axes"]]
        panels = figure.subplot_mosaic(layout, height_ratios=(1.0, 1.3))
        shifts, turns = (
            (calibration.residuals, inliers, calibration.rms),
            calibration.rotation_residuals,
        )
        _draw_residuals(panels["m"], "A X B from their mean", *shifts, "m", row)
        _draw_residuals(panels["rad"], "", turns, inliers, calibration.rms_angle, "rad", row)
        draw_axes(panels["axes"], calibration.axes, inliers[1:] & inliers[:-1])
        panels["axes"].set_title(
            "Axes of the motions from row to row,\n"
            f"in the {frame} (angle from its z); large marks: large turns"
        )
        what = "Hand-eye calibration: residuals and axes of motion"
        return svg_text(figure, "hand_eye", what)


def line_scanner_plot(calibration: LineScannerCalibration) -> str:
    """An SVG: residuals by scan, and all profiles in the base from two sides."""
    what = "Ball's centre" if calibration.normal is None else "Height over the plane"
    with picture("hand_eye", (WIDTH, 5.6)) as figure:
        layout: Any = [["row", "row"], ["above", "beside"]]
        panels = figure.subplot_mosaic(layout, height_ratios=(1.0, 1.5))
        rows = calibration.residuals, calibration.inliers, calibration.rms
        of_mean = " from its mean" if calibration.normal is None else ""
        _draw_residuals(panels["row"], f"{what}{of_mean}", *rows, "m", "scan (row, from 0)")
        away = calibration.profiles - calibration.place
        _draw_sides(panels, [away], f"Profiles in the base, from the {calibration.seen}")
        if calibration.radius is not None:
            turn, size = np.linspace(0.0, 2.0 * np.pi, 73), mm(calibration.radius)
            for name in _SIDES:
                panels[name].plot(size * np.cos(turn), size * np.sin(turn), c=GREY, lw=0.8)
        title = "Hand-eye calibration of a line scanner: residuals and profiles"
        return svg_text(figure, "hand_eye", title)


def depth_camera_plot(calibration: DepthCameraCalibration) -> str:
    """An SVG: residuals by picture, and everything that was seen from two sides."""
    outside = "base" if calibration.setup == "eye-in-hand" else "hand"
    with picture("hand_eye", (WIDTH, 5.6)) as figure:
        layout: Any = [["row", "row"], ["above", "beside"]]
        panels = figure.subplot_mosaic(layout, height_ratios=(1.0, 1.5))
        rows = calibration.residuals, calibration.inliers, calibration.rms
        _draw_residuals(panels["row"], "Mean of a picture", *rows, "m", "picture (from 0)")
        things = range(len(calibration.things))
        seen = [calibration.points[calibration.thing_of == k] for k in things]
        _draw_sides(panels, seen, f"All that was seen, in the {outside}")
        title = "Hand-eye calibration of a depth camera: residuals and what was seen"
        return svg_text(figure, "hand_eye", title)


def _draw_sides(panels: Mapping[str, Any], things: Sequence[FloatArray], title: str) -> None:
    """Draw points (k, 3), m, of some things, each in a colour of its own, from two sides."""
    for name, (across, up) in _SIDES.items():
        axes = panels[name]
        for points, colour in zip(things, cycle((BLUE, ORANGE, GREY)), strict=False):
            at = mm(points[:, [across, up]])
            axes.plot(*at[thinned(*at.T)].T, ".", c=colour, ms=2.0)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set(xlabel=f"{'xyz'[across]}, mm", ylabel=f"{'xyz'[up]}, mm")
        axes.set_title(f"{title},\nseen from {name}")
        axes.grid()


def many_eyes_plot(calibration: ManyEyesCalibration) -> str:
    """An SVG: residuals by pair, who saw what how well, and the axes of the motions."""
    inliers, row = calibration.inliers, "pair (row, from 0)"
    frame = "hand" if calibration.setup == "eye-in-hand" else "base"
    # As many eyes and targets as there are: a line for each.
    height = 5.6 + 0.22 * max(len(calibration.X) - 6, 0)
    with picture("hand_eye", (WIDTH, height)) as figure:
        layout: Any = [["m", "rad"], ["seen", "axes"]]
        panels = figure.subplot_mosaic(layout, height_ratios=(1.0, 1.3))
        slid = calibration.residuals, inliers, calibration.rms
        turned = calibration.rotation_residuals, inliers, calibration.rms_angle
        _draw_residuals(panels["m"], "A X B from their Z", *slid, "m", row)
        _draw_residuals(panels["rad"], "", *turned, "rad", row)
        _draw_seen(panels["seen"], calibration)
        draw_axes(panels["axes"], calibration.axes, inliers[1:] & inliers[:-1])
        panels["axes"].set_title(f"Axes of motion in the {frame},\nby angle from its z")
        what = "Hand-eye calibration of several eyes: residuals, who saw what, axes of motion"
        return svg_text(figure, "hand_eye", what)


def _draw_seen(axes: Any, calibration: ManyEyesCalibration) -> None:
    """A cell for every eye and target: rows that were fitted, darker where they agree worse."""
    sight, good = calibration.sight, calibration.inliers
    rms = np.full((len(sight.eyes), len(sight.targets)), np.nan)
    for eye, target, rows in sight.together.edges:
        fitted = rows[good[rows]]
        if len(fitted):
            length = np.linalg.norm(calibration.residuals[fitted], axis=1)
            rms[eye, target] = mm(float(np.sqrt(np.mean(length**2))))
        # Numbers that many cells have no room for.
        # Cells of a table of eyes and targets that have room for a number each.
        if rms.size <= 120:
            axes.text(target, eye, f"{len(fitted)}", ha="center", va="center", fontsize=8)
    most = float(np.nanmax(rms, initial=ROUNDING))
    image = axes.imshow(rms, cmap="Blues", vmin=0.0, vmax=1.6 * most, aspect="auto")
    axes.figure.colorbar(image, ax=axes, label="RMS, mm")
    axes.set_xticks(range(len(sight.targets)), sight.targets, rotation=90 * (rms.shape[1] > 8))
    axes.set_yticks(range(len(sight.eyes)), sight.eyes)
    axes.set(xlabel="target", ylabel="eye", title="Rows fitted, by eye and target")


def register_plot(registration: Registration, b: MeasuredPoints) -> str:
    """An SVG: residuals by point, and as arrows at the points, seen from two sides."""
    with picture("register", (WIDTH, 5.6)) as figure:
        layout: Any = [["row", "row"], ["in", "across"]]
        panels = figure.subplot_mosaic(layout, height_ratios=(1.0, 1.5))
        rows = registration.residuals, registration.inliers, registration.rms
        _draw_residuals(panels["row"], "Residuals", *rows, "m", "point (row, from 0)")
        _draw_arrows(panels["in"], panels["across"], registration, b.position)
        what = "Registration: residuals by point and as vectors"
        return svg_text(figure, "register", what)


def _draw_arrows(
    in_plane: Any, across: Any, registration: Registration, points: FloatArray
) -> None:
    """Residuals in the plane that the points come nearest to, and across it."""
    inliers = registration.inliers
    centred = points - points[inliers].mean(axis=0)
    principal = right_singular(centred[inliers])[1]
    places, vectors = centred @ principal.T, registration.residuals @ principal.T
    longest = float(np.linalg.norm(vectors[inliers], axis=1).max())
    extent = float(np.ptp(places[inliers], axis=0).max())
    # The longest arrow, as a part of the points' extent.
    arrow = 0.25
    factor = round_down(arrow * extent / longest) if mm(longest) >= ROUNDING else 1.0
    views = ((in_plane, 1, "2nd", "in the points' plane"), (across, 2, "3rd", "across it"))
    for axes, other, name, where in views:
        at, along = mm(places[:, [0, other]]), mm(factor * vectors[:, [0, other]])
        _draw_rows(axes, at[:, 0], at[:, 1], inliers)
        # The arrow of an outlier would only hide the others.
        arrows: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.004}
        axes.quiver(*at[inliers].T, *along[inliers].T, **arrows)
        axes.update_datalim(at[inliers] + along[inliers])
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(f"Residuals {where},\nenlarged {factor:g} times")
        axes.set_xlabel("along the points' 1st principal axis, mm")
        axes.set_ylabel(f"along their {name}, mm")
        axes.grid()


def _draw_residuals(
    axes: Any,
    title: str,
    residuals: FloatArray,
    inliers: BoolArray,
    rms: float,
    unit: Unit,
    row: str,
) -> None:
    """Draw lengths of residuals (n, 3), m or rad, by row; log where outliers are far."""
    sizes, level = shown(np.linalg.norm(residuals, axis=1), unit), shown(rms, unit)
    # Outliers so many times the others' scatter would press these flat on a linear scale.
    if level > 0 and (sizes[~inliers] > 10.0 * level).any():
        sizes = np.maximum(sizes, 0.02 * level)
        plain_log(axes.yaxis, axes.set_yscale)
    else:
        axes.set_ylim(0.0, max(1.08 * float(sizes.max()), ROUNDING))
    label = f"RMS of the fitted {level:.3g} {unit_name(unit)}"
    axes.axhline(level, c=GREY, lw=1.2, ls="--", label=label)
    _draw_rows(axes, np.arange(float(len(sizes))), sizes, inliers, ("fitted", "outlier"))
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
    axes.set_xlabel(row)
    axes.set_ylabel(f"{'turn' if unit == 'rad' else 'distance'}, {unit_name(unit)}")
    axes.grid(axis="y")
    legend_above(axes, columns=1, title=title)


def draw_directions(axes: Any, directions: FloatArray, inliers: BoolArray) -> None:
    """Draw unit vectors (n, 3) from outside the sphere above the mean of the ``inliers`` (n,)."""
    middle = _unit(directions[inliers].mean(axis=0))
    # Two unit vectors that make a right-handed triad with it, seen against it.
    across = _unit(np.cross(np.eye(3)[np.argmin(np.abs(middle))], middle))
    up = np.cross(middle, across)
    cosine = np.clip(directions @ middle, -1.0, 1.0)
    tangent = directions @ np.stack([across, up], axis=1)
    angle = min(1.02 * deg(float(np.arccos(cosine[inliers].min()))), 180.0)
    widest = next(ring for ring in RINGS if ring >= angle)
    inside = cosine >= np.cos(from_deg(widest)) - 1e-9
    places = _flat(tangent, cosine)[inside]
    _draw_sphere(axes, widest, places, np.full(len(places), 5.5), inliers[inside])
    if not inside.all():
        axes.set_xlabel(f"outliers farther out: {np.sum(~inside)}")


def draw_axes(axes: Any, vectors: FloatArray, inliers: BoolArray) -> None:
    """Draw axes of rotation vectors (n, 3), rad, seen along z; marks grow with the angle.

    An axis has no sign: those that point down are drawn where they come out above, and opposite
    points of the rim are one.
    """
    angle = np.linalg.norm(vectors, axis=1)
    turned = angle > 1e-9
    units = vectors[turned] / angle[turned, None]
    units *= np.where(units[:, 2:] < 0, -1.0, 1.0)
    # Areas show angles; the largest mark is ten points across.
    sizes = 10.0 * np.sqrt(angle[turned] / max(float(angle.max()), 1e-9))
    _draw_sphere(axes, 90, _flat(units[:, :2], units[:, 2]), sizes, inliers[turned])


def _draw_rows(
    axes: Any,
    x: FloatArray,
    y: FloatArray,
    inliers: BoolArray,
    labels: tuple[str | None, str | None] = (None, None),
) -> None:
    """Mark rows that were fitted, and outliers on top of them, with what the legend calls them."""
    for chosen, look, size, label in (
        (inliers, _INLIER, 4.5, labels[0]),
        (~inliers, _OUTLIER, 7.5, labels[1]),
    ):
        if chosen.any():
            rows = np.flatnonzero(chosen)[thinned(x[chosen], y[chosen])]
            axes.plot(x[rows], y[rows], ms=size, label=label, zorder=3, **look)


def _draw_sphere(
    axes: Any, widest: int, places: FloatArray, sizes: FloatArray, inliers: BoolArray
) -> None:
    """Places (n, 2) on a sphere that is flattened as far as the ring ``widest``, degrees.

    Small marks stand on top of large ones, and outliers on top of all.
    """
    rings = *[ring for ring in RINGS if widest / 4 <= ring < widest][-2:], widest
    radii = 2.0 * np.sin(from_deg(np.array(rings, dtype=float)) / 2.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    rim = float(radii[-1])
    axes.plot([[-rim, 0.0], [rim, 0.0]], [[0.0, -rim], [0.0, rim]], c=LINE, lw=0.7)
    for radius, ring in zip(radii, rings, strict=True):
        colour = "black" if ring == widest else GREY
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), c=colour, lw=0.8)
    order = np.argsort(-sizes, kind="stable")
    for chosen, marker, colour, edge, factor in (
        (inliers, "o", BLUE, "white", 1.0),
        (~inliers, "X", ORANGE, "black", 1.4),
    ):
        rows = order[chosen[order]]
        rows = rows[thinned(*places[rows].T)]
        look: dict[str, Any] = {"marker": marker, "c": colour, "edgecolors": edge, "zorder": 3}
        axes.scatter(*places[rows].T, np.square(factor * sizes[rows]), **look)
    # Above the marks, which would make them illegible.
    for radius, ring in zip(radii * np.sqrt(0.5), rings, strict=True):
        text: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8, "zorder": 4}
        axes.text(radius, radius, f"{ring}°", bbox=BEHIND, **text)
    axes.set(xticks=[], yticks=[], xlim=(-1.1 * rim, 1.1 * rim), ylim=(-1.1 * rim, 1.1 * rim))
    axes.set_aspect("equal", anchor="W")
    axes.spines[:].set_visible(False)


def _flat(tangent: FloatArray, cosine: FloatArray) -> FloatArray:
    """Lambert's projection: radius √2 · sin(angle / 2) · √2, so that 90° is √2."""
    sine = np.linalg.norm(tangent, axis=1)
    radius = np.sqrt(np.maximum(2.0 * (1.0 - cosine), 0.0))
    return np.asarray(tangent * (radius / np.maximum(sine, 1e-12))[:, None])


def _unit(vector: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
