"""Report of a search for outliers: tables by level, heat maps of the metrics, what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Final

from suta_calib import report
from suta_calib.analysis.outliers import (
    AGREEMENT,
    GROUPING_NOUN,
    METRICS,
    GrossTouch,
    Group,
    HeldOut,
    Level,
    Metric,
    Move,
    Outliers,
    TermOutliers,
    Thresholds,
)
from suta_calib.analysis.outliers.result import metric_labels
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Json, Listing, plain, written
from suta_calib.units import NOTHING, Unit, key, shown, text, unit_name

NAME: Final = "outliers"
EXPLAINED: Final = (
    "In this fit the whole geometry of the arm is estimated, so that errors of the arm are not "
    "blamed on touches; another table has the figures of the job's own fit. A figure is flagged "
    "(!) if it exceeds its threshold, and the probability that noise alone causes this in any row "
    "of the table is at most {significance:g}. Three flags of four make an outlier: no single "
    "metric is enough."
)

OWN_FIT: Final = (
    "The two tables cannot be compared directly. In the job's own fit, errors of the model affect "
    "every touch. So shares and leave-one-out values differ less, and biases contain the arm's "
    "errors. The thresholds are for the fit of the whole geometry."
)


def _key(metric: Metric, unit: Unit) -> str:
    return key(metric, metric_labels(metric, unit)[0])


def _column(metric: Metric, errors: Unit, *, judged: bool) -> Column[Group]:
    """A metric as it is judged, marked where it is flagged; or that of the job's own fit."""
    unit, head, _ = metric_labels(metric, errors)

    def value(group: Group) -> float:
        return (group.values if judged else group.as_calibrated)[metric]

    def cell(group: Group) -> str:
        number = shown(value(group), unit)
        # Larger figures have no place in a column.
        wide = math.isfinite(number) and abs(number) >= 1e5
        flag = " !" if judged and metric in group.flags else ""
        return (f"{number:.1e}" if wide else text(value(group), unit, decimals=3)) + flag

    return Column(metric, head, value, unit, cell=cell)


def _as_calibrated(term: TermOutliers) -> tuple[Column[Group], ...]:
    return tuple(_column(metric, term.unit, judged=False) for metric in METRICS)


def _held_out(term: TermOutliers) -> Listing[HeldOut]:
    return Listing(
        "",
        Column("rms_before", None, lambda effect: effect.before, term.unit),
        Column("rms_after", None, lambda effect: effect.after, term.unit),
        Column("change", unit="%"),
        Column("rms_all_after", None, lambda effect: effect.everything, term.unit),
        Column("count"),
    )


def _touches(term: TermOutliers) -> Listing[GrossTouch]:
    return Listing(
        "Single touches excluded from these figures",
        Column("row", "row", lambda touch: touch.origin),
        Column("what", "what"),
        Column(
            "size", f"residual, {unit_name(term.unit)}".rstrip(", "), unit=term.unit, form=".2f"
        ),
    )


MOVES: Final = Listing[Move](
    "Moved between two rows",
    Column("what", "what"),
    Column("origin", "from row"),
    Column("distance", "mm", unit="m", form=".2f"),
    Column("p", "chance", form=".2g"),
)
THRESHOLDS: Final = Listing[Thresholds](
    "",
    Column("contribution_times_n", None, lambda limits: limits.contribution),
    Column("cooks_distance_times_n", None, lambda limits: limits.cook),
    Column("leave_one_out", unit="%"),
    Column("bias", unit="m"),
    Column("significance"),
)


def outliers_document(outliers: Outliers) -> Document:
    """Tables by level, heat maps, what excluding would do, and how to exclude what was named."""
    explained = EXPLAINED.format(significance=outliers.thresholds.significance)
    parts: list[Part] = [Text(explained, place="page"), *_figures(outliers)]
    for term in outliers.terms:
        for level in term.levels:
            shown_groups = _groups(term, level).of(_shown(level))
            parts += [shown_groups, Text(_limits_text(level, term.unit))]
    for term in outliers.terms:
        if term.levels:
            level, noun = term.levels[0], GROUPING_NOUN[term.levels[0].name]
            title = f"{term.name}, by {noun}, in the job's own fit: every touch counts, no flags"
            group_listing = Listing(title, Column[Group]("label", noun), *_as_calibrated(term))
            parts += [group_listing.of(_shown(level)), Text(OWN_FIT)]
    parts += [_touches(term).of(term.touches, place="page") for term in outliers.terms]
    parts += [MOVES.of(term.moves, place="page") for term in outliers.terms]
    parts += advice(outliers)
    return Document(NAME, "Outliers", outliers.assessment, parts, _data(outliers))


def advice(outliers: Outliers) -> list[Text]:
    """What excluding would do, and how to do it: the line to paste into the job."""
    if not any(outliers.exclusion):
        return [Text("Nothing was excluded.", bullet=True)]
    cause = "Nothing was excluded. Look for the cause first: certificate, seat, burr, label."
    texts = [Text(cause, bullet=True)]
    for term, levels in zip(outliers.terms, outliers.exclusion, strict=True):
        if not levels:
            continue
        chain = f" with chain: {term.chain}" if term.chain else ""
        how = f"To leave it out, write into the {term.kind} row of the job{chain}:"
        texts += [
            Text(how, bullet=True),
            Text(f"exclude: {yaml_text(levels, one_line=True)}", look="verbatim"),
        ]
        for level in term.levels:
            noun = GROUPING_NOUN[level.name]
            for group in level.outliers:
                if (effect := _effect(term, level, group)) is None:
                    continue
                of_others = " of the others" if effect.count and noun == "landmark" else ""
                before = text(effect.before, term.unit)
                after = text(effect.after, term.unit, with_unit=True)
                effect_said = (
                    f"Without {noun} {group.label} the validation RMS{of_others} changes from "
                    f"{before} to {after} ({shown(effect.change, '%'):+.1f} %, {term.method})."
                )
                texts.append(Text(effect_said, bullet=True))
    return texts


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
        f"{term.name}, by {noun}",
        Column("label", noun),
        *(_column(metric, term.unit, judged=True) for metric in METRICS),
        Column("", "validation %", cell=change, numeric=True),
        Column("", "", lambda g: "outlier" if g.outlier else "suspect" if g.suspect else ""),
        Column("p", None, lambda g: {_key(metric, term.unit): g.p[metric] for metric in METRICS}),
        Column("flags", None, lambda g: [_key(metric, term.unit) for metric in g.flags]),
        *written("outlier", "suspect", "samples"),
        Column("as_calibrated", None, Listing("", *_as_calibrated(term)).record),
        named=True,
    )


def _shown(level: Level) -> Sequence[Group]:
    # Of long levels only the groups with the largest shares are shown.
    most_groups_shown = 20
    if len(level.groups) <= most_groups_shown:
        return level.groups
    ranked = sorted(level.groups, key=lambda g: (not g.flags, -g.values["contribution"]))
    labels = {g.label for g in ranked[:most_groups_shown]}
    return [g for g in level.groups if g.label in labels]


def _limits_text(level: Level, errors: Unit) -> str:
    limits = ", ".join(
        f"{head.split()[0]} {shown(level.thresholds[metric], unit):.3g} {unit_name(unit)}".rstrip()
        for metric in METRICS
        for unit, head, _ in [metric_labels(metric, errors)]
    )
    rest = len(level.groups) - len(_shown(level))
    more = f"; {rest} more with smaller shares" if rest else ""
    return f"! beyond threshold ({limits}) and not by chance{more}"


def _data(outliers: Outliers) -> Json:
    """The whole answer; levels of the first observation that has them stand at the top."""
    terms = [_term_dict(term) for term in outliers.terms]
    top: Json = {}
    for term in terms:
        top = {name: term[name] for name in GROUPING_NOUN if name in term} | top
    return {
        **top,
        "touches": [touch for term in terms for touch in term["touches"]],
        "moves": [move for term in terms for move in term["moves"]],
        "held_out": terms[0]["held_out"],
        "thresholds": THRESHOLDS.record(outliers.thresholds),
        "agreement": AGREEMENT,
        "exclude": outliers.exclusion,
        "explained_by": list(outliers.explaining),
        **({"by_term": terms} if len(terms) > 1 else {}),
    }


def _term_dict(term: TermOutliers) -> Json:
    levels: Json = {level.name: _groups(term, level).records(level.groups) for level in term.levels}
    for level in term.levels:
        for group in level.groups:
            if (displacement := group.displacement) is not None:
                row = levels[level.name][group.label]
                row["displacement_mm"] = plain(displacement.vector, "m")
                row["displacement_std_mm"] = plain(displacement.std, "m")
    return {
        "kind": term.kind,
        **({"chain": term.chain} if term.chain else {}),
        **levels,
        "thresholds": {
            level.name: {
                _key(metric, term.unit): shown(limit, metric_labels(metric, term.unit)[0])
                for metric, limit in level.thresholds.items()
            }
            for level in term.levels
        },
        "touches": _touches(term).records(term.touches),
        "moves": MOVES.records(term.moves),
        "samples": term.samples,
        key("noise", term.unit): plain(term.sigma, term.unit),
        "held_out": {
            "method": term.method,
            **{
                level: {label: _held_out(term).record(effect) for label, effect in effects.items()}
                for level, effects in term.held_out.items()
            },
        },
    }


def _figures(outliers: Outliers) -> list[Figure]:
    """One picture for each observation that has groups: over the artefact, or group by group."""
    figures = []
    for k, term in enumerate(outliers.terms, start=1):
        if not term.levels:
            continue
        name = NAME if len(outliers.terms) == 1 else f"{NAME}-{k}"
        title = f"{term.name}: the metrics {term.drawn_over}"
        figures.append(Figure(partial(report.metrics_plot, term, name), title))
    return figures
