"""The artefact from above, and every landmark's coordinates with their uncertainty."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.patheffects import withStroke

from suta_calib.arrays import FloatArray
from suta_calib.certification.result import Certification
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, style, svg_text

MM: Final = 1e3
UM: Final = 1e6
# The longest arrow or ellipse, as a part of the artefact's extent.
LONGEST: Final = 0.15
MARKERS: Final[tuple[dict[str, Any], ...]] = (
    {"marker": "o", "color": BLUE},
    {"marker": "s", "color": ORANGE, "markeredgecolor": "black", "markeredgewidth": 0.6},
    {"marker": "^", "color": "black"},
)
DAMAGED: Final[dict[str, Any]] = {
    "marker": "X",
    "color": ORANGE,
    "linestyle": "none",
    "ms": 10,
    "markeredgecolor": "black",
    "markeredgewidth": 0.8,
}


def certification_figure(found: Certification) -> str:
    """An SVG element: the artefact from above, and below it numbers by landmark."""
    with style("certify"):
        figure = Figure(figsize=(WIDTH, 8.2), layout="constrained")
        above, below = figure.subplots(2, 1, height_ratios=(1.9, 1))
        _from_above(above, found)
        _by_landmark(below, found)
        return svg_text(figure, "certify", _description(found))


def _description(found: Certification) -> str:
    against = "" if found.comparison is None else " and their deviations from the drawing"
    return f"The {len(found.landmarks)} landmarks of {found.name} from above{against}"


def _from_above(axes: Axes, found: Certification) -> None:
    places = np.array([mark.position for mark in found.landmarks])
    extent = float(np.ptp(places[:, :2], axis=0).max()) or 1.0
    if found.comparison is None:
        factor = _ellipses(axes, found, places, extent)
        title = f"95 % ellipses, enlarged {factor:g} times"
    else:
        factor, shortened = _arrows(axes, found, places, extent)
        cut = "; the longest shortened" * shortened
        title = f"Certified less drawn, enlarged {factor:g} times{cut}"
    _marks(axes, found, places)
    # Two lines leave room for the legend.
    axes.set_title("From above\n" + title)
    axes.set_xlabel("x, mm (at each landmark: its height, mm)")
    axes.set_ylabel("y, mm")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.14)
    axes.grid()


def _marks(axes: Axes, found: Certification, places: FloatArray) -> None:
    bad = np.array([mark.name in found.damaged for mark in found.landmarks])
    x, y = MM * places[:, 0], MM * places[:, 1]
    axes.plot(x[~bad], y[~bad], "o", color=BLUE, ms=5, label="landmark")
    if bad.any():
        axes.plot(x[bad], y[bad], label="damaged, or touched wrongly", **DAMAGED)
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), fontsize=8, borderaxespad=0.2)
    falls = np.zeros(len(x)) if found.comparison is None else found.comparison.deviation[:, 1]
    for mark, across, up, fall in zip(found.landmarks, x, y, falls, strict=True):
        text = f"{mark.name}\n{MM * mark.position[2]:.1f}"
        # Clear of an arrow that points down.
        drop, align = (3, "bottom") if fall < 0 else (-3, "top")
        axes.annotate(
            text,
            (across, up),
            (7, drop),
            textcoords="offset points",
            fontsize=7,
            va=align,
            zorder=4,
            path_effects=[withStroke(linewidth=2, foreground="white")],
        )


def _ellipses(axes: Axes, found: Certification, places: FloatArray, extent: float) -> float:
    """Confidence ellipses in the plane; the largest is a part of the extent."""
    # 95 % of two dimensions: √χ²(2).
    scale = found.coverage_factor * 1.249
    blocks = [found.covariance[3 * k : 3 * k + 2, 3 * k : 3 * k + 2] for k in range(len(places))]
    axes_of = [np.linalg.eigh(block) for block in blocks]
    longest = max(float(np.sqrt(max(values[-1], 0.0))) for values, _ in axes_of) * scale
    factor = _round_down(LONGEST * extent / 2 / longest) if longest > 0 else 1.0
    for place, (values, vectors) in zip(places, axes_of, strict=True):
        size = 2 * scale * factor * np.sqrt(np.maximum(values, 0.0))
        turn = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
        centre, size = tuple(MM * place[:2]), MM * size
        axes.add_patch(
            Ellipse(centre, size[1], size[0], angle=turn, facecolor="none", edgecolor=GREY, lw=1.2)
        )
    return factor


def _arrows(
    axes: Axes, found: Certification, places: FloatArray, extent: float
) -> tuple[float, bool]:
    """Deviations in the plane; a damaged pillar's may be longer than the others'."""
    assert found.comparison is not None
    turned = found.comparison.deviation @ found.comparison.registration.rotation
    sound = np.array([mark.name not in found.damaged for mark in found.landmarks])
    known = np.isfinite(turned[:, 0])
    judged = turned[known & sound] if (known & sound).any() else turned[known]
    longest = float(np.linalg.norm(judged[:, :2], axis=1).max())
    factor = _round_down(LONGEST * extent / longest) if longest > 0 else 1.0
    vectors = turned[:, :2] * factor
    length = np.linalg.norm(vectors, axis=1)
    # An arrow out of the picture would hide the others; its number is in the table.
    length = np.nan_to_num(length)
    shorten = np.minimum(1.0, 2 * LONGEST * extent / np.maximum(length, 1e-12))
    drawn = (vectors * shorten[:, None])[known]
    axes.quiver(
        *(MM * places[known, :2].T), *(MM * drawn.T),
        angles="xy", scale_units="xy", scale=1.0, width=0.004, color="black", zorder=3,
    )  # fmt: skip
    return factor, bool((shorten < 1).any())


def _round_down(value: float) -> float:
    """1, 2 or 5 times a power of ten."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in (1, 2, 5) if step * decade <= value * (1 + 1e-9)))


def _by_landmark(axes: Axes, found: Certification) -> None:
    names = [mark.name for mark in found.landmarks]
    at = np.arange(len(names))
    if found.comparison is None:
        values = UM * np.array([mark.std for mark in found.landmarks])
        bars = np.zeros_like(values)
        axes.set_title("Standard deviation of each coordinate")
        axes.set_ylabel("σ, µm")
        axes.set_ylim(-0.08 * float(values.max()), 1.15 * float(values.max()))
    else:
        values = MM * found.comparison.deviation
        std = np.array([mark.shape_std for mark in found.landmarks])
        bars = MM * found.coverage_factor * std
        axes.axhline(0.0, color=GREY, lw=1)
        axes.set_title("Certified less drawn, with 95 % intervals")
        axes.set_ylabel("deviation, mm")
    for k, (label, marker) in enumerate(zip("xyz", MARKERS, strict=True)):
        axes.errorbar(
            at + 0.2 * (k - 1), values[:, k], bars[:, k],
            linestyle="none", ms=5, ecolor=GREY, capsize=2, label=label, **marker,
        )  # fmt: skip
    axes.set_xticks(at, names, rotation=90 if len(names) > 20 else 0)
    axes.set_xlabel("landmark")
    axes.grid(axis="y")
    axes.legend(ncols=3, fontsize=8, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.2)
