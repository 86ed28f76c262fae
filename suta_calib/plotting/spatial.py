"""A scene on three-dimensional axes, in mm."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from suta_calib.plotting.look import BLUE, GREY, ORANGE
from suta_calib.plotting.scene import Arrows, Line, Look, PlacedPoints, Scene
from suta_calib.plotting.style import axes_or_new
from suta_calib.units import mm

_LOOKS: Final[dict[Look, dict[str, Any]]] = {
    "links": {"color": "black", "linewidth": 2.2, "marker": "o", "markersize": 3.5},
    "axes": {"color": BLUE, "linewidth": 2.6},
    "tip": {"color": ORANGE, "marker": "v", "markersize": 7, "markeredgecolor": "black"},
    "touched": {"color": GREY, "marker": ".", "markersize": 3},
    "place": {"color": "black", "marker": "+", "markersize": 7},
    "before": {"color": ORANGE, "linewidth": 0.8},
    "after": {"color": BLUE, "linewidth": 0.9},
    "grid": {"color": GREY, "linewidth": 0.5},
    "frame": {"color": "black", "linewidth": 1.0},
}


def draw_scene(scene: Scene, ax: Axes | None = None) -> Any:
    """Draw a scene.

    Args:
        scene: what is drawn.
        ax: three-dimensional axes; those of a new figure by default.

    Returns:
        The `Axes3D`. Every part is an artist whose label is the part's name; arrows are a
        `Line3DCollection` of segments, labelled with their factor.

    Raises:
        ValueError: axes that are not three-dimensional.
    """
    size = (6.5, 4.6)
    axes = axes_or_new(ax, size, "3d")
    for part in scene.parts:
        look = _LOOKS[part.look]
        if isinstance(part, Arrows):
            _arrows(axes, part, look)
        else:
            line = {} if isinstance(part, Line) else {"linestyle": "none"}
            axes.plot(*mm(part.points).T, label=part.name, **look, **line)
        if isinstance(part, PlacedPoints):
            for place, label in zip(mm(part.points), part.labels, strict=False):
                axes.text(*place, f" {label}", fontsize=7)
    _frame(axes, scene)
    return axes


def _arrows(axes: Any, part: Arrows, look: dict[str, Any]) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    times = f", × {part.factor:g}" if part.factor != 1 else ""
    lines = Line3DCollection(
        mm(np.stack([part.points, part.ends], axis=1)),
        colors=look["color"],
        linewidths=look["linewidth"],
        label=f"{part.name}{times}",
    )
    # `_frame` sets the limits, which `add_collection3d` of Matplotlib 3.7 cannot be told.
    axes.add_collection(lines, autolim=False)


def _frame(axes: Any, scene: Scene) -> None:
    """Axes alike in every direction, about what is drawn."""
    low, high = mm(scene.extent)
    if np.isfinite(low).all():
        # A flat scene has some depth too.
        least = 0.15 * max(float((high - low).max()), 1.0)
        half = 1.05 * np.maximum((high - low) / 2, least)
        for name, centre, span in zip("xyz", (low + high) / 2, half, strict=True):
            getattr(axes, f"set_{name}lim")(centre - span, centre + span)
        axes.set_aspect("equal")
    for name in "xyz":
        getattr(axes, f"set_{name}label")(f"{name}, mm")
        getattr(axes, f"{name}axis").set_major_locator(_ticks())
    axes.legend(loc="upper left", bbox_to_anchor=(-0.35, 1.0), fontsize=8, frameon=False)


def _ticks() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(4, steps=[1, 2, 5, 10])
