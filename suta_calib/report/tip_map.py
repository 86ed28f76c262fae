"""Report of the tip's uncertainty over the workspace: figures, and a map over the arm."""

from __future__ import annotations

from functools import partial
from typing import Final

from suta_calib.analysis.tip_map import THRESHOLDS, Figures, OpenDirection, TipMap
from suta_calib.analysis.tip_map_plot import draw_tip_map
from suta_calib.analysis.tip_sections import Slice
from suta_calib.plotting.look import WIDTH
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Listing, plain, written
from suta_calib.report.plan import region_record, region_text
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import mm, shown

NAME: Final = "tip_map"
TITLE: Final = "Uncertainty of the tip"
# Figures of other instruments, mm, as the field quotes them; each is of another kind.
FIELD: Final = (
    ("optical tracking", 0.30, "RMS often quoted for optical navigation; not measured here"),
    ("electromagnetic tracking", 0.48, "RMS often quoted for EM navigation; not measured here"),
    ("mechanical CMM arm", 0.024, "maximum permissible error (ISO 10360-12): a limit, no spread"),
)
OURS: Final = "predicted 3-D RMS after registration, from this calibration only"
_WHAT: Final = (
    "Standard uncertainty of the tip's position in three dimensions, from the calibration's "
    "covariance. It does not include encoder noise, seating, compliance, the scatter of the "
    "registration's touches, and errors of the model. Registered: after a rigid registration at "
    "the place named ('plan' registers over its whole region); absolute: in the base frame, if "
    "fixed parameters are exact."
)


def _within(k: int) -> Column[Figures]:
    """The share of the region within a threshold."""
    limit = f"{mm(THRESHOLDS[k]):g}"

    def cell(figures: Figures) -> str:
        return f"{shown(figures.within[k], '%'):.0f} %"

    return Column(f"within_{limit}mm", f"≤ {limit}", lambda f: f.within[k], "%", cell=cell)


FIGURES: Final = Listing[Figures](
    "",
    Column("rms", "RMS", unit="m"),
    Column("median", "median", unit="m"),
    Column("p95", "95 %", unit="m"),
    Column("max", "max", lambda figures: figures.maximum, "m"),
    *(_within(k) for k in range(len(THRESHOLDS))),
)
BOTH: Final = Listing[tuple[str, Figures]](
    "Uncertainty of the tip in the region, mm, and share within",
    Column("", "", lambda row: row[0]),
    *(c.over(lambda row: row[1]) for c in FIGURES.columns),
)
OTHER_ARMS: Final = Listing[tuple[str, float, str]](
    "Compared with other systems: figures of different kinds",
    Column("what", "", lambda row: row[0]),
    Column("value_mm", "mm", lambda row: row[1], form=".3g"),
    Column("kind", "what the figure is", lambda row: row[2]),
)
HELD: Final = Listing[OpenDirection](
    "",
    Column("parameter", value=lambda row: row.fixed),
    Column("plausible", unit=lambda row: row.unit),
    Column("tip", value=lambda row: row.effect, unit="m"),
)
SECTION: Final = Listing[Slice](
    "",
    *written("along", "up"),
    *written("origin", "u", "v", "registered", "absolute", unit="m"),
)


def tip_map_document(tip_map: TipMap) -> Document:
    """Figures over the region, the map over the arm, and the field's figures beside them."""
    place = "({:.0f}, {:.0f}, {:.0f})".format(*mm(tip_map.place))
    where = (
        f"Region: {region_text(tip_map.region)}. "
        f"Registered at {tip_map.registration} points about {place} mm."
    )
    parts: list[Part] = [
        Figure(partial(tip_map_plot, tip_map), "Uncertainty of the tip after registration, mm"),
        BOTH.of((("registered", tip_map.registered), ("absolute", tip_map.absolute))),
        OTHER_ARMS.of((("this arm", mm(tip_map.registered.rms), OURS), *FIELD)),
        Text(where, bullet=True),
        Text(_WHAT, bullet=True),
    ]
    data = {
        "registered": FIGURES.record(tip_map.registered),
        "absolute": FIGURES.record(tip_map.absolute),
        "region": region_record(tip_map.region),
        "registration": {"place_mm": plain(tip_map.place, "m"), "points": tip_map.registration},
        "held": HELD.records(tip_map.open_directions),
        "sections": {section.name: SECTION.record(section) for section in tip_map.sections},
        "field": OTHER_ARMS.records(FIELD),
        "tolerance_mm": plain(tip_map.tolerance, "m"),
    }
    return Document(NAME, TITLE, tip_map.assessment, parts, data)


def tip_map_plot(tip_map: TipMap, name: str = NAME, *, absolute: bool = False) -> str:
    """An SVG: a vertical and a horizontal section, in mm, after registration or absolute."""
    with picture(name, (1.35 * WIDTH, 5.4)) as figure:
        draw_tip_map(figure, tip_map, absolute=absolute)
        description = "Map of the tip's uncertainty, from the side and from above"
        return svg_text(figure, name, description)
