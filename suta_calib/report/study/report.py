"""Studies for a terminal of 80 columns, and as a section of the report."""

from __future__ import annotations

from typing import Final

from rich.console import Group, RenderableType
from rich.text import Text as Line

from suta_calib.analysis.study.sets import described
from suta_calib.analysis.study.sizes import SizeStudy
from suta_calib.analysis.study.spread import ParameterSpread, SpreadStudy
from suta_calib.analysis.study.trial import TOLD, Kind
from suta_calib.report.console import number_table, verdict_lines
from suta_calib.report.sections import Plot, Section, Table, Text
from suta_calib.report.study.json import held_out
from suta_calib.report.study.plots import size_figure, spread_figure
from suta_calib.report.verdict import listed
from suta_calib.units import NOTHING, text, unit_name

# What a study's files and its section are called.
NAMES: Final[dict[Kind, str]] = {
    "size": "study",
    "bootstrap": "bootstrap",
    "monte-carlo": "monte_carlo",
}
TITLES: Final[dict[Kind, str]] = {
    "size": "How many measurement sets are enough",
    "bootstrap": "Bootstrap: how the estimates scatter",
    "monte-carlo": "Monte-Carlo: do estimates scatter as predicted",
}
SIZE_HEADS: Final = (
    *("sets", "mean, mm", "std, mm", "min, mm", "max, mm", "improvement", "trials"),
)
SPREAD_HEADS: Final = (
    *("parameter", "unit", "predicted", "spread", "ratio", "95 % interval", "told"),
)
# A calibration's own standard deviations over those from noise alone that deserve a word.
NOTEWORTHY: Final = 1.25
Study = SizeStudy | SpreadStudy


def study_tables(study: Study) -> RenderableType:
    """The figures, what they are of, and the verdict."""
    heads, rows = _table(study)
    table = number_table(TITLES[study.plan.data.kind], heads[0], *heads[1:])
    # Names must not fold on a terminal of the usual eighty columns.
    table.padding = (0, 0, 0, 1)
    for row in rows:
        table.add_row(*row)
    told = [Line(sentence) for sentence in _words(study)]
    return Group(table, *told, "", *verdict_lines(study.assessment))


def study_section(study: Study) -> Section:
    """The same with the picture, for ``report.html``."""
    kind = study.plan.data.kind
    heads, rows = _table(study)
    parts: list[Text | Plot | Table] = [Text(sentence) for sentence in _words(study)]
    if study.assessment.usable:
        svg = (
            size_figure(study)
            if isinstance(study, SizeStudy)
            else spread_figure(study, NAMES[kind])
        )
        parts.append(Plot(svg))
    numeric = frozenset(range(0 if isinstance(study, SizeStudy) else 1, len(heads)))
    parts.append(Table(heads, rows, numeric))
    if study.failures:
        reasons = [(problem, str(count)) for problem, count in study.failures.items()]
        parts.append(
            Table(("why a trial had no result", "trials"), reasons, frozenset({1}), "No result")
        )
    return Section(NAMES[kind], TITLES[kind], study.assessment, parts)


def _table(study: Study) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    if isinstance(study, SizeStudy):
        return SIZE_HEADS, _size_rows(study)
    told = {n: p for n, p in study.parameters.items() if p.estimate.state in TOLD}
    return SPREAD_HEADS, [_spread_row(name, p) for name, p in told.items()]


def _size_rows(study: SizeStudy) -> list[tuple[str, ...]]:
    rows = []
    for s in study.sizes:
        mark = " ←" if study.levelled and s.size == study.recommended else ""
        lengths = [text(value, "m") for value in (s.mean, s.std, s.minimum, s.maximum)]
        gain = f"{100 * s.improvement:.1f} %" if len(s.rms) else NOTHING
        done = f"{s.trials}" if not s.failed else f"{s.trials - s.failed} of {s.trials}"
        rows.append((f"{s.size}{mark}", *lengths, gain, done))
    return rows


def _spread_row(name: str, parameter: ParameterSpread) -> tuple[str, ...]:
    e, spread = parameter.estimate, parameter.spread
    told = str(len(spread.values))
    unit = unit_name(e.unit)
    ratio = f"{parameter.ratio:.2f}" if parameter.ratio > 0 else NOTHING
    mark = "" if parameter.as_predicted else "!"
    low, high = (text(value, e.unit) for value in spread.interval)
    interval = f"{low} … {high}" if spread.enough else NOTHING
    numbers = (text(parameter.predicted, e.unit), text(spread.std, e.unit), ratio + mark)
    return (name, unit, *numbers, interval, told)


def _words(study: Study) -> list[str]:
    """What was drawn, what the errors are of, and what to compare with."""
    found = [_drawn(study)]
    if isinstance(study, SizeStudy):
        found.append(_errors(study))
    else:
        found += _scatter(study)
    return found


def _drawn(study: Study) -> str:
    plan = study.plan
    kept = [plan.data.terms[k].kind for k in plan.data.sets.kept_whole]
    whole = f" {' and '.join(kept)} is kept whole in every trial." if kept else ""
    seed = f"seed {plan.data.seed}"
    if plan.data.kind == "monte-carlo":
        return (
            f"{plan.trials} simulated repetitions of the whole measurement, {seed}: the solution "
            "taken for the truth, normal noise as found in the residuals."
        )
    how = "with replacement" if plan.data.kind == "bootstrap" else "without replacement"
    what = described(plan.data.sets.unit)
    return (
        f"{plan.trials} draws each, {how}, from {len(plan.data.sets)} sets, {seed}; a set is "
        f"{what}.{whole}"
    )


def _errors(study: SizeStudy) -> str:
    nominal = text(study.uncalibrated, "m", with_unit=True)
    found = f"Errors are RMS on {held_out(study.plan)}"
    found += f"; uncalibrated {nominal}." if nominal != NOTHING else "."
    chosen = next((s for s in study.sizes if s.size == study.recommended), None)
    if chosen is not None and len(chosen.rms) > 1:
        low, high = text(chosen.minimum, "m"), text(chosen.maximum, "m", with_unit=True)
        found += f" With {chosen.size}, single calibrations reach {low} to {high}."
    return (
        f"{found} The scatter is between subsets of the same sets, which overlap the more the "
        "larger they are."
    )


def _scatter(study: SpreadStudy) -> list[str]:
    bootstrap = study.plan.data.kind == "bootstrap"
    predicted = "of the calibration with all data" if bootstrap else "root mean square over trials"
    found = [
        f"Predicted: standard deviation {predicted}. Spread: standard deviation between trials "
        "that told the parameter, relative to the same held ones."
    ]
    silent = [n for n, p in study.parameters.items() if p.estimate.state not in TOLD]
    if silent:
        found.append(f"Not estimated with all data either: {listed(silent)}.")
    if any(p.priors and p.ratio < 1 for p in study.parameters.values()):
        found.append(
            "The job has priors, which are not drawn anew: what rests on them scatters less than "
            "its standard deviation says."
        )
    if not bootstrap:
        found += _against_own(study)
    if study.validation.enough:
        found.append(_held_out_spread(study))
    return found


def _held_out_spread(study: SpreadStudy) -> str:
    low, high = (text(v, "m") for v in study.validation.interval)
    full = text(study.full_rms, "m")
    with_all = "" if full == NOTHING else f"{full} mm with all data, "
    return (
        f"RMS error on {held_out(study.plan)}: {with_all}{text(study.validation.mean, 'm')} ± "
        f"{text(study.validation.std, 'm')} mm over the trials, 95 % of them {low} … {high} mm."
    )


def _against_own(study: SpreadStudy) -> list[str]:
    """A calibration whose model lacks something is less sure than its noise alone makes it."""
    told = [p for p in study.parameters.values() if p.estimate.std and p.predicted > 0]
    larger = max((p.estimate.std / p.predicted for p in told if p.estimate.std), default=0.0)
    if larger < NOTEWORTHY:
        return []
    return [
        f"The calibration's own standard deviations are up to {larger:.1f} times as large: they "
        "count what the model lacks as well, which simulated noise does not contain."
    ]
