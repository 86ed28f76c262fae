"""Report of a certified artefact: its landmarks, their uncertainty, and deviations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse
from matplotlib.patheffects import withStroke

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.certification.comparison import DrawingComparison, OverGround
from suta_calib.certification.result import (
    Certification,
    CertifiedLandmark,
    Fault,
    PlaneQuality,
    SpacerLength,
    frame_sentence,
    noise_source,
)
from suta_calib.plotting.look import BLUE, GREY, ORANGE, OUTLIER, WIDTH, round_down
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Json, Listing, components, shown_as, written
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import deg, mm, um

NAME: Final = "certify"
# Significant decimals of lengths, mm, and angles, deg, of an instrument.
_FINE: Final = ".4f"
_TURN: Final = ".3f"
_PILLARS: Final = (
    "flat to: largest distance of a touch from the plane of the top; uneven: distance between the "
    "middles of the two diagonals of the holes; 0-2, 1-3: lengths of these diagonals; flats: "
    "distance between the flats."
)
MARKERS: Final[tuple[dict[str, Any], ...]] = (
    {"marker": "o", "color": BLUE},
    {"marker": "s", "color": ORANGE, "markeredgecolor": "black", "markeredgewidth": 0.6},
    {"marker": "^", "color": "black"},
)


# ── rows ─────────────────────────────────────────────────────────────────────────────────────
@dataclass(frozen=True, eq=False)
class Drawn:
    """A landmark of the drawing: its place, (3,), m, and certified less drawn, m and rad."""

    position: FloatArray
    deviation: FloatArray
    turn: float


@dataclass(frozen=True, eq=False)
class Judged:
    """A landmark, why it is called damaged, and what was drawn."""

    mark: CertifiedLandmark
    faults: tuple[Fault, ...]
    drawn: Drawn | None

    @property
    def label(self) -> str:
        """Its name, and whether it is damaged."""
        return f"{self.mark.name} (damaged)" if self.faults else self.mark.name


def _rows(certification: Certification) -> list[Judged]:
    drawn: dict[str, Drawn] = {}
    if (compared := certification.comparison) is not None:
        for mark, off, turn in zip(
            certification.landmarks, compared.deviation, compared.turn, strict=True
        ):
            if mark.name in compared.drawing.landmarks:
                place = compared.drawing.landmark(mark.name).position
                drawn[mark.name] = Drawn(place, off, float(turn))
    return [
        Judged(
            mark,
            tuple(fault for fault in certification.faults if fault.landmark == mark.name),
            drawn.get(mark.name),
        )
        for mark in certification.landmarks
    ]


def _micrometres(heading: str, value: Callable[[Judged], float], form: str) -> Column[Judged]:
    return shown_as(heading, lambda row: f"{um(value(row)):{form}}")


TOP: Final = Listing[CertifiedLandmark](
    "",
    *written("tilt", "tilt_std", unit="rad"),
    *written("flatness", unit="m"),
    *written("touches", "wrong_touches"),
)
HOLES: Final = Listing[CertifiedLandmark](
    "",
    Column("middles_apart", value=lambda mark: mark.symmetry, unit="m"),
    Column("diagonals", unit="m"),
)
DRAWN: Final = Listing[Drawn](
    "",
    *written("position", "deviation", unit="m"),
    Column("distance", value=lambda drawn: np.linalg.norm(drawn.deviation), unit="m"),
    Column("turn", unit="rad"),
)
FAULTS: Final = Listing[Fault]("", Column("what"), *written("size", "limit", unit="m"))
# ``std`` is of each coordinate in the artefact's frame; ``shape_std`` after best superposition, as
# distances see it.
LANDMARKS: Final = Listing[Judged](
    "Landmarks",
    Column("landmark", "landmark", lambda row: row.mark.name, cell=lambda row: row.label),
    *components(("x, mm", "y, mm", "z, mm"), lambda row: row.mark.position, "m", form=_FINE),
    _micrometres("σ, µm", lambda row: row.mark.sigma, ".2f"),
    Column("", "turn, deg", lambda row: row.mark.yaw, "rad", form=_TURN),
    Column("", "tilt, deg", lambda row: row.mark.tilt, "rad", form=_TURN),
    Column("position", None, lambda row: row.mark.position + 0.0, "m"),
    *(c.over(lambda row: row.mark) for c in written("std", "shape_std", "sigma", unit="m")),
    *(c.over(lambda row: row.mark) for c in written("rotation_rpy", "yaw_std", unit="rad")),
    Column("height", None, lambda row: row.mark.position[2], "m"),
    Column("height_std", None, lambda row: row.mark.std[2], "m"),
    Column("top", None, lambda row: TOP.record(row.mark)),
    Column("holes", None, lambda row: HOLES.record(row.mark)),
    Column("flats", None, lambda row: row.mark.flats, "m"),
    Column("nominal", None, lambda row: row.drawn and DRAWN.record(row.drawn)),
    Column("damaged", None, lambda row: bool(row.faults)),
    Column("faults", None, lambda row: FAULTS.records(row.faults)),
    key="landmarks",
    named=True,
)
PILLARS: Final = Listing[Judged](
    "Pillars",
    LANDMARKS.columns[0],
    _micrometres("σ x, µm", lambda row: row.mark.std[0], ".2f"),
    _micrometres("σ y, µm", lambda row: row.mark.std[1], ".2f"),
    _micrometres("σ z, µm", lambda row: row.mark.std[2], ".2f"),
    _micrometres("flat to, µm", lambda row: row.mark.flatness, ".1f"),
    _micrometres("uneven, µm", lambda row: row.mark.symmetry, ".1f"),
    *components(("0-2, mm", "1-3, mm"), lambda row: row.mark.diagonals, "m", form=_FINE),
    Column("", "flats, mm", lambda row: row.mark.flats, "m", form=_FINE),
)
DEVIATIONS: Final = Listing[Judged](
    "Certified minus drawn",
    LANDMARKS.columns[0],
    # Rounded first: a −0.0000 would suggest a direction that is not there.
    *components(
        ("dx, mm", "dy, mm", "dz, mm"),
        lambda row: row.drawn and np.round(row.drawn.deviation, 7),
        "m",
        sign=True,
        form=_FINE,
    ),
    Column(
        "", "length, mm", lambda row: row.drawn and DRAWN.columns[2].of(row.drawn), "m", form=_FINE
    ),
    Column("", "turn, deg", lambda row: row.drawn and row.drawn.turn + 0.0, "rad", form=_TURN),
)
# A spacer, and half the interval that holds it with 95 %, m.
SPACERS: Final = Listing[tuple[SpacerLength, float]](
    "Spacers",
    Column("name", "spacer", lambda row: row[0].name),
    Column("length", "length, mm", lambda row: row[0].length, "m", form=_FINE),
    Column("std", None, lambda row: row[0].std, "m"),
    Column("u95", "± 95 %, mm", lambda row: row[1], "m", form=_FINE),
    Column("nominal", "nominal, mm", lambda row: row[0].nominal, "m", form=_FINE),
    Column("deviation", "off by, mm", lambda row: row[0].deviation, "m", sign=True, form=_FINE),
    key="spacers",
)
PLANE: Final = Listing[PlaneQuality](
    "",
    Column("touches", value=lambda plane: plane.count),
    *written("rms", "flatness", unit="m"),
    Column("direction_std", value=lambda plane: plane.tilt_std, unit="rad"),
    Column("wrong_touches"),
)
FRAME: Final = Listing[Certification](
    "",
    Column("definition", value=frame_sentence),
    Column("origin"),
    Column("x", value=lambda row: row.heading),
    Column("quarter_turns", value=lambda row: row.turned),
    Column("x_std", value=lambda row: row.heading_std, unit="rad"),
)
NOISE: Final = Listing[Certification](
    "",
    Column("sigma", value=lambda row: row.noise, unit="m"),
    Column("stated", value=lambda row: row.stated_noise, unit="m"),
    Column("degrees_of_freedom", value=lambda row: row.freedom),
    Column("coverage_factor"),
    Column("holes", value=lambda row: row.probing.of("hole"), unit="m"),
    Column("side", value=lambda row: row.side and row.probing.of("side"), unit="m"),
)
COMPARISON: Final = Listing[DrawingComparison](
    "",
    Column("drawing", value=lambda row: row.drawing.name),
    Column("T_drawing_artefact", value=lambda row: row.registration.matrix),
    Column("rms", unit="m"),
    Column("max", value=lambda row: row.largest, unit="m"),
    *written("not_drawn", "not_touched"),
)
OVER_GROUND: Final = Listing[OverGround](
    "",
    Column("height", unit="m"),
    Column("height_std", value=lambda row: row.std[0], unit="m"),
    Column("tilt", unit="rad"),
    Column("tilt_std", value=lambda row: row.std[1:], unit="rad"),
)
CERTIFICATION: Final = Listing[Certification](
    "",
    *written("name", "points"),
    Column("frame", value=FRAME.record),
    Column("ground", value=lambda row: PLANE.record(row.ground)),
    Column("side", value=lambda row: row.side and PLANE.record(row.side)),
    Column("noise", value=NOISE.record),
    Column("comparison", value=lambda f: f.comparison and COMPARISON.record(f.comparison)),
    Column("over_ground", value=lambda f: f.over_ground and OVER_GROUND.record(f.over_ground)),
    Column("tolerance", unit="m"),
    *written("damaged", "wrong_touches"),
)


def certification_document(certification: Certification) -> Document:
    """Positions, pillars, deviations from the drawing, spacers, noise; every number in JSON."""
    rows = _rows(certification)
    parts: list[Part] = [
        Figure(partial(certification_plot, certification)),
        LANDMARKS.of(rows),
        PILLARS.of(rows, place="page"),
        Text(_PILLARS, place="page"),
    ]
    if certification.comparison is not None:
        title = f"{DEVIATIONS.title} ({certification.comparison.drawing.name}), best superposition"
        parts.append(DEVIATIONS.of(rows, title))
    parts.append(
        SPACERS.of(
            (spacer, certification.coverage_factor * spacer.std) for spacer in certification.spacers
        )
    )
    parts += [Text(line) for line in _facts(certification)]
    covariance: Json = {
        "landmarks": [mark.name for mark in certification.landmarks],
        "unit": "mm²; x y z of each landmark",
        "matrix": mm(mm(certification.covariance)),
    }
    data = CERTIFICATION.record(certification) | {"covariance": covariance}
    return Document(
        NAME, f"Certification of {certification.name}", certification.assessment, parts, data
    )


def _facts(certification: Certification) -> list[str]:
    ground = certification.ground
    facts = [
        f"Frame: {frame_sentence(certification)}",
        f"One touched coordinate scatters by {um(certification.noise):.2f} µm "
        f"({noise_source(certification)}); 95 % intervals are ± "
        f"{certification.coverage_factor:.2f} σ. The σ above is the largest of a landmark's three "
        "coordinates; artefact.yaml has this value for each landmark.",
        f"Ground: {ground.count} touches, {um(ground.rms):.1f} µm RMS, flat to "
        f"{um(ground.flatness):.1f} µm.",
    ]
    if (holes := certification.probing.by_kind.get("hole")) is not None:
        facts[1] += (
            f" Touches of holes scatter by {um(holes.sigma):.2f} µm, estimated from the distance "
            f"between the middles of their diagonals ({holes.freedom} degrees of freedom)."
        )
    if certification.side is not None:
        facts[-1] += (
            f" Side: {certification.side.count} touches, {um(certification.side.rms):.1f} µm RMS; "
            f"the direction of x is known to {deg(certification.heading_std):.5f}°."
        )
    return facts


# ── the artefact from above, and every landmark's coordinates with their uncertainty ─────────
def certification_plot(certification: Certification) -> str:
    """An SVG: the artefact from above, and below it numbers by landmark."""
    with picture(NAME, (WIDTH, 8.2)) as figure:
        above, below = figure.subplots(2, 1, height_ratios=(1.9, 1))
        _from_above(above, certification)
        _by_landmark(below, certification)
        what = f"The {len(certification.landmarks)} landmarks of {certification.name} from above"
        against = (
            "" if certification.comparison is None else " and their deviations from the drawing"
        )
        return svg_text(figure, NAME, what + against)


def _from_above(axes: Axes, certification: Certification) -> None:
    places = np.array([mark.position for mark in certification.landmarks])
    damaged = np.array([mark.name in certification.damaged for mark in certification.landmarks])
    # The longest arrow or ellipse, m: a part of the artefact's extent.
    most = 0.15 * (float(np.ptp(places[:, :2], axis=0).max()) or 1.0)
    if certification.comparison is None:
        factor = _ellipses(axes, certification, places, most)
        title = f"95 % ellipses, enlarged {factor:g} times"
    else:
        factor, shortened = _arrows(axes, certification.comparison, places, ~damaged, most)
        cut = "; the longest shortened" * shortened
        title = f"Certified minus drawn, enlarged {factor:g} times{cut}"
    _marks(axes, certification, places, damaged)
    # Two lines leave room for the legend.
    axes.set_title("From above\n" + title)
    axes.set_xlabel("x, mm (numbers beside the landmarks: heights, mm)")
    axes.set_ylabel("y, mm")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.14)
    axes.grid()


def _marks(axes: Axes, certification: Certification, places: FloatArray, bad: BoolArray) -> None:
    x, y = mm(places[:, 0]), mm(places[:, 1])
    axes.plot(x[~bad], y[~bad], "o", color=BLUE, ms=5, label="landmark")
    if bad.any():
        damaged: dict[str, Any] = OUTLIER | {"ms": 10, "mew": 0.8}
        axes.plot(x[bad], y[bad], label="damaged or badly touched", **damaged)
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), fontsize=8, borderaxespad=0.2)
    falls = (
        np.zeros(len(x))
        if certification.comparison is None
        else certification.comparison.deviation[:, 1]
    )
    for mark, across, up, fall in zip(certification.landmarks, x, y, falls, strict=True):
        # Clear of an arrow that points down.
        drop, align = (3, "bottom") if fall < 0 else (-3, "top")
        label = f"{mark.name}\n{mm(mark.position[2]):.1f}"
        halo = [withStroke(linewidth=2, foreground="white")]
        look: dict[str, Any] = {"fontsize": 7, "va": align, "zorder": 4, "path_effects": halo}
        axes.annotate(label, (across, up), (7, drop), textcoords="offset points", **look)


def _ellipses(axes: Axes, certification: Certification, places: FloatArray, most: float) -> float:
    """Confidence ellipses in the plane, and how much they are enlarged."""
    # 95 % of two dimensions: √χ²(2).
    scale = certification.coverage_factor * 1.249
    blocks = [
        certification.covariance[3 * k : 3 * k + 2, 3 * k : 3 * k + 2] for k in range(len(places))
    ]
    variance, directions = np.linalg.eigh(blocks)
    half = scale * np.sqrt(np.maximum(variance, 0.0))
    factor = round_down(most / 2 / half.max()) if half.any() else 1.0
    look: dict[str, Any] = {"facecolor": "none", "edgecolor": GREY, "lw": 1.2}
    for place, (height, width), axis in zip(places, mm(2 * factor * half), directions, strict=True):
        turn = deg(float(np.arctan2(axis[1, 1], axis[0, 1])))
        axes.add_patch(Ellipse(tuple(mm(place[:2])), width, height, angle=turn, **look))
    return factor


def _arrows(
    axes: Axes, comparison: DrawingComparison, places: FloatArray, sound: BoolArray, most: float
) -> tuple[float, bool]:
    """Deviations in the plane; a damaged pillar's may be longer than the others'."""
    turned = (comparison.deviation @ comparison.registration.rotation)[:, :2]
    finite = np.isfinite(turned[:, 0])
    judged = turned[finite & sound] if (finite & sound).any() else turned[finite]
    longest = float(np.linalg.norm(judged, axis=1).max())
    factor = round_down(most / longest) if longest > 0 else 1.0
    vectors = turned[finite] * factor
    # An arrow out of the picture would hide the others; its number is in the table.
    length = np.linalg.norm(vectors, axis=1)
    shorten = np.minimum(1.0, 2 * most / np.maximum(length, 1e-12))
    axes.quiver(
        *mm(places[finite, :2].T), *mm(vectors * shorten[:, None]).T,
        angles="xy", scale_units="xy", scale=1.0, width=0.004, color="black", zorder=3,
    )  # fmt: skip
    return factor, bool((shorten < 1).any())


def _by_landmark(axes: Axes, certification: Certification) -> None:
    names = [mark.name for mark in certification.landmarks]
    at = np.arange(len(names))
    if certification.comparison is None:
        values = um(np.array([mark.std for mark in certification.landmarks]))
        bars = np.zeros_like(values)
        axes.set_title("Standard deviation of each coordinate")
        axes.set_ylabel("σ, µm")
        axes.set_ylim(-0.08 * float(values.max()), 1.15 * float(values.max()))
    else:
        values = mm(certification.comparison.deviation)
        std = np.array([mark.shape_std for mark in certification.landmarks])
        bars = mm(certification.coverage_factor * std)
        axes.axhline(0.0, color=GREY, lw=1)
        axes.set_title("Certified minus drawn, with 95 % intervals")
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
