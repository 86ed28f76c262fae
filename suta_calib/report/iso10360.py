"""Report of an acceptance test: errors and their limits, in tables, JSON and a picture."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from suta_calib.analysis.iso10360 import (
    AcceptanceTest,
    Articulation,
    Characteristic,
    LengthErrors,
    RepeatedVisits,
    SphereProbing,
)
from suta_calib.arrays import FloatArray
from suta_calib.job.limits import LengthLimit, Limits
from suta_calib.plotting.look import BLUE, GREY, LARGE, ORANGE
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Json, Listing, plain, written
from suta_calib.report.svg import picture, svg_text
from suta_calib.trust.accuracy import Metrics
from suta_calib.units import from_mm, mm, text, um

NAME: Final = "iso10360"
STANDARD: Final = "ISO 10360-12:2016"
SYMBOL: Final = {
    "E_Uni": "E_Uni, length",
    "E_Bi": "E_Bi, length",
    "L_Dia": "L_Dia, articulated location",
    "P_Size": "P_Size, sphere",
    "P_Form": "P_Form, sphere",
    "repeatability": "repeatability",
}
# Symbols whose values have a sign.
_SIGNED: Final = ("E_Uni", "E_Bi", "P_Size")
_TITLE: Final = f"Acceptance test after {STANDARD}"


CHARACTERISTICS: Final = Listing[Characteristic](
    _TITLE,
    Column("symbol", "worst of each, mm", cell=lambda row: SYMBOL[row.symbol]),
    Column(
        "value",
        "value",
        unit="m",
        cell=lambda row: text(row.value, "m", sign=row.symbol in _SIGNED),
    ),
    Column("limit", "limit", unit="m"),
    Column("expanded_uncertainty", "U", lambda row: row.expanded, "m"),
    *written("decision", "where"),
    Column("count", "of", form="d"),
    Column("missing", optional=True),
    Column("", "", lambda row: row.decision),
    key="characteristics",
)
# Errors of lengths, (n,): of all, and of each placement.
ERRORS: Final = (
    Column[FloatArray]("count", "lengths", len, form="d"),
    Column[FloatArray]("min", "smallest", lambda error: error.min(), "m", sign=True),
    Column[FloatArray]("max", "largest", lambda error: error.max(), "m", sign=True),
    Column[FloatArray]("mean", "mean", lambda error: error.mean(), "m", sign=True),
    Column[FloatArray]("rms", "RMS", lambda error: Metrics.of(np.abs(error)).rms, "m"),
)
PLACEMENTS: Final = Listing[tuple[str, FloatArray]](
    "Errors of length, mm",
    Column("placement", "placement", lambda row: row[0]),
    *(c.over(lambda row: row[1]) for c in ERRORS),
    named=True,
)
ARTICULATIONS: Final = Listing[Articulation](
    "One point from several articulations, mm",
    Column("point", "point"),
    Column("articulations", "from", lambda row: len(row.names), form="d"),
    Column("touches", "touches", form="d"),
    Column("location", "L_Dia", lambda row: row.diameter, "m"),
    Column("max_deviation", "max", lambda row: row.maximum, "m"),
    Column("two_sigma", "2 sigma", unit="m"),
    Column("axis_range", unit="m"),
    Column("amplification"),
    Column("centre", None, lambda row: row.centres.mean(axis=0), "m"),
    key="articulations",
    named=True,
)
SPHERES: Final = Listing[SphereProbing](
    "Probing, mm",
    Column("sphere", "sphere"),
    Column("touches", "touches", lambda row: len(row.radial), form="d"),
    Column("size", "P_Size", unit="m", sign=True),
    Column("form", "P_Form", unit="m"),
    Column("radial", unit="m"),
    Column("amplification"),
    key="spheres",
    named=True,
)
REPEATS: Final = Listing[RepeatedVisits](
    "Repeatability of one point, mm",
    Column("point", "point"),
    Column("visits", "visits", lambda row: row.scatter.count, form="d"),
    Column("diameter", "diameter", unit="m"),
    Column("rp", "RP", lambda row: row.scatter.rp.value, "m"),
    Column("rms", "RMS", lambda row: row.scatter.rms.value, "m"),
    key="repeatability",
    named=True,
)
LIMITS: Final = Listing[Limits](
    "Limits",
    Column("length", None, lambda given: given.length and length_limit_text(given.length)),
    *(Column(key, unit="m") for key in ("location", "size", "form", "repeatability")),
)


def acceptance_document(test: AcceptanceTest) -> Document:
    """Every figure with its limit, its uncertainty and the decision, and what it was found on."""
    m = test.measured
    given = test.limits.length
    stated = "" if given is None else f"; length {length_limit_text(given)}"
    parts: list[Part] = [Figure(partial(acceptance_plot, test))]
    parts.append(CHARACTERISTICS.of(test.characteristics, f"{_TITLE}{stated}"))
    if m.lengths is not None:
        parts.append(PLACEMENTS.of(*_by_placement(m.lengths)))
    parts += [ARTICULATIONS.of(m.articulations), SPHERES.of(m.spheres), REPEATS.of(m.repeats)]
    parts += [
        Text(rule_text(test)),
        *(Text(simplification, bullet=True) for simplification in test.simplified),
    ]
    data: Json = {
        "standard": STANDARD,
        "decision": test.decision,
        "passed": None if test.decision == "no limit" else test.decision == "pass",
        "decision_rule": {"kind": test.rule.kind, "factor": test.rule.factor},
        "lengths": None if m.lengths is None else _lengths_dict(test, m.lengths),
        "mpe": LIMITS.record(test.limits) if test.limits.given else None,
        "simplified": list(test.simplified),
    }
    return Document(NAME, _TITLE, test.assessment, parts, data)


def rule_text(test: AcceptanceTest) -> str:
    """How it was decided, in a sentence."""
    if not test.limits.given:
        return "No limits are given: add mpe to the job for a decision."
    if test.rule.kind == "simple":
        return "Decision rule: simple. An error up to its limit passes, whatever its uncertainty."
    return (
        f"Decision rule: guarded (ISO 14253-1), guard band {test.rule.factor:g} standard "
        "uncertainties. An error passes below the limit minus the guard band, fails above the "
        "limit plus the guard band, and is undecided between them. U is the test's expanded "
        "uncertainty (k = 2), from the artefact and from the job; without either there is no guard "
        "band."
    )


def length_limit_text(limit: LengthLimit) -> str:
    """As a maker states it: ``(60 + L/10) µm, at most 150 µm``, L in mm."""
    parts = []
    if limit.constant is not None:
        constant = f"{um(limit.constant):g}"
        slope = f" + L/{from_mm(1.0) / limit.slope:g}" if limit.slope else ""
        parts.append(f"({constant}{slope}) µm" if slope else f"{constant} µm")
    if limit.largest is not None:
        parts.append(f"at most {um(limit.largest):g} µm")
    return ", ".join(parts)


def _by_placement(lengths: LengthErrors) -> tuple[list[tuple[str, FloatArray]], str]:
    rows = [(name, lengths.error[index]) for name, index in lengths.by_placement()]
    varied = lengths.repeat_range
    repeated = "" if varied is None else f"; repeats differ by up to {text(varied, 'm')}"
    return rows, f"{PLACEMENTS.title}{repeated}"


def _lengths_dict(test: AcceptanceTest, lengths: LengthErrors) -> Json:
    """The lengths one by one: columns, because there are many."""
    limit = None if test.limits.length is None else test.limits.length.at(lengths.length)
    return {
        **Listing("", *ERRORS).record(lengths.error),
        "repeat_range_mm": plain(lengths.repeat_range, "m"),
        "placements": PLACEMENTS.records(_by_placement(lengths)[0]),
        "rows": {
            "pair": lengths.label.tolist(),
            "placement": lengths.placement.tolist(),
            "repeat": lengths.repeat.tolist(),
            "length_mm": plain(lengths.length, "m"),
            "error_mm": plain(lengths.error, "m"),
            "limit_mm": plain(limit, "m"),
            "expanded_uncertainty_mm": plain(test.length_expanded, "m"),
        },
    }


# Room for a legend of two rows between a title and its axes, pt.
_ABOVE: Final = 30
_LEGEND: Final[dict[str, Any]] = {
    **{"fontsize": 7, "ncols": 2, "loc": "lower left", "bbox_to_anchor": (0, 1)},
    **{"borderaxespad": 0.2, "handletextpad": 0.2, "columnspacing": 1.0},
}
_LOOKS: Final = ((BLUE, "o"), (ORANGE, "s"), ("black", "D"), (GREY, "^"), (BLUE, "P"))


def acceptance_plot(test: AcceptanceTest) -> str:
    """An SVG: errors of lengths by length, deviations of places below."""
    name = f"{NAME}_errors"
    measured = test.measured
    drawn = {"articulations": measured.articulations, "spheres": measured.spheres}
    below = [key for key, given in drawn.items() if given]
    rows: Any = [["lengths"] * max(1, len(below))] if measured.lengths is not None else []
    rows += [below] if below else []
    rows = rows or [["repeats"]]
    with picture(name, (LARGE, 3.1 * len(rows))) as figure:
        panels = figure.subplot_mosaic(rows)
        if measured.lengths is not None:
            _lengths(panels["lengths"], test, measured.lengths)
        if measured.articulations:
            _articulations(panels["articulations"], test)
        if measured.spheres:
            _spheres(panels["spheres"], test)
        if "repeats" in panels:
            _repeats(panels["repeats"], test)
        return svg_text(figure, name, "Errors of the acceptance test against their limits, mm")


def _lengths(axes: Axes, test: AcceptanceTest, lengths: LengthErrors) -> None:
    for k, (placement, rows) in enumerate(lengths.by_placement()):
        colour, marker = _LOOKS[k % len(_LOOKS)]
        places = mm(lengths.length[rows]), mm(lengths.error[rows])
        axes.plot(*places, marker, color=colour, ms=3, mew=0.7, mfc="none", label=placement)
    if test.limits.length is not None:
        # The limit, and on either side of it the band in which nothing is proved.
        order = np.argsort(lengths.length)
        length, limit = mm(lengths.length[order]), mm(test.limits.length.at(lengths.length[order]))
        guard = mm(test.rule.guard(test.length_expanded[order]))
        for sign, named, unproved in ((1, "limit", "undecided"), (-1, None, None)):
            axes.plot(length, sign * limit, "k--", lw=1.2, label=named)
            if guard.any():
                ends = sign * (limit - guard), sign * (limit + guard)
                axes.fill_between(length, *ends, color=GREY, alpha=0.35, lw=0, label=unproved)
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set_title("Errors of length, one mark per pair of landmarks", pad=_ABOVE)
    axes.set_xlabel("calibrated length, mm")
    axes.set_ylabel("measured − calibrated, mm")
    axes.grid(axis="y")
    # The panel is as wide as the figure.
    axes.legend(**_LEGEND | {"ncols": 7, "columnspacing": 3.5})


def _articulations(axes: Axes, test: AcceptanceTest) -> None:
    start = 1
    ticks: list[str] = []
    for k, articulation in enumerate(test.measured.articulations):
        colour, marker = _LOOKS[k % len(_LOOKS)]
        places = np.arange(start, start + len(articulation.names))
        label = f"{articulation.point} (L_Dia {text(articulation.diameter, 'm')})"
        axes.plot(
            places, mm(articulation.deviations), marker, color=colour, ms=5, mfc="none", label=label
        )
        start += len(articulation.names)
        ticks += articulation.names
    if len(ticks) <= 12:
        axes.set_xticks(range(1, start), ticks, rotation=45, ha="right")
    else:
        axes.set_xlabel("articulation, in order")
    axes.set_title("Distance to the mean place", pad=_ABOVE)
    axes.set_ylabel("mm")
    limit = test.limits.location
    _sizes(axes, None if limit is None else limit / 2, "half the limit")


def _spheres(axes: Axes, test: AcceptanceTest) -> None:
    for k, sphere in enumerate(test.measured.spheres):
        colour, marker = _LOOKS[k % len(_LOOKS)]
        touches = np.arange(1, len(sphere.radial) + 1)
        label = f"{sphere.sphere} (size {mm(sphere.size):+.3f}, form {mm(sphere.form):.3f})"
        axes.plot(touches, mm(sphere.radial), marker, color=colour, ms=4, mfc="none", label=label)
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set_title("Distance to the fitted sphere", pad=_ABOVE)
    axes.set_xlabel("touch, in order")
    axes.set_ylabel("mm")
    axes.grid(axis="y")
    axes.legend(**_LEGEND)


def _repeats(axes: Axes, test: AcceptanceTest) -> None:
    sizes: FloatArray = np.array([repeat.diameter for repeat in test.measured.repeats])
    names = [repeat.point for repeat in test.measured.repeats]
    axes.bar(names, mm(sizes), color=BLUE, hatch="//", edgecolor="white")
    axes.set_title("Smallest sphere that holds the visits", pad=_ABOVE)
    axes.set_ylabel("diameter, mm")
    _sizes(axes, test.limits.repeatability, "limit")


def _sizes(axes: Axes, limit: float | None, label: str) -> None:
    """Sizes from zero on, with their limit, and a legend between the title and the axes."""
    if limit is not None:
        axes.axhline(mm(limit), color="black", ls="--", lw=1.2, label=label)
    axes.margins(y=0.1)
    axes.set_ylim(bottom=0)
    axes.grid(axis="y")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**_LEGEND)
