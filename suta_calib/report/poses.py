"""What the answers on poses share: rows that were fitted, poses in words, residuals, directions.

Directions on a sphere are flattened by Lambert's azimuthal projection, which keeps areas: crowded
places are crowded on the sphere too; rings tell the angle from the middle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import quaternion_from_rotation, rpy_from_rotation
from suta_calib.model.parameters import PLACEMENT
from suta_calib.plotting.style import BLUE, GREY, ORANGE, WIDTH, plain_log
from suta_calib.pose_calibration.robust_fit import RobustAnswer
from suta_calib.report.document import File, Text
from suta_calib.report.listing import Column, Json, Listing, Row, Table, csv_text, plain, shown_as
from suta_calib.report.svg import shown_array
from suta_calib.units import Unit, deg, from_deg, key, shown, text, unit_name
from suta_calib.words import listed

MOST_OUTLIERS: Final = 10
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
_DIGITS: Final = 6  # of residuals in files
_SPREAD: Final[dict[str, Any]] = {"marker": "o", "facecolor": BLUE, "edgecolor": "white"}
_ASTRAY: Final[dict[str, Any]] = {"marker": "X", "facecolor": ORANGE, "edgecolor": "black"}


# ── rows ─────────────────────────────────────────────────────────────────────────────────────
def residuals_file(
    inliers: BoolArray,
    names: Mapping[str, Sequence[str] | Sequence[int]],
    slides: FloatArray,
    turns: FloatArray | None = None,
) -> File:
    """``residuals.csv``: one row for every row of the input, mm and degrees.

    Args:
        inliers: (n,) rows that were fitted.
        names: what names the rows, (n,) each, such as ``line``.
        slides: (n, 3) residuals, m.
        turns: (n, 3) the same of orientations, rad.
    """
    columns = [Column[int]("row", value=int)]
    columns += [Column(name, value=cells.__getitem__) for name, cells in names.items()]
    vectors: list[tuple[str, Unit, FloatArray]] = [("", "m", slides)]
    vectors += [] if turns is None else [("r", "rad", turns)]
    for prefix, unit, each in vectors:
        parts = [*each.T, np.linalg.norm(each, axis=1)]
        keys = (*(f"{prefix}{axis}" for axis in "xyz"), "norm")
        for name, part in zip(keys, parts, strict=True):
            columns.append(Column(name, value=part.__getitem__, unit=unit))
    columns.append(Column("status", value=lambda k: "inlier" if inliers[k] else "outlier"))
    rows = Listing("", *columns)
    return File("residuals.csv", lambda: csv_text(rows, range(len(inliers)), _DIGITS))


def fitted_rows(found: RobustAnswer, lines: Sequence[int]) -> Json:
    """Outliers and counts, for JSON."""
    count, lost = len(found.inliers), found.outliers
    return {
        "outliers": list(lost),
        "outlier_lines": [lines[row] for row in lost],
        "suspects": [int(row) for row in np.flatnonzero(found.suspects)],
        "counts": {"rows": count, "inliers": count - len(lost), "outliers": len(lost)},
    }


def fit_texts(figures: str, what: str, found: RobustAnswer, lines: Sequence[int]) -> list[Text]:
    """How well the rows agree, and which do not."""
    count, lost = len(found.inliers), found.outliers
    fitted = f"{count - len(lost)} of {count} {what}s fitted"
    if lost:
        rows, s = listed([f"{row} (line {lines[row]})" for row in lost], MOST_OUTLIERS), "s"
        fitted += f"; {len(lost)} outlier{s * (len(lost) > 1)}: row{s * (len(lost) > 1)} {rows}"
    return [Text(figures), Text(fitted)]


# ── poses ────────────────────────────────────────────────────────────────────────────────────
# Of a label and four texts.
_CELLS: Final[list[Callable[[tuple[str, ...]], str]]] = [itemgetter(k) for k in range(5)]
_POSE: Final = Listing("", Column("", "", _CELLS[0]), *(shown_as("", c) for c in _CELLS[1:]))


def pose_table(title: str, pose: FloatArray, std: FloatArray, axes: str) -> Table:
    """A pose (4, 4), m, in words: position, roll pitch yaw, quaternion.

    ``std`` (6,) is of its position, m, and of a small turn about ``axes``, rad.
    """
    rpy, quaternion = rpy_from_rotation(pose[:3, :3]), quaternion_from_rotation(pose[:3, :3])
    rows = (
        ("position x y z, mm", *(text(v, "m") for v in pose[:3, 3]), ""),
        ("  ± std", *(text(v, "m") for v in std[:3]), ""),
        ("roll pitch yaw, deg", *(text(v, "rad") for v in rpy), ""),
        (f"  ± turn about {axes}", *(text(v, "rad") for v in std[3:]), ""),
        ("quaternion x y z w", *(f"{round(v, 6) + 0.0:.6f}" for v in quaternion.tolist())),
    )
    return _POSE.of(rows, title)


def axes_with_std(
    position: Callable[[Row], FloatArray], std: Callable[[Row], FloatArray]
) -> tuple[Column[Row], ...]:
    """Columns x, y, z that show each coordinate of a row's place ± its standard deviation, mm."""

    def cell(k: int) -> Callable[[Row], str]:
        return lambda row: f"{text(position(row)[k], 'm')} ± {text(std(row)[k], 'm')}"

    return tuple(shown_as(axis, cell(k)) for k, axis in enumerate("xyz"))


def pose_record(pose: FloatArray, prefix: str = "") -> Json:
    """A pose (4, 4), m, as JSON has it beside the matrix."""
    R = pose[:3, :3]
    return {
        f"{prefix}position_mm": plain(pose[:3, 3], "m"),
        f"{prefix}rpy_deg": plain(rpy_from_rotation(R), "rad"),
        f"{prefix}quaternion_xyzw": plain(quaternion_from_rotation(R)),
    }


def pose_std_record(std: FloatArray) -> Json:
    """Standard deviations (6,) of a pose, m and rad, as JSON has them."""
    units: tuple[Unit, ...] = ("m", "m", "m", "rad", "rad", "rad")
    return {
        key(name, unit): plain(value, unit)
        for name, unit, value in zip(PLACEMENT, units, std, strict=True)
    }


def covariance_record(matrix: FloatArray, order: Sequence[str], unit: str) -> Json:
    """A covariance as JSON has it."""
    return {"order": list(order), "unit": unit, "matrix": plain(matrix)}


# ── pictures ─────────────────────────────────────────────────────────────────────────────────
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
