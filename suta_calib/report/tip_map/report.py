"""How sure the tip is over the workspace: as JSON, for a terminal, and as a section."""

from __future__ import annotations

import math
from typing import Any, Final

from rich.console import Group, RenderableType
from rich.text import Text as RichText

from suta_calib.analysis.tip_map import THRESHOLDS, Figures, TipMap
from suta_calib.assessment import Assessment
from suta_calib.report.console import bullet, number_table, plain_table, verdict_lines
from suta_calib.report.sections import Plot, Section, Table, Text
from suta_calib.report.tip_map.plots import tip_map_figure
from suta_calib.units import SHOWN, unit_name

MM: Final = 1e3
Json = dict[str, Any]
HEADS: Final = ("", "RMS", "median", "95 %", "max", "≤ 0.3", "≤ 0.5")
# Figures of other instruments, mm, as the field quotes them; each is of another kind.
FIELD: Final = (
    ("optical tracking", 0.30, "RMS often quoted for optical navigation; not measured here"),
    ("electromagnetic tracking", 0.48, "RMS often quoted for EM navigation; not measured here"),
    ("mechanical CMM arm", 0.024, "maximum permissible error (ISO 10360-12): a limit, no spread"),
)
OURS: Final = "predicted 3-D RMS, this calibration's part only, after registration"
# An open direction that moves the registered tip by less than this part of what is told is nothing.
_NOTHING: Final = 0.05
_WHAT: Final = (
    "Standard uncertainty of the tip's position in three dimensions that the calibration's "
    "covariance gives. Not in it: encoder noise, seating, compliance, what the registration's own "
    "touches scatter, and what the model lacks. Registered: after a rigid registration at the "
    "place named ('plan' fits over its whole region instead); absolute: in the base frame, with "
    "held parameters taken as exact."
)


def tip_map_dict(found: TipMap, tolerance: float | None = None) -> Json:
    """Figures over the region, the sections as grids, what was held, and the field's figures."""
    return {
        "registered": _figures(found.registered),
        "absolute": _figures(found.absolute),
        "region": {
            "lower_mm": (MM * found.region.lower).tolist(),
            "upper_mm": (MM * found.region.upper).tolist(),
            "tool_axis": found.region.axis.tolist(),
            "cone_deg": math.degrees(found.region.cone),
        },
        "registration": {"place_mm": (MM * found.place).tolist(), "points": found.registration},
        "held": [_fixed(found, k) for k in range(len(found.open_directions))],
        "sections": {
            each.name: {
                "origin_mm": (MM * each.origin).tolist(),
                "along": each.along.tolist(),
                "up": each.up.tolist(),
                "u_mm": (MM * each.u).tolist(),
                "v_mm": (MM * each.v).tolist(),
                "registered_mm": (MM * each.registered).tolist(),
                "absolute_mm": (MM * each.absolute).tolist(),
            }
            for each in found.sections
        },
        "field": [{"what": what, "value_mm": value, "kind": kind} for what, value, kind in FIELD],
        "tolerance_mm": None if tolerance is None else MM * tolerance,
        "verdict": tip_map_verdict(found, tolerance).as_dict(),
    }


def tip_map_verdict(found: TipMap, tolerance: float | None = None) -> Assessment:
    """How sure the tip is, whether that is enough, and what it does not say."""
    rms = found.registered.rms
    sentence = (
        f"The calibration leaves the tip sure to {MM * rms:.3f} mm (3-D RMS in the region, after "
        f"registration; 95 % within {MM * found.registered.p95:.3f} mm)"
    )
    bad = []
    if tolerance is not None and rms > tolerance:
        bad.append(f"That is more than the {MM * tolerance:.3g} mm asked for.")
    caution = _open_notes(found)
    if rms > THRESHOLDS[-1]:
        caution.append(f"Laboratories ask for {_limits()} mm of the whole navigation system.")
    return Assessment.of(sentence, bad=bad, care=caution)


def tip_map_tables(found: TipMap, tolerance: float | None = None) -> RenderableType:
    """For a terminal of 80 columns."""
    figures = number_table("Uncertainty of the tip in the region, mm, and share within", *HEADS)
    for row in figure_rows(found):
        figures.add_row(*row)
    field = plain_table("Beside others: figures of different kinds")
    for head in ("", "mm", "what the figure is"):
        field.add_column(head, justify="right" if head == "mm" else "left")
    for row in field_rows(found):
        field.add_row(*(RichText(cell) for cell in row))
    lines = verdict_lines(tip_map_verdict(found, tolerance))
    return Group(*lines, "", figures, "", field, "", bullet(_where(found)), bullet(_WHAT))


def tip_map_section(found: TipMap, tolerance: float | None = None) -> Section:
    """Verdict, the map over the arm, figures, and the field's beside them."""
    return Section(
        name="tip_map",
        title="How sure the tip is",
        assessment=tip_map_verdict(found, tolerance),
        parts=[
            Plot(tip_map_figure(found), "Uncertainty of the tip after registration, mm"),
            Text(_where(found)),
            Table(HEADS, figure_rows(found), frozenset(range(1, 7)), "In the region, mm"),
            Table(
                ("", "mm", "what the figure is"),
                field_rows(found),
                frozenset({1}),
                "Beside others: figures of different kinds",
            ),
            Text(_WHAT),
        ],
    )


def figure_rows(found: TipMap) -> list[list[str]]:
    """Cells of the figures over the region."""
    rows = []
    for name, figures in (("registered", found.registered), ("absolute", found.absolute)):
        sizes = (figures.rms, figures.median, figures.p95, figures.maximum)
        shares = [f"{100 * share:.0f} %" for share in figures.within]
        rows.append([name, *(f"{MM * size:.3f}" for size in sizes), *shares])
    return rows


def field_rows(found: TipMap) -> list[list[str]]:
    """Ours first, then the field's."""
    ours = ["this arm", f"{MM * found.registered.rms:.3g}", OURS]
    return [ours, *([what, f"{value:g}", kind] for what, value, kind in FIELD)]


def _figures(figures: Figures) -> Json:
    shares = {
        f"within_{MM * limit:g}mm_pct": 100 * share
        for limit, share in zip(THRESHOLDS, figures.within, strict=True)
    }
    return {
        "rms_mm": MM * figures.rms,
        "median_mm": MM * figures.median,
        "p95_mm": MM * figures.p95,
        "max_mm": MM * figures.maximum,
    } | shares


def _fixed(found: TipMap, k: int) -> Json:
    each = found.open_directions[k]
    unit = found.knowledge.arm.offered[each.fixed].unit
    return {
        "parameter": each.fixed,
        f"plausible_{unit_name(unit)}": SHOWN[unit].per_si * each.plausible,
        "tip_mm": MM * each.effect,
    }


def _open_notes(found: TipMap) -> list[str]:
    notes = []
    for each in found.open_directions:
        if each.effect <= _NOTHING * found.registered.rms:
            continue
        unit = found.knowledge.arm.offered[each.fixed].unit
        size = f"{SHOWN[unit].per_si * each.plausible:.3g} {unit_name(unit)}"
        notes.append(
            f"{each.fixed} is held, not measured, and not in these figures: if it is off by "
            f"{size}, the tip is off by {MM * each.effect:.3g} mm ('plan' says what measures it)."
        )
    return notes


def _where(found: TipMap) -> str:
    low, high = (MM * corner for corner in (found.region.lower, found.region.upper))
    box = ", ".join(
        f"{axis} {a:.0f} … {b:.0f}" for axis, a, b in zip("xyz", low, high, strict=True)
    )
    place = "({:.0f}, {:.0f}, {:.0f})".format(*(MM * found.place))
    return (
        f"Region: {box} mm, tool within {math.degrees(found.region.cone):.0f}° of its usual "
        f"direction. Registered at {found.registration} points about {place} mm."
    )


def _limits() -> str:
    return " to ".join(f"{MM * limit:g}" for limit in THRESHOLDS)
