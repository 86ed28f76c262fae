"""Pictures of a residual map: left-out errors, the map over two joints, curves of joints."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from suta_calib.analysis.residual_map.result import JointCurve, ResidualMap
from suta_calib.arrays import FloatArray
from suta_calib.plotting import BLUE, GREY, WIDTH, draw_histogram
from suta_calib.plotting.look import TINT
from suta_calib.units import deg, mm, unit_name

# Points along each side of the map.
GRID: Final = 81
# Panels of joints beside each other, and heights of the rows of panels, inch.
COLUMNS: Final = 3
TOP: Final = 4.0
ROW: Final = 2.2


def size_of(residual_map: ResidualMap) -> tuple[float, float]:
    """Width and height of the picture, inch."""
    rows = (len(residual_map.curves) + COLUMNS - 1) // COLUMNS
    return 1.35 * WIDTH, TOP + ROW * rows


def draw_residual_map(figure: Any, residual_map: ResidualMap) -> list[Any]:
    """Left-out errors before and after, the correction over two joints, and joints' curves.

    Args:
        figure: an empty `Figure` or `SubFigure`.
        residual_map: what is drawn.

    Returns:
        Its panels.
    """
    curves = residual_map.curves
    rows = (len(curves) + COLUMNS - 1) // COLUMNS
    above, below = figure, None
    if rows:
        above, below = figure.subfigures(2, 1, height_ratios=[TOP, rows * ROW])
    first, second = above.subplots(1, 2)
    drawn = residual_map.chosen or residual_map.best
    draw_histogram(first, *drawn.tests[0].sizes, "m", "left-out")
    _map(above, second, residual_map)
    panels = [first, second]
    if below is not None:
        grid = below.subplots(rows, COLUMNS, squeeze=False).reshape(-1)
        for axes, curve in zip(grid, curves, strict=False):
            _curve(axes, curve, residual_map)
            panels.append(axes)
        for axes in grid[len(curves) :]:
            axes.set_axis_off()
    return panels


def _shown(curve_unit: str, values: FloatArray) -> FloatArray:
    """Readings in degrees, or mm."""
    return np.asarray(mm(values) if curve_unit == "m" else deg(values))


def _map(figure: Any, axes: Any, residual_map: ResidualMap) -> None:
    """Length of the correction over the two joints that change it most, others as they were."""
    q = residual_map.residuals.q
    first, second = _two(residual_map)
    names = residual_map.arm.own_joints
    columns = [residual_map.arm.joints.index(names[k]) for k in (first, second)]
    sides = [np.linspace(q[:, k].min(), q[:, k].max(), GRID) for k in (first, second)]
    readings = np.zeros((GRID * GRID, len(residual_map.arm.joints)))
    for k, name in enumerate(names):
        readings[:, residual_map.arm.joints.index(name)] = np.median(q[:, k])
    u, v = (side.reshape(-1) for side in np.meshgrid(*sides))
    readings[:, columns[0]], readings[:, columns[1]] = u, v
    size = mm(np.linalg.norm(residual_map.correction(readings), axis=1)).reshape(GRID, GRID)
    units = [residual_map.arm.units[names[k]] for k in (first, second)]
    x, y = (_shown(unit, side) for unit, side in zip(units, sides, strict=True))
    filled = axes.pcolormesh(x, y, size, cmap="Blues", shading="gouraud", rasterized=True)
    shown_angles = (_shown(unit, q[:, k]) for unit, k in zip(units, (first, second), strict=True))
    look: dict[str, Any] = {"color": "black", "ms": 1.5, "alpha": 0.5, "rasterized": True}
    axes.plot(*shown_angles, ".", label="measured postures", **look)
    axes.set_xlabel(f"{names[first]}, {unit_name(units[0])}")
    axes.set_ylabel(f"{names[second]}, {unit_name(units[1])}")
    bar = figure.colorbar(filled, ax=axes)
    bar.set_label("correction of the tip, mm")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize=7, markerscale=4)


def _two(residual_map: ResidualMap) -> tuple[int, int]:
    """The two joints, by their place in ``own_joints``, along which the correction changes most."""
    names = residual_map.arm.own_joints
    if len(residual_map.curves) > 1:
        first, second = (names.index(curve.joint) for curve in residual_map.curves[:2])
        return first, second
    order = list(np.argsort(-np.ptp(residual_map.residuals.q, axis=0)))
    if residual_map.chosen is not None:
        process = residual_map.chosen.process
        ranges = process.width / process.length
        order = [int(k) for k in process.columns[np.argsort(-ranges)]] + order
    ranked = list(dict.fromkeys(int(k) for k in order))
    return ranked[0], ranked[1] if len(ranked) > 1 else ranked[0]


def _curve(axes: Any, curve: JointCurve, residual_map: ResidualMap) -> None:
    x = _shown(curve.unit, curve.reading)
    middle, std = (_shown(curve.unit, part) for part in (curve.correction, curve.std))
    axes.fill_between(x, middle - 2 * std, middle + 2 * std, color=TINT, label="± 2 standard dev.")
    axes.plot(x, middle, color=BLUE, lw=1.2)
    axes.axhline(0.0, color=GREY, lw=0.8)
    column = residual_map.arm.own_joints.index(curve.joint)
    angle = _shown(curve.unit, residual_map.residuals.q[:, column])
    # Of the readings below a curve.
    axes.plot(
        angle,
        np.full(len(angle), axes.get_ylim()[0]),
        "|",
        rasterized=True,
        color="black",
        ms=4,
        mew=0.4,
    )
    axes.set_title(curve.joint, fontsize=8)
    axes.set_xlabel(f"reading, {unit_name(curve.unit)}", fontsize=7)
    axes.set_ylabel(f"correction, {unit_name(curve.unit)}", fontsize=7)
    axes.tick_params(labelsize=7)
