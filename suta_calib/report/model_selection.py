"""Report of a search for errors beside the geometry: the models, and the chosen one."""

from __future__ import annotations

from functools import partial
from textwrap import fill
from typing import Final

import numpy as np

from suta_calib.analysis.model_selection import ModelCandidate, ModelSelection
from suta_calib.analysis.model_selection.selection import SHORT
from suta_calib.model.parameters import Selection
from suta_calib.plotting.look import BLUE, ORANGE, WIDTH
from suta_calib.report.document import Document, Figure, Part, Text
from suta_calib.report.listing import Column, Json, Listing, written
from suta_calib.report.svg import picture, svg_text
from suta_calib.solver.solution import Estimate
from suta_calib.trust.extended_problem import LOOKS_LIKE
from suta_calib.trust.score_tests import ScoreTest
from suta_calib.units import key, shown, text, unit_name, with_std

NAME: Final = "extend"
TITLE: Final = "Errors other than geometry"
CAPTION: Final = (
    "RMS{unit}; an error beyond the Huber threshold counts as the threshold. Change: change of the "
    "variance of left-out rows compared with the job's model, ± its standard error over the folds."
)


def _estimate_text(e: Estimate) -> str:
    """``0.1998 ± 0.0021 deg``, or why there is no such number."""
    if e.std is None:
        return e.state.replace("_", " ")
    return with_std(e.value, e.std, e.unit)


def _looks_like(test: ScoreTest) -> str:
    """``an eccentric encoder (first harmonic)``."""
    return f"{LOOKS_LIKE[test.family]} ({SHORT.get(test.family, test.family)})"


# SI in JSON, as in result.json.
ADDED: Final = Listing[Estimate](
    "What it adds",
    Column("name", "parameter"),
    Column("value", "value", cell=_estimate_text),
    *written("std", "unit", "state"),
    key="estimates",
    named=True,
)
TESTS: Final = Listing[ScoreTest](
    "What the residuals of the job's model look like: probability if there is no such error",
    Column("joint", "joint"),
    Column("family", "looks like", cell=_looks_like),
    Column("p", "chance", form=".2g"),
    Column("p_beside_geometry", "beside geometry", form=".2g"),
    Column("parameters", None, lambda test: test.names),
    Column("suspicious"),
)


def model_selection_document(choice: ModelSelection) -> Document:
    """The models that were tried, and which rows to add to the job."""
    models, best = _models(choice), _best(choice)
    title = models.title
    if more := len(choice.tried) - len(best):
        title = f"{title} (and {more} worse ones: report.html has them all)"
    parts: list[Part] = [
        Figure(partial(models_plot, choice)),
        models.of(best, title, place="console"),
        models.of(choice.tried, place="page"),
        Text(CAPTION.format(unit=f" in {name}" if (name := unit_name(choice.unit)) else "")),
        Text(f"Left out, one after another: {'; '.join(choice.folds)}.", place="page"),
    ]
    if choice.validated is not None:
        job, chosen = (text(rms, choice.unit, with_unit=True) for rms in choice.validated)
        parts.append(
            Text(
                f"On the validation data: RMS {job} with the job's model, {chosen} with the "
                "chosen one."
            )
        )
    estimates = choice.solution.estimates
    parts.append(ADDED.of(estimates[name] for name in choice.added))
    if choice.rows:
        parts.append(Text("Add these rows to the key parameters of the job:"))
        parts += [Text(wrapped(row_text(row))) for row in choice.rows]
    most_tests = 6
    parts.append(TESTS.of(choice.tests[:most_tests], place="page"))
    return Document(NAME, TITLE, choice.assessment, parts, _data(choice))


def row_dict(row: Selection) -> Json:
    """A row of a job's ``parameters``."""
    sizes = {
        "bound_mm": row.bound_m and shown(row.bound_m, "m"),
        "bound_deg": row.bound_rad and shown(row.bound_rad, "rad"),
        "bound_deg_per_nm": row.bound_rad_per_nm and shown(row.bound_rad_per_nm, "rad/Nm"),
        "bound_kg": row.bound_kg,
        "bound_ppm_per_k": row.bound_per_k and shown(row.bound_per_k, "1/K"),
        "bound": row.bound_ratio,
    }
    stated = {key: float(f"{value:.6g}") for key, value in sizes.items() if value}
    return {"select": list(row.select), **stated}


def row_text(row: Selection) -> str:
    """The same as a line of YAML."""
    entries = row_dict(row)
    names = ", ".join(f'"{n}"' if "*" in n else n for n in entries.pop("select"))
    rest = "".join(f", {key}: {value:g}" for key, value in entries.items())
    return f"- {{select: [{names}]{rest}}}"


def wrapped(row: str) -> str:
    """A line of YAML, to be copied: what does not fit goes on indented, which YAML allows."""
    # Columns of a line of YAML.
    return fill(row, 78, initial_indent="  ", subsequent_indent=" " * 6, break_long_words=False)


def models_plot(choice: ModelSelection) -> str:
    """An SVG: fitted and held-out RMS of the best models that were tried."""
    models = sorted(_best(choice), key=lambda c: c.held_out.rms)
    names = [f"→ {short(m.name)}" if m is choice.chosen else short(m.name) for m in models]
    places = np.arange(len(models))
    with picture(NAME, (WIDTH, 1.3 + 0.3 * len(models))) as figure:
        axes = figure.subplots()
        for values, colour, mark, label in (
            ([m.fitted for m in models], ORANGE, "s", "fitted data"),
            ([m.held_out.rms for m in models], BLUE, "o", "data left out"),
        ):
            axes.plot(shown(np.array(values), choice.unit), places, mark, color=colour, label=label)
        axes.set_yticks(places, names, fontsize=8)
        axes.invert_yaxis()
        axes.grid()
        axes.set_xlim(left=0)
        axes.set_xlabel(f"RMS, {unit_name(choice.unit)} (arrow: chosen)")
        axes.legend(ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1))
        return svg_text(figure, NAME, "Errors of fitted and left-out rows for each model")


def short(name: str) -> str:
    """A name that fits beside a plot: models that grew from one another differ at the end."""
    # Letters of a name beside a plot.
    long = 60
    return name if len(name) < long else f"{name[: long // 3]} … {name[-(long - long // 3) :]}"


def _best(choice: ModelSelection) -> list[ModelCandidate]:
    """The job's own model, the chosen one, and the best of the others, as they were tried."""
    by_loss = sorted(choice.tried, key=lambda c: (c is not choice.chosen, c.held_out.loss))
    # Models that a terminal and the picture show.
    shown_ids = {id(c) for c in (choice.job, *by_loss[: 12 - 1])}
    return [c for c in choice.tried if id(c) in shown_ids]


def _models(choice: ModelSelection) -> Listing[ModelCandidate]:
    """Rows of the models: their errors as such, and against the job's own."""
    job = choice.job

    def against_job(name: str, head: str, k: int, sign: float) -> Column[ModelCandidate]:
        """Gain over the job's model (k = 0) or its standard error, as part of that one's loss."""

        def part(model: ModelCandidate) -> float:
            return sign * model.gain_over(job)[k] / job.held_out.loss

        def cell(model: ModelCandidate) -> str:
            return "" if model is job else text(part(model), "%", sign=sign < 0)

        return Column(name, head, part, "%", cell=cell)

    def name(model: ModelCandidate) -> str:
        return f"{model.name} ←" if model is choice.chosen else model.name

    return Listing(
        "Models, cross-validated",
        Column("name", "unknowns beside the job's", cell=name),
        Column("fitted_rms", "fitted", lambda m: m.fitted, choice.unit),
        Column("held_out_rms", "left out", lambda m: m.held_out.rms, choice.unit),
        against_job("held_out_variance_change", "change, %", 0, -1.0),
        against_job("standard_error", "± error", 1, 1.0),
        Column("unknowns", None, lambda m: len(m.parameters)),
        Column("all_geometry", None, lambda m: m.geometry),
        Column("beside_geometry", None, lambda m: m.added),
        Column("outdoes_job", None, lambda m: m is not job and m.outdoes(job)),
        Column("chosen", None, lambda m: m is choice.chosen),
        key="models",
    )


def _data(choice: ModelSelection) -> Json:
    validated = None
    if choice.validated is not None:
        job, chosen = (shown(rms, choice.unit) for rms in choice.validated)
        validated = {key("job_rms", choice.unit): job, key("chosen_rms", choice.unit): chosen}
    return {
        "chosen": choice.chosen.name,
        "added": list(choice.added),
        "all_geometry": choice.chosen.geometry,
        "undecided": choice.undecided,
        "rows": [row_dict(row) for row in choice.rows],
        "gear_ratios": {gear.joint: gear.ratio for gear in choice.gears},
        "folds": list(choice.folds),
        "residual_tests": TESTS.records(choice.tests),
        "validation": validated,
    }
