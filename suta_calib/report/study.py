"""Reports of studies: error by number of sets, estimates and their prediction, drift."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from suta_calib.analysis.study import (
    DriftPoint,
    DriftStudy,
    ParameterSpread,
    SizeResult,
    SizeStudy,
    SpreadStudy,
    Study,
    StudyPlan,
)
from suta_calib.analysis.study.trial import ESTIMATED, NAMES, Kind, described
from suta_calib.plotting.look import BLUE, GREY, ORANGE, WIDTH
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Json, Listing, plain, written
from suta_calib.report.svg import picture, svg_text
from suta_calib.units import NOTHING, Unit, deg, key, mm, shown, text, unit_name
from suta_calib.words import listed

TITLES: Final[dict[Kind, str]] = {
    "size": "How many measurement sets are enough",
    "bootstrap": "Bootstrap: how the estimates scatter",
    "monte-carlo": "Monte-Carlo: do estimates scatter as predicted?",
}


def _unit(p: ParameterSpread) -> Unit:
    return p.estimate.unit


def _interval_text(p: ParameterSpread) -> str:
    low, high = (text(value, p.estimate.unit) for value in p.spread.interval)
    return f"{low} … {high}" if p.spread.enough else NOTHING


# SI in JSON, as in result.json.
SPREADS: Final = Listing[ParameterSpread](
    "",
    Column("", "parameter", lambda p: p.estimate.name),
    Column("unit", "unit", _unit, cell=lambda p: unit_name(p.estimate.unit)),
    Column("state", None, lambda p: p.estimate.state),
    Column("value", None, lambda p: p.estimate.value),
    Column("std", None, lambda p: p.estimate.std),
    Column("mean", None, lambda p: p.spread.mean),
    Column("predicted_std", "predicted", lambda p: p.predicted, _unit, si=True),
    Column("spread", "spread", lambda p: p.spread.std, _unit, si=True),
    Column(
        "ratio",
        "ratio",
        cell=lambda p: (f"{p.ratio:.2f}" if p.ratio > 0 else NOTHING) + "!" * (not p.as_predicted),
        numeric=True,
    ),
    Column("as_predicted", None, lambda p: p.as_predicted if math.isfinite(p.ratio) else None),
    Column(
        "interval", "95 % interval", lambda p: p.spread.interval, cell=_interval_text, numeric=True
    ),
    Column("told", "told", lambda p: len(p.spread.values), form="d"),
)
FAILURES: Final = Listing[tuple[str, int]](
    "No result",
    Column("problem", "why a trial had no result", lambda row: row[0]),
    Column("count", "trials", lambda row: row[1], form="d"),
    key="failures",
)


def study_document(study: Study) -> Document:
    """What was drawn, what the errors are of, and what came of it.

    Nothing in it depends on how many workers did it, or how fast.
    """
    kind = study.plan.data.kind
    if isinstance(study, SizeStudy):
        sentences, figure = [_errors(study)], Figure(partial(size_plot, study))
        table = _sizes(study).of(study.sizes)
        data: Json = {
            "left_out_sizes": list(study.plan.left_out),
            "baseline_size": study.baseline,
            "tolerance_pct": shown(study.tolerance, "%"),
            "recommended_size": study.recommended,
            key("uncalibrated", _unit_of(study)): shown(study.uncalibrated, _unit_of(study)),
        }
    else:
        sentences, figure = _scatter(study), Figure(partial(spread_plot, study))
        estimated = [p for p in study.parameters.values() if p.estimate.state in ESTIMATED]
        table, data = SPREADS.of(estimated, TITLES[kind]), _spreads(study)
    parts: list[Part] = [Text(sentence) for sentence in (_drawn(study), *sentences)]
    parts += [figure] if study.assessment.usable else []
    parts += [table, FAILURES.of(study.failures.items(), place="page")]
    return Document(NAMES[kind], TITLES[kind], study.assessment, parts, _asked(study.plan) | data)


def _unit_of(study: Study) -> Unit:
    """Unit of the held-out errors."""
    return study.plan.data.judged_by.error_unit


def _sizes(study: SizeStudy) -> Listing[SizeResult]:
    def size_text(s: SizeResult) -> str:
        enough = study.levelled and s.size == study.recommended
        return f"{s.size} ←" if enough else str(s.size)

    def done_text(s: SizeResult) -> str:
        return f"{s.trials}" if not s.failed else f"{s.trials - s.failed} of {s.trials}"

    unit = _unit_of(study)
    of = f", {unit_name(unit)}".rstrip(", ")
    return Listing(
        TITLES["size"],
        Column("size", "sets", cell=size_text, numeric=True),
        Column("mean", f"mean{of}", unit=unit),
        Column("std", f"std{of}", unit=unit),
        Column("min", f"min{of}", lambda s: s.range[0], unit),
        Column("max", f"max{of}", lambda s: s.range[1], unit),
        Column("improvement", "improvement, %", unit="%"),
        Column("trials", "trials", cell=done_text, numeric=True),
        *written("failed", "distinct"),
        key="sizes",
    )


def _held_out(plan: StudyPlan) -> str:
    """What the errors are of."""
    if plan.data.validation:
        return "validation data"
    return "nothing" if plan.data.kind == "monte-carlo" else "sets not drawn"


def _asked(plan: StudyPlan) -> Json:
    data = plan.data
    return {
        "kind": data.kind,
        "unit": data.sets.unit,
        "set_is": described(data.sets.unit),
        "sets": len(data.sets),
        "kept_whole": [data.terms[k].kind for k in data.sets.kept_whole],
        "seed": data.seed,
        "trials": plan.trials,
        "metric": {
            "name": f"RMS {data.judged_by.blocks[0].name} error",
            "kind": data.judged_by.kind,
            "held_out": _held_out(plan),
        },
    }


def _spreads(study: SpreadStudy) -> Json:
    errors, unit = study.validation, _unit_of(study)
    return {
        "solved": study.solved,
        "parameters": {name: _parameter(p) for name, p in study.parameters.items()},
        "validation": {
            key("rms", unit): shown(study.full_rms, unit),
            "trials": len(errors.values),
            key("mean", unit): shown(errors.mean, unit),
            key("std", unit): shown(errors.std, unit),
            key("interval", unit): plain(errors.interval, unit),
        },
    }


def _parameter(p: ParameterSpread) -> Json:
    """The row, with mm or degrees where people look; little of what was not estimated."""
    row, unit = SPREADS.record(p), p.estimate.unit
    if p.estimate.state not in ESTIMATED:
        return {name: row[name] for name in ("unit", "state", "told")}
    figures = {"spread": p.spread.std, "predicted_std": p.predicted}
    return row | {key(name, unit): shown(figure, unit) for name, figure in figures.items()}


def _drawn(study: Study) -> str:
    plan = study.plan
    complete = [plan.data.terms[k].kind for k in plan.data.sets.kept_whole]
    complete_note = f" {' and '.join(complete)} is used whole in every trial." if complete else ""
    seed = f"seed {plan.data.seed}"
    if plan.data.kind == "monte-carlo":
        return (
            f"{plan.trials} simulated repetitions of the whole measurement, {seed}: the estimate "
            "is taken as the truth, with normal noise as large as the residuals."
        )
    how = "with replacement" if plan.data.kind == "bootstrap" else "without replacement"
    what = described(plan.data.sets.unit)
    return (
        f"{plan.trials} draws each, {how}, from {len(plan.data.sets)} sets, {seed}; a set is "
        f"{what}.{complete_note}"
    )


def _errors(study: SizeStudy) -> str:
    unit = _unit_of(study)
    nominal = text(study.uncalibrated, unit, with_unit=True)
    sentence = f"Errors are RMS on {_held_out(study.plan)}"
    sentence += f"; uncalibrated {nominal}." if nominal != NOTHING else "."
    for chosen in study.sizes:
        if chosen.size == study.recommended and len(chosen.rms) > 1:
            low, high = text(chosen.range[0], unit), text(chosen.range[1], unit, with_unit=True)
            sentence += f" With {chosen.size}, single calibrations reach {low} to {high}."
    return (
        f"{sentence} The scatter is between subsets of the same sets; the larger the subsets, the "
        "more they overlap."
    )


def _scatter(study: SpreadStudy) -> list[str]:
    bootstrap = study.plan.data.kind == "bootstrap"
    predicted = "of the calibration with all data" if bootstrap else "root mean square over trials"
    sentences = [
        f"Predicted: standard deviation {predicted}. Spread: standard deviation between trials "
        "that determined the parameter, with the same fixed parameters."
    ]
    silent = [n for n, p in study.parameters.items() if p.estimate.state not in ESTIMATED]
    if silent:
        sentences.append(f"Not determined by all data together either: {listed(silent)}.")
    if any(p.priors and p.ratio < 1 for p in study.parameters.values()):
        sentences.append(
            "The job has priors, which are the same in every trial: estimates that depend on "
            "them scatter less than their standard deviation."
        )
    # With an incomplete model, the covariance is larger than noise alone explains.
    spread = [p for p in study.parameters.values() if p.predicted > 0]
    larger = max(((p.estimate.std or 0.0) / p.predicted for p in spread), default=0.0)
    # Ratio of a calibration's standard deviations to those from noise, from which it is reported.
    if not bootstrap and larger >= 1.25:
        sentences.append(
            f"The calibration's own standard deviations are up to {larger:.1f} times as large: "
            "they include errors of the model, which simulated noise does not contain."
        )
    if study.validation.enough:
        unit = _unit_of(study)
        low, high = study.validation.interval
        full = text(study.full_rms, unit, with_unit=True)
        with_all = "" if full == NOTHING else f"{full} with all data, "
        mean = text(study.validation.mean, unit)
        std = text(study.validation.std, unit, with_unit=True)
        sentences.append(
            f"RMS error on {_held_out(study.plan)}: {with_all}{mean} ± {std} over the trials, "
            f"95 % of them {text(low, unit)} … {text(high, unit, with_unit=True)}."
        )
    return sentences


def size_plot(study: SizeStudy) -> str:
    """An SVG element: mean, scatter and range of the held-out error over the number of sets."""
    name = NAMES["size"]
    with picture(name, (WIDTH, 4.2)) as figure:
        axes, unit = figure.subplots(), _unit_of(study)
        _bands(axes, study)
        for chosen in [s for s in study.sizes if study.levelled and s.size == study.recommended]:
            axes.axvline(chosen.size, color=ORANGE, ls="--", lw=1.6, label=f"enough: {chosen.size}")
            axes.plot(
                chosen.size, shown(chosen.mean, unit), "D", mfc="none", mec="black", mew=1.6, ms=11
            )
        axes.set_title("Validation error by number of sets", pad=38)
        axes.set_xlabel(f"{study.plan.data.sets.unit}s calibrated with")
        axes.set_ylabel(_error_label(study))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(axis="y")
        axes.legend(ncols=3, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
        return svg_text(figure, name, "Validation error by number of measurement sets")


def spread_plot(study: SpreadStudy) -> str:
    """An SVG element: the 95 % intervals of the parameters, and the held-out error."""
    name = NAMES[study.plan.data.kind]
    estimated = {n: p for n, p in study.parameters.items() if np.isfinite(p.ratio)}
    with_errors = study.validation.enough
    size = (1.3 * WIDTH if with_errors else WIDTH, 1.8 + 0.28 * len(estimated))
    with picture(name, size) as figure:
        ratios = (3, 2) if with_errors else (1,)
        first, *parameter_panels = figure.subplots(
            1, len(ratios), width_ratios=ratios, squeeze=False
        )[0]
        _intervals(first, estimated)
        for axes in parameter_panels:
            _error_histogram(axes, study)
        return svg_text(figure, name, "Scatter of the estimates between trials")


def _error_label(study: Study) -> str:
    return f"RMS error, {unit_name(_unit_of(study))}".rstrip(", ")


def _bands(axes: Axes, study: SizeStudy) -> None:
    solved = [s for s in study.sizes if len(s.rms)]
    size = np.array([s.size for s in solved])
    figures = np.array([(s.mean, np.nan_to_num(s.std), *s.range) for s in solved])
    unit = _unit_of(study)
    mean, std, low, high = shown(figures, unit).reshape(-1, 4).T
    axes.fill_between(
        size, low, high, facecolor="#e8e8e8", edgecolor=GREY, hatch="///", label="range", lw=0.6
    )
    # Where the scatter is lopsided, mean - std is below every error, even below zero.
    lower = np.maximum(mean - std, low)
    axes.fill_between(
        size, lower, mean + std, facecolor="#a9cfe6", edgecolor=BLUE, label="± std", lw=0.6
    )
    axes.plot(size, mean, "o-", color="black", ms=4, lw=1.4, label="mean")
    level = shown(solved[-1].mean, unit) * (1 + study.tolerance) if solved else np.nan
    label = f"{shown(study.tolerance, '%'):g} % above the mean of {size[-1]}" if solved else ""
    axes.axhline(level, color="black", ls=":", lw=1.0, label=label)


def _intervals(axes: Axes, estimated: dict[str, ParameterSpread]) -> None:
    """95 % of each parameter's trials, in units of the standard deviation predicted."""
    # Half-width of a normal distribution's central 95 %, in standard deviations.
    two_sided = 1.96
    axes.axvspan(
        -two_sided, two_sided, facecolor="#e8e8e8", edgecolor=GREY, lw=0.6, label="predicted 95 %"
    )
    places = np.arange(len(estimated))
    rows = [
        (np.array([p.spread.mean, *p.spread.interval]) - p.estimate.value) / p.predicted
        for p in estimated.values()
    ]
    mean, low, high = np.array(rows).reshape(-1, 3).T
    axes.hlines(places, low, high, color=BLUE, lw=2.2, label="95 % of the trials")
    axes.plot(mean, places, "o", color="black", ms=4, label="mean of the trials")
    off = np.array([not p.as_predicted for p in estimated.values()], dtype=bool)
    if off.any():
        mark: dict[str, Any] = {"color": ORANGE, "mec": "black", "ms": 7}
        axes.plot(high[off], places[off], ">", label="not as predicted", **mark)
    axes.set_yticks(places, [f"{n}  ×{p.ratio:.2f}" for n, p in estimated.items()])
    axes.set_ylim(len(estimated) - 0.4, -0.6)
    axes.set_title("Estimates, and spread over prediction (×)", pad=38)
    axes.set_xlabel("estimate minus that with all data, in predicted standard deviations")
    axes.grid(axis="x")
    axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)


def _error_histogram(axes: Axes, study: SpreadStudy) -> None:
    unit = _unit_of(study)
    values = shown(study.validation.values, unit)
    axes.hist(values, bins="auto", facecolor="#a9cfe6", edgecolor=BLUE, lw=0.8)
    if np.isfinite(study.full_rms):
        axes.axvline(
            shown(study.full_rms, unit), color=ORANGE, ls="--", lw=1.8, label="with all data"
        )
        axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
    axes.set_title("Validation error", pad=38)
    axes.set_xlabel(_error_label(study))
    axes.set_ylabel("trials")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))


POINTS: Final = Listing[DriftPoint](
    "Validation errors while parameters drift",
    Column("days", "days", form=".3g"),
    Column("rms", "RMS", unit="m"),
    Column("low", "5 % below", unit="m"),
    Column("high", "5 % above", unit="m"),
)


def drift_document(study: DriftStudy) -> Document:
    """Errors by the day, the limit, and the interval between calibrations.

    In JSON ``interval_days`` is null where nearly no walk exceeds the limit in the time.
    """
    options = study.options
    rates = (
        f"{options.trials} random walks of every estimated parameter: "
        f"{text(options.angle_rate, 'rad')} deg and {text(options.length_rate, 'm')} mm (standard "
        "deviation) after one day, growing with the square root of time."
    )
    interval = study.interval
    data = {
        "walk_deg": deg(options.angle_rate),
        "walk_mm": mm(options.length_rate),
        "trials": options.trials,
        "seed": options.seed,
        "tolerance_pct": shown(options.tolerance, "%"),
        "now_mm": mm(study.now),
        "limit_mm": mm(study.limit),
        "interval_days": interval if np.isfinite(interval) else None,
        "points": POINTS.records(study.points),
    }
    parts: list[Part] = [Text(rates), Figure(partial(drift_plot, study)), POINTS.of(study.points)]
    return Document("drift", "When to calibrate again", study.assessment, parts, data)


def drift_plot(study: DriftStudy) -> str:
    """An SVG: held-out RMS over time with the band of nine walks in ten, and the limit."""
    days = np.array([0.0, *(point.days for point in study.points)])
    rms, low, high = (
        mm(np.array([study.now, *(getattr(point, key) for point in study.points)]))
        for key in ("rms", "low", "high")
    )
    with picture("drift", (WIDTH, 3.2)) as figure:
        axes = figure.subplots()
        axes.fill_between(days, low, high, color=BLUE, alpha=0.2, lw=0, label="nine walks in ten")
        axes.plot(days, rms, ".-", color=BLUE, label="all walks")
        axes.axhline(mm(study.limit), color=GREY, ls="--", lw=1.2, label="limit")
        axes.set_ylim(bottom=0)
        axes.set_xlabel("days since the calibration")
        axes.set_ylabel("validation RMS, mm")
        axes.legend(fontsize=8)
        return svg_text(figure, "drift", "Validation error while parameters drift")
