"""A scene on a page: an SVG that a reader turns about, and a still picture where no script runs.

The SVG stands complete in the page, seen from one side: so it is printed. A script of a few lines,
inline, projects the same points again while they are dragged. Parallel projection: lengths that lie
square to the line of sight compare everywhere.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from jinja2 import Environment

from suta_calib.arrays import FloatArray
from suta_calib.plotting.look import round_down
from suta_calib.plotting.scene import Arrows, Line, Part, PlacedPoints, Scene
from suta_calib.units import from_mm, mm

# From where it is seen at first: about z from x, and above the horizon, degrees.
AZIMUTH: Final = -55.0
ELEVATION: Final = 22.0
WIDTH: Final = 860.0
HEIGHT: Final = 430.0


def scene_html(scene: Scene, name: str, templates: Environment) -> str:
    """A scene as an HTML fragment that needs nothing else, under an id of its page."""
    low, high = mm(scene.extent)
    # About as many cells of the floor's grid across the scene.
    step = round_down(float((high - low).max()) / 8.0 * 2)
    parts = [*_ground(low, high, step), *scene.parts]
    middle = (low + high) / 2
    scale = _fitting(np.concatenate([mm(part.points) for part in parts]) - middle)
    record = {
        "middle": _rounded(middle),
        "scale": scale,
        "view": [math.radians(AZIMUTH), math.radians(ELEVATION)],
        "parts": [_record(part) for part in parts],
    }
    paths = []
    for part in parts:
        at = projected(mm(part.points) - middle, scale)
        ends = projected(mm(part.ends) - middle, scale) if isinstance(part, Arrows) else None
        labels = (
            zip(part.labels, at.tolist(), strict=False) if isinstance(part, PlacedPoints) else ()
        )
        paths.append(
            {
                "look": part.look,
                "name": part.name,
                "factor": f"{part.factor:g}" if isinstance(part, Arrows) else "",
                "d": _path(part, at, ends),
                "labels": [(label, round(x, 1), round(y, 1)) for label, (x, y) in labels],
            }
        )
    # Inside a script element only "</" ends it.
    data = json.dumps(record, separators=(",", ":")).replace("</", "<\\/")
    return templates.get_template("scene.html.j2").render(
        name=name, paths=paths, data=data, width=WIDTH, height=HEIGHT, step=f"{step:g}"
    )


def projected(
    points: FloatArray, scale: float, azimuth: float = AZIMUTH, elevation: float = ELEVATION
) -> FloatArray:
    """Points (n, 3) in the picture (n, 2): to the right and down, as SVG has it.

    Args:
        points: from the middle of the scene, any unit.
        scale: of the picture, pixels per unit.
        azimuth: of the line of sight about z, from x, degrees.
        elevation: of the eye above the horizon, degrees.
    """
    a, e = math.radians(azimuth), math.radians(elevation)
    right = np.array([-math.sin(a), math.cos(a), 0.0])
    up = np.array([-math.sin(e) * math.cos(a), -math.sin(e) * math.sin(a), math.cos(e)])
    return np.asarray(scale * points @ np.column_stack([right, -up]))


def _fitting(points: FloatArray) -> float:
    """Pixels per unit at which points, from the middle, stay in sight however they are turned."""
    points = points[np.isfinite(points).all(axis=1)]
    across = float(np.linalg.norm(points[:, :2], axis=1).max())
    turned = [projected(points, 1.0, azimuth)[:, 1] for azimuth in range(0, 360, 30)]
    upward = float(np.abs(np.concatenate(turned)).max())
    margin = 24.0
    return min((WIDTH / 2 - margin) / across, (HEIGHT / 2 - margin) / upward)


def _ground(low: FloatArray, high: FloatArray, step: float) -> Iterator[Part]:
    """A grid at the height of the base, and the base's axes."""
    first, last = (np.floor(low[:2] / step) * step, np.ceil(high[:2] / step) * step)
    lines = []
    for k in range(2):
        for value in np.arange(first[k], last[k] + step / 2, step):
            ends = np.zeros((3, 3))
            ends[:2, k], ends[:2, 1 - k] = value, (first[1 - k], last[1 - k])
            ends[2] = np.nan
            lines.append(ends)
    yield Line("", "grid", from_mm(np.concatenate(lines)))
    length = 0.08 * float(np.linalg.norm(high - low))
    triad = [np.array([np.zeros(3), length * axis, np.full(3, np.nan)]) for axis in np.eye(3)]
    yield Line("", "frame", from_mm(np.concatenate(triad)))
    yield PlacedPoints("", "frame", from_mm(1.25 * length * np.eye(3)), tuple("xyz"))


def _record(part: Part) -> dict[str, Any]:
    """A part as the script reads it: mm, null between two pieces of a line."""
    record: dict[str, Any] = {"p": _rounded(mm(part.points))}
    if isinstance(part, Arrows):
        record["q"] = _rounded(mm(part.ends))
    elif isinstance(part, Line):
        record["line"] = True
    return record


def _rounded(places: FloatArray) -> list[Any]:
    """Tenths of a millimetre, which no screen resolves; null for what is not a number."""
    values: list[Any] = np.round(places, 1).tolist()
    return [
        None if isinstance(value, list) and not all(map(math.isfinite, value)) else value
        for value in values
    ]


def _path(part: Part, at: FloatArray, ends: FloatArray | None) -> str:
    """What the script writes too: a line, dots as lines of no length, or a line for each arrow."""
    words, drawing = [], False
    for k, (x, y) in enumerate(at.tolist()):
        if not math.isfinite(x):
            drawing = False
            continue
        begin = "L" if drawing and isinstance(part, Line) else "M"
        words.append(f"{begin}{x:.1f} {y:.1f}")
        if ends is not None:
            words.append(f"L{ends[k, 0]:.1f} {ends[k, 1]:.1f}")
        elif not isinstance(part, Line):
            words.append("h0")
        drawing = True
    return "".join(words)
