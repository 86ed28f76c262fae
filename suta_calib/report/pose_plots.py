"""Pictures of the answers on poses: residuals row by row, directions, axes of motions, arrows.

Directions on a sphere are flattened by Lambert's azimuthal projection, which keeps areas: crowded
places are crowded on the sphere too; rings tell the angle from the middle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import right_singular
from suta_calib.plotting.chart import Axis, Chart, Lines, Mark, Points, Words, ends
from suta_calib.plotting.factor import round_down
from suta_calib.plotting.look import BLACK, BLUE, GREY, LINE, ORANGE, WHITE
from suta_calib.report.chart_svg import Row, rows_svg
from suta_calib.units import Unit, deg, from_deg, mm, shown, unit_name

if TYPE_CHECKING:
    from suta_calib.measurements.pose_files import Points as MeasuredPoints
    from suta_calib.measurements.pose_files import ToolPoses
    from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
    from suta_calib.pose_calibration.pivot import PivotCalibration
    from suta_calib.pose_calibration.registration import Registration

# Outliers so many times the others' scatter would press these flat on a linear scale.
FAR: Final = 10.0
# Residuals below it, mm or degrees, are rounding: exact data have no other.
ROUNDING: Final = 1e-6
RINGS: Final = (5, 10, 15, 30, 45, 60, 90, 120, 150, 180)  # deg
# Points across: of a row, of an outlier, of a direction, of the largest turn.
_ROW: Final = 4.5
_OUTLIER: Final = 7.5
_DIRECTION: Final = 5.5
_LARGEST: Final = 10.0
# Heights of panels, points.
_RESIDUALS: Final = 110.0
_SPHERE: Final = 175.0
# The longest arrow, as a part of the points' extent, and its head, as a part of the arrow.
ARROW: Final = 0.25
_HEAD: Final = 0.25
_EVERY: Final = np.array([[-np.inf, np.inf]])


def pivot_plot(found: PivotCalibration, data: ToolPoses) -> str:
    """An SVG: residuals by pose, and the directions of the tool in the tracker."""
    residuals = residuals_chart(
        "Tip from post", found.residuals, found.inliers, found.rms, "m", "pose (row, from 0)"
    )
    # From the tool's origin to its tip; the tool's z where they coincide.
    length = float(np.linalg.norm(found.tip))
    axis = found.tip / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
    directions = directions_chart(
        "Directions of the tool\nin the tracker\n(angle from their mean)",
        np.asarray(data.rotation @ axis),
        found.inliers,
    )
    row = Row([residuals, directions], _SPHERE, (1.6, 1.0))
    return rows_svg([row], "pivot", "Pivot calibration: residuals and directions")


def hand_eye_plot(found: HandEyeCalibration) -> str:
    """An SVG: residuals by pair in length and angle, and the axes of the motions."""
    inliers = found.inliers
    pair = "pair (row, from 0)"
    parts: tuple[tuple[str, FloatArray, float, Unit], ...] = (
        ("A X B from their mean", found.residuals, found.rms, "m"),
        ("", found.rotation_residuals, found.rms_angle, "rad"),
    )
    of_pairs = [
        residuals_chart(title, residuals, inliers, rms, unit, pair, columns=1)
        for title, residuals, rms, unit in parts
    ]
    # With the eye beside the robot the hand's poses are inverted: axes are in the base.
    frame = "hand" if found.setup == "eye-in-hand" else "base"
    axes = axes_chart(
        f"Axes of the motions from row to row,\nin the {frame} (angle from its z); "
        "large marks: large turns",
        found.axes,
        inliers[1:] & inliers[:-1],
    )
    rows = [Row(of_pairs, _RESIDUALS), Row([axes], _SPHERE)]
    return rows_svg(rows, "hand_eye", "Hand-eye calibration: residuals and axes of motion")


def register_plot(found: Registration, b: MeasuredPoints) -> str:
    """An SVG: residuals by point, and as arrows at the points, seen from two sides."""
    residuals = residuals_chart(
        "Residuals", found.residuals, found.inliers, found.rms, "m", "point (row, from 0)"
    )
    rows = [Row([residuals], _RESIDUALS), Row(_arrow_views(found, b.position), _SPHERE)]
    return rows_svg(rows, "register", "Registration: residuals by point and as vectors")


def _arrow_views(found: Registration, points: FloatArray) -> list[Chart]:
    """Residuals in the plane that the points come nearest to, and across it."""
    inliers = found.inliers
    centred = points - points[inliers].mean(axis=0)
    principal = right_singular(centred[inliers])[1]
    places, vectors = centred @ principal.T, found.residuals @ principal.T
    longest = float(np.linalg.norm(vectors[inliers], axis=1).max())
    extent = float(np.ptp(places[inliers], axis=0).max())
    factor = round_down(ARROW * extent / longest) if mm(longest) >= ROUNDING else 1.0
    views = ((1, "2nd", "in the points' plane"), (2, "3rd", "across it"))
    return [
        _arrows(
            mm(places[:, [0, other]]),
            mm(factor * vectors[:, [0, other]]),
            inliers,
            f"Residuals {where},\nenlarged {factor:g} times",
            f"along their {name}, mm",
        )
        for other, name, where in views
    ]


def _arrows(
    places: FloatArray, vectors: FloatArray, inliers: BoolArray, title: str, up: str
) -> Chart:
    """Points (n, 2) with arrows; an outlier's would only hide the others."""
    begin, along = places[inliers], vectors[inliers]
    tip, across = begin + along, along @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    back, aside = tip - _HEAD * along, 0.5 * _HEAD * across
    x, y = np.stack([begin, tip, back + aside, back - aside, tip], axis=-1).swapaxes(0, 1)
    everything = np.concatenate([places, tip])
    wide, high = (ends(each) for each in everything.T)
    marks = [*_points(places[:, 0], places[:, 1], inliers), Lines(x, y)]
    first = Axis("along the points' 1st principal axis, mm", *wide, grid=True)
    return Chart(marks, first, Axis(up, *high, grid=True), title=title, equal=True)


def residuals_chart(
    title: str,
    residuals: FloatArray,
    inliers: BoolArray,
    rms: float,
    unit: Unit,
    what: str,
    columns: int = 2,
) -> Chart:
    """Lengths of residuals by row; the inliers' scatter as a line; log where outliers are far.

    Args:
        title: above it.
        residuals: (n, 3), m or rad.
        inliers: (n,) which were fitted.
        rms: of these, m or rad.
        unit: of both.
        what: a row is.
        columns: of the legend.
    """
    norms = np.linalg.norm(residuals, axis=1) * shown(1.0, unit)
    level, rows = shown(rms, unit), np.arange(float(len(norms)))
    far = bool((norms[~inliers] > FAR * level).any()) and level > 0
    if far:
        norms = np.maximum(norms, 0.02 * level)
        low, high = ends(np.append(norms, level), log=True)
    else:
        low, high = 0.0, max(1.08 * float(norms.max()), ROUNDING)
    label = f"RMS of the fitted {level:.3g} {unit_name(unit)}"
    marks = [
        Lines(_EVERY, np.full((1, 2), level), 1.2, GREY, "dashed", label),
        *_points(rows, norms, inliers, "fitted", "outlier"),
    ]
    name = "turn" if unit == "rad" else "distance"
    up = Axis(f"{name}, {unit_name(unit)}", low, high, log=far, grid=True)
    return Chart(marks, Axis(what, *ends(rows), whole=True), up, columns, title=title)


def directions_chart(title: str, directions: FloatArray, inliers: BoolArray) -> Chart:
    """Unit vectors (n, 3) seen from outside the sphere above the mean of the ``inliers`` (n,)."""
    middle = _unit(directions[inliers].mean(axis=0))
    # Two unit vectors that make a right-handed triad with it, seen against it.
    across = _unit(np.cross(np.eye(3)[np.argmin(np.abs(middle))], middle))
    up = np.cross(middle, across)
    cosine = np.clip(directions @ middle, -1.0, 1.0)
    tangent = directions @ np.stack([across, up], axis=1)
    angle = min(1.02 * deg(float(np.arccos(cosine[inliers].min()))), 180.0)
    widest = next(ring for ring in RINGS if ring >= angle)
    shown = cosine >= np.cos(from_deg(widest)) - 1e-9
    marks = _marks(_flat(tangent, cosine), np.full(len(directions), _DIRECTION), inliers, shown)
    note = "" if shown.all() else f"outliers farther out: {np.sum(~shown)}"
    return _sphere(title, widest, marks, note)


def axes_chart(title: str, vectors: FloatArray, inliers: BoolArray) -> Chart:
    """Axes of rotation vectors (n, 3), rad, seen along z; marks grow with the angle.

    An axis has no sign: those that point down are drawn where they come out above, and opposite
    points of the rim are one.
    """
    angle = np.linalg.norm(vectors, axis=1)
    turned = angle > 1e-9
    units = vectors[turned] / angle[turned, None]
    units *= np.where(units[:, 2:] < 0, -1.0, 1.0)
    sizes = _LARGEST * np.sqrt(angle[turned] / max(float(angle.max()), 1e-9))
    everything = np.ones(len(units), dtype=np.bool_)
    marks = _marks(_flat(units[:, :2], units[:, 2]), sizes, inliers[turned], everything)
    return _sphere(title, 90, marks)


def draw_axes(axes: Any, vectors: FloatArray, inliers: BoolArray) -> None:
    """Draw an `axes_chart` on Matplotlib's `Axes`."""
    from suta_calib.plotting.on_axes import draw_chart

    draw_chart(axes, axes_chart("", vectors, inliers))


def _points(
    x: FloatArray, y: FloatArray, inliers: BoolArray, fitted: str = "", astray: str = ""
) -> list[Mark]:
    """Rows that were fitted, and, on top of them, outliers, with what the legend calls them."""
    found: list[Mark] = [Points(x[inliers], y[inliers], _ROW, "circle", BLUE, BLUE, fitted)]
    if not inliers.all():
        outlier = Points(x[~inliers], y[~inliers], _OUTLIER, "cross", ORANGE, BLACK, astray)
        found.append(outlier)
    return found


def _marks(
    places: FloatArray, sizes: FloatArray, inliers: BoolArray, shown: BoolArray
) -> list[Mark]:
    """Places (n, 2) on a flattened sphere, small marks on top of large ones."""
    order = np.argsort(-sizes, kind="stable")
    places, sizes, inliers, shown = places[order], sizes[order], inliers[order], shown[order]
    x, y = places.T
    fitted, astray = inliers & shown, ~inliers & shown
    found: list[Mark] = [Points(x[fitted], y[fitted], sizes[fitted], "circle", BLUE, WHITE)]
    if astray.any():
        found.append(Points(x[astray], y[astray], 1.4 * sizes[astray], "cross", ORANGE, BLACK))
    return found


def _flat(tangent: FloatArray, cosine: FloatArray) -> FloatArray:
    """Lambert's projection: radius √2 · sin(angle / 2) · √2, so that 90° is √2."""
    sine = np.linalg.norm(tangent, axis=1)
    radius = np.sqrt(np.maximum(2.0 * (1.0 - cosine), 0.0))
    return np.asarray(tangent * (radius / np.maximum(sine, 1e-12))[:, None])


def _sphere(title: str, widest: int, marks: list[Mark], note: str = "") -> Chart:
    """Marks on a sphere that is flattened as far as the ring ``widest``, degrees."""
    rings = *[ring for ring in RINGS if widest / 4 <= ring < widest][-2:], widest
    radii = 2.0 * np.sin(from_deg(np.array(rings, dtype=float)) / 2.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    x, y = (radii[:, None] * each(turn) for each in (np.cos, np.sin))
    cross, corner, rim = np.array([[-1.0, 1.0], [0.0, 0.0]]) * radii[-1], radii * np.sqrt(0.5), 0.8
    behind: list[Mark] = [
        Lines(cross, cross[::-1], 0.7, LINE),
        Lines(x[:-1], y[:-1], rim, GREY),
        Lines(x[-1:], y[-1:], rim, BLACK),
    ]
    # Above the marks, which would make them illegible.
    names = Words(corner, corner, [f"{ring}°" for ring in rings], [BLACK] * len(rings), 8.0, True)
    end = 1.1 * float(radii[-1])
    across, up = (Axis(label, -end, end, names=()) for label in (note, ""))
    return Chart([*behind, *marks, names], across, up, title=title, equal=True, bare=True)


def _unit(vector: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
