"""The search for outliers, told: tables by level, heat maps of the four metrics, what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture

from suta_calib.analysis.outliers import (
    AGREEMENT,
    GROUPING_NOUN,
    METRICS,
    GrossTouch,
    Group,
    HeldOut,
    Level,
    Metric,
    Outliers,
    TermOutliers,
    Thresholds,
)
from suta_calib.arrays import FloatArray
from suta_calib.report.document import Document, Figure, Part, ShownOnly, Text
from suta_calib.report.listing import Column, Json, Listing, plain
from suta_calib.report.svg import BLUE, GREY, ORANGE, WIDTH, picture, svg_text
from suta_calib.units import NOTHING, Unit, key, mm, shown, text, unit_name

NAME: Final = "outliers"
UNIT: Final[dict[Metric, Unit]] = {
    "contribution": "%",
    "cooks_distance": "1",
    "leave_one_out": "%",
    "bias": "m",
}
HEADS: Final[dict[Metric, str]] = {
    "contribution": "share %",
    "cooks_distance": "Cook",
    "leave_one_out": "l.o.o. %",
    "bias": "bias mm",
}
TITLES: Final[dict[Metric, str]] = {
    "contribution": "Error contribution, %",
    "cooks_distance": "Cook's distance",
    "leave_one_out": "RMS falls when left out by, %",
    "bias": "Bias after registration, mm",
}
# Dark on light: the scale is told by grey as well as by colour.
COLOURS: Final = "cividis_r"
SMALLEST, LARGEST = 30.0, 420.0
# Larger figures have no place in a column.
WIDEST: Final = 1e5
# Of long levels only the groups with the largest shares are shown.
MOST_GROUPS_SHOWN: Final = 20
EXPLAINED: Final = (
    "Figures are of a fit in which the whole geometry of the arm is free, so that what the arm "
    "itself gets wrong is blamed on nothing that was touched; those of the job's own fit stand "
    "in a table of their own. A figure is flagged (!) if it exceeds its threshold and if noise "
    "alone would do so with a probability of at most {significance:g} anywhere on its level. Three "
    "flags of four make an outlier: every metric has a blind spot, and none convicts alone."
)


def _number(value: float, metric: Metric) -> str:
    if math.isfinite(value) and abs(shown(value, UNIT[metric])) >= WIDEST:
        return f"{shown(value, UNIT[metric]):.1e}"
    return text(value, UNIT[metric])


def _key(metric: Metric) -> str:
    return key(metric, UNIT[metric])


def _column(metric: Metric, *, judged: bool) -> Column[Group]:
    """A metric as it is judged, with a mark where it is flagged; or that of the job's own fit."""

    def value(group: Group) -> float:
        return (group.values if judged else group.as_calibrated)[metric]

    def cell(group: Group) -> str:
        flagged = judged and metric in group.flags
        return _number(value(group), metric) + (" !" if flagged else "")

    return Column(metric, HEADS[metric], value, UNIT[metric], cell=cell)


AS_CALIBRATED: Final = tuple(_column(metric, judged=False) for metric in METRICS)
HELD_OUT: Final = Listing[HeldOut](
    "",
    Column("rms_before", None, lambda effect: effect.before, "m"),
    Column("rms_after", None, lambda effect: effect.after, "m"),
    Column("change", unit="%"),
    Column("rms_all_after", None, lambda effect: effect.everything, "m"),
    Column("count"),
)
TOUCHES: Final = Listing[GrossTouch](
    "Single touches set aside for these figures",
    Column("row", "row", lambda touch: touch.origin),
    Column("what", "what"),
    Column("size", "residual, mm", unit="m", form=".2f"),
)
THRESHOLDS: Final = Listing[Thresholds](
    "",
    Column("contribution_times_n", None, lambda limits: limits.contribution),
    Column("cooks_distance_times_n", None, lambda limits: limits.cook),
    Column("leave_one_out", unit="%"),
    Column("bias", unit="m"),
    Column("significance"),
)


def outliers_document(found: Outliers) -> Document:
    """Tables by level, heat maps, what excluding would do, and how to exclude what was named."""
    explained = EXPLAINED.format(significance=found.thresholds.significance)
    parts: list[Part] = [Text(explained, place="page"), *_figures(found)]
    for term in found.terms:
        for level in term.levels:
            parts += [_groups(term, level).of(_shown(level)), Text(_limits_text(level))]
    for term in found.terms:
        if term.levels:
            level, noun = term.levels[0], GROUPING_NOUN[term.levels[0].name]
            title = f"{term.kind}, by {noun}, in the job's own fit: every touch counts, no flags"
            own = Listing(title, Column[Group]("label", noun), *AS_CALIBRATED)
            parts.append(ShownOnly(own.of(_shown(level)), "page"))
    parts += [ShownOnly(TOUCHES.of(term.touches), "page") for term in found.terms]
    parts += [Text(sentence, bullet=True) for sentence in advice(found)]
    return Document(NAME, "Outliers", found.assessment, parts, _data(found))


def advice(found: Outliers) -> list[str]:
    """What excluding would do, and how to do it."""
    if not any(found.exclusion):
        return ["Nothing was excluded."]
    said = ["Nothing was excluded. Look for the cause first: certificate, seat, burr, label."]
    for term, levels in zip(found.terms, found.exclusion, strict=True):
        if not levels:
            continue
        names = ", ".join(f"{level}: [{', '.join(labels)}]" for level, labels in levels.items())
        said.append(
            f"To leave it out, write into the {term.kind} row of the job: exclude: {{{names}}}"
        )
        for level in term.levels:
            noun = GROUPING_NOUN[level.name]
            for group in level.outliers:
                if (effect := _effect(term, level, group)) is None:
                    continue
                others = " of the others" if effect.count and noun == "landmark" else ""
                before, after = text(effect.before, "m"), text(effect.after, "m")
                said.append(
                    f"Without {noun} {group.label} the held-out RMS{others} goes from {before} to "
                    f"{after} mm ({shown(effect.change, '%'):+.1f} %, {term.method})."
                )
    return said


def _effect(term: TermOutliers, level: Level, group: Group) -> HeldOut | None:
    """What excluding a group does to held-out errors, where that was looked at."""
    return term.held_out.get(level.name, {}).get(group.label)


def _groups(term: TermOutliers, level: Level) -> Listing[Group]:
    """Rows of one level of one observation."""
    noun = GROUPING_NOUN[level.name]

    def change(group: Group) -> str:
        effect = _effect(term, level, group)
        return NOTHING if effect is None else f"{shown(effect.change, '%'):+.1f}"

    return Listing(
        f"{term.kind}, by {noun}",
        Column("label", noun),
        *(_column(metric, judged=True) for metric in METRICS),
        Column("", "held-out %", cell=change, numeric=True),
        Column("", "", lambda g: "outlier" if g.outlier else "suspect" if g.suspect else ""),
        Column("p", None, lambda group: {_key(metric): group.p[metric] for metric in METRICS}),
        Column("flags", None, lambda group: [_key(metric) for metric in group.flags]),
        Column("outlier"),
        Column("suspect"),
        Column("samples"),
        Column("as_calibrated", None, Listing("", *AS_CALIBRATED).record),
        named=True,
    )


def _shown(level: Level) -> Sequence[Group]:
    if len(level.groups) <= MOST_GROUPS_SHOWN:
        return level.groups
    ranked = sorted(level.groups, key=lambda g: (not g.flags, -g.values["contribution"]))
    kept = {g.label for g in ranked[:MOST_GROUPS_SHOWN]}
    return [g for g in level.groups if g.label in kept]


def _limits_text(level: Level) -> str:
    limits = ", ".join(
        f"{HEADS[metric].split()[0]} "
        f"{shown(level.thresholds[metric], UNIT[metric]):.3g} {unit_name(UNIT[metric])}".rstrip()
        for metric in METRICS
    )
    rest = len(level.groups) - len(_shown(level))
    more = f"; {rest} more with smaller shares" if rest else ""
    return f"! beyond threshold ({limits}) and chance{more}"


def _data(found: Outliers) -> Json:
    """The whole answer; levels of the first observation that has them stand at the top."""
    terms = [_term_dict(term) for term in found.terms]
    top: Json = {}
    for term in terms:
        top = {name: term[name] for name in GROUPING_NOUN if name in term} | top
    return {
        **top,
        "touches": [touch for term in terms for touch in term["touches"]],
        "held_out": terms[0]["held_out"],
        "thresholds": THRESHOLDS.record(found.thresholds),
        "agreement": AGREEMENT,
        "exclude": found.exclusion,
        "explained_by": list(found.explaining),
        **({"by_term": terms} if len(terms) > 1 else {}),
    }


def _term_dict(term: TermOutliers) -> Json:
    return {
        "kind": term.kind,
        **{level.name: _level_dict(term, level) for level in term.levels},
        "thresholds": {
            level.name: {
                _key(metric): shown(limit, UNIT[metric])
                for metric, limit in level.thresholds.items()
            }
            for level in term.levels
        },
        "touches": TOUCHES.records(term.touches),
        "samples": term.samples,
        "noise_mm": plain(term.sigma, "m"),
        "held_out": {
            "method": term.method,
            **{
                level: {label: HELD_OUT.record(effect) for label, effect in effects.items()}
                for level, effects in term.held_out.items()
            },
        },
    }


def _level_dict(term: TermOutliers, level: Level) -> Any:
    rows: Any = _groups(term, level).records(level.groups)
    for group in level.groups:
        if (found := group.displacement) is not None:
            rows[group.label]["displacement_mm"] = plain(found.vector, "m")
            rows[group.label]["displacement_std_mm"] = plain(found.std, "m")
    return rows


def _figures(found: Outliers) -> list[Figure]:
    """One picture for each observation that has groups: over the artefact, or group by group."""
    figures = []
    for k, term in enumerate(found.terms, start=1):
        if not term.levels:
            continue
        name = NAME if len(found.terms) == 1 else f"{NAME}-{k}"
        landmarks = term.level("landmarks")
        if landmarks is not None and term.position is not None:
            draw = partial(_over_artefact, term, landmarks, name)
            title = f"{term.kind}: the metrics over the artefact"
        else:
            level = term.levels[-1]
            draw = partial(_by_group, level, name)
            title = f"{term.kind}: the metrics by {GROUPING_NOUN[level.name]}"
        figures.append(Figure(draw, title))
    return figures


def _over_artefact(term: TermOutliers, level: Level, name: str) -> str:
    """One panel a metric: size and shade tell the value, which stands beside the label."""
    assert term.position is not None
    # The two axes along which the landmarks spread most, in the artefact's order.
    spread = np.ptp(term.position, axis=0)
    axes = sorted(np.argsort(-spread, kind="stable")[:2].tolist())
    place = mm(term.position[:, axes])
    with picture(name, (WIDTH * 1.25, WIDTH * 1.25)) as figure:
        panels = figure.subplots(2, 2)
        for panel, metric in zip(panels.flat, METRICS, strict=True):
            _map(figure, panel, place, level, metric)
        for panel in panels[-1]:
            panel.set_xlabel(f"artefact's {'xyz'[axes[0]]}, mm")
        for panel in panels[:, 0]:
            panel.set_ylabel(f"artefact's {'xyz'[axes[1]]}, mm")
        return svg_text(figure, name, "The four outlier metrics of every landmark") + "\n"


def _map(figure: Picture, axes: Axes, place: FloatArray, level: Level, metric: Metric) -> None:
    values = shown(np.array([g.values[metric] for g in level.groups]), UNIT[metric])
    limit = shown(level.thresholds[metric], UNIT[metric])
    drawn = np.nan_to_num(np.maximum(values, 0.0))
    top = max(float(drawn.max()), limit)
    size = SMALLEST + (LARGEST - SMALLEST) * drawn / top
    marks: Any = axes.scatter(
        place[:, 0],
        place[:, 1],
        s=size,
        c=drawn,
        cmap=COLOURS,
        vmin=0.0,
        vmax=top,
        edgecolors="black",
        lw=0.6,
    )
    for (x, y), group, value, area in zip(place, level.groups, values, size, strict=True):
        flagged = metric in group.flags
        if flagged:
            axes.plot(x, y, "s", mfc="none", mec="black", mew=1.8, ms=np.sqrt(area) + 7)
        axes.annotate(
            f"{group.label} {value:.3g}{' !' if flagged else ''}",
            (x, y),
            (0, -4 - np.sqrt(area) / 2),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=7,
            fontweight="bold" if flagged else "normal",
        )
    axes.set_title(TITLES[metric])
    centre = (place.max(axis=0) + place.min(axis=0)) / 2
    half = 0.62 * float(np.ptp(place, axis=0).max())
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)
    axes.set_aspect("equal")
    axes.grid()
    bar = figure.colorbar(marks, ax=axes, shrink=0.8)
    bar.ax.axhline(limit, color="black", lw=1.5, ls="--")
    bar.ax.set_title("- - threshold", fontsize=6, fontweight="normal", loc="center")


def _by_group(level: Level, name: str) -> str:
    """One panel a metric, groups in the order of the file, with the threshold."""
    with picture(name, (WIDTH * 1.25, 6.4)) as figure:
        for panel, metric in zip(figure.subplots(2, 2).flat, METRICS, strict=True):
            _stems(panel, level, metric)
        return svg_text(figure, name, f"The four outlier metrics of every {level.name[:-1]}") + "\n"


def _stems(axes: Axes, level: Level, metric: Metric) -> None:
    values = shown(np.array([g.values[metric] for g in level.groups]), UNIT[metric])
    flagged = np.array([metric in g.flags for g in level.groups])
    number = np.arange(1, len(values) + 1)
    axes.vlines(number, 0.0, values, color=GREY, lw=0.8)
    axes.plot(number, values, "o", color=BLUE, ms=3.0)
    axes.plot(number[flagged], values[flagged], "s", mfc=ORANGE, mec="black", ms=6.0)
    for k in np.flatnonzero(flagged):
        axes.annotate(
            level.groups[k].label,
            (number[k], values[k]),
            (4, 4),
            textcoords="offset points",
            fontsize=7,
        )
    limit = shown(level.thresholds[metric], UNIT[metric])
    axes.axhline(limit, color="black", lw=1.0, ls="--")
    axes.annotate(
        "threshold", (1.0, limit), xycoords=("axes fraction", "data"), fontsize=6, ha="right"
    )
    axes.set_title(TITLES[metric] if metric != "bias" else "RMS residual, mm")
    axes.set_xlabel(f"{GROUPING_NOUN[level.name]}, in the order of the files")
    axes.margins(y=0.15)
    if not np.any(values < 0):
        axes.set_ylim(bottom=0)
    axes.grid(axis="y")
