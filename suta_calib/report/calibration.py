"""Report of a calibration: console, ``result.json``, ``residuals.csv``, ``report.html``.

A result that did not converge carries no values: ``value``, ``std`` and the metrics ``after`` are
null, so that nobody uses them by accident.
"""

from __future__ import annotations

import platform
import shlex
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from importlib import import_module
from typing import Any, Final

import numpy as np

from suta_calib import report
from suta_calib.job import inputs_copy
from suta_calib.job.calibration import Calibration
from suta_calib.plotting.look import MOST_CORRELATED, MOST_GROUPS
from suta_calib.pose_calibration.measured_markers import measured_boards
from suta_calib.report.calibration_tables import (
    ABOUT,
    COMBINATIONS,
    EXTERNAL_POSES,
    HELD_OUT,
    IN_SHORT,
    LINE_DELAYS,
    NOISE,
    NOTE,
    NOTE_CLOCKS,
    NOTE_GIVEN,
    PRIORS,
    REPEATABILITY,
    SCALE,
    STARTS,
    TIME_OFFSETS,
    held_out_rows,
    noise_of,
    priors_of,
    repeatability_of,
)
from suta_calib.report.document import (
    Document,
    Figure,
    File,
    Part,
    SpatialFigure,
    Text,
    entry,
    remark,
    section,
)
from suta_calib.report.errors import (
    RESIDUALS,
    RESIDUALS_OF_CHAINS,
    accuracy_json,
    by_kind,
    errors_in_short,
    errors_table,
    far_rows,
    groupings,
    groups,
    residual_rows,
)
from suta_calib.report.listing import Json, Place, csv_of_groups
from suta_calib.report.markers import marker_parts, marker_records
from suta_calib.report.observability import (
    HELD,
    MANY,
    MOST_SENTENCES,
    PARAMETERS,
    Outcome,
    explained,
    held_directions,
    outcomes,
    state_shown,
    unobservable,
)
from suta_calib.report.uncertainty import budget_record, budget_table
from suta_calib.solver.identifiability import WEAK
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term
from suta_calib.trust.accuracy import TermAccuracy
from suta_calib.trust.clocks import line_delays
from suta_calib.trust.explanation import redundant_names
from suta_calib.trust.rich_data import LEVER
from suta_calib.units import text
from suta_calib.words import combination

NAME: Final = "result"
CALIBRATED: Final = "calibrated.urdf"
# The same for a result that must not be used, under a name that shows it is not calibrated.
NOT_USABLE: Final = "not_usable.urdf"
# What computes a result, by the name that it is installed under, and as a module.
COMPUTED_BY: Final = {
    "suta_calib": "suta_calib",
    "pin": "pinocchio",
    "casadi": "casadi",
    "numpy": "numpy",
}


def calibration_document(result: Calibration) -> Document:
    """Document of a calibration: errors, parameters, and what the data cannot determine."""
    parts = [
        *section("the first screen", lambda: _first_screen(result)),
        *section("errors", lambda: _errors(result)),
        *section("parameters", lambda: _parameters(result)),
        *section("clocks", lambda: _clocks(result)),
        *section("external poses", lambda: _external_poses(result)),
        *section("markers", lambda: _markers(result)),
        *section("what these data cannot determine", lambda: _untold(result)),
        *section("remaining errors", lambda: _remaining_errors(result)),
        *section("noise and correlations", lambda: _noise_and_correlations(result)),
        *section("how it was computed", lambda: _computation(result)),
        *section("what to do next", lambda: _next_steps(result)),
        *_files(result),
    ]
    title = f"Calibration of {result.job.title}"
    return Document(
        NAME, title, result.assessment, parts, _data(result), "opening", result.headline
    )


@cache
def versions() -> Mapping[str, str]:
    """Versions of the packages that computed the result."""
    installed = {name: str(import_module(it).__version__) for name, it in COMPUTED_BY.items()}
    return {"python": platform.python_version()} | installed


def _svg(plot: str, *arguments: Any) -> str:
    """One of `calibration_plots`, which is imported when it is drawn: a console needs none."""
    svg: str = getattr(report, plot)(*arguments)
    return svg


# What is shown


def _first_screen(result: Calibration) -> Iterator[Part]:
    """The arm with its errors, and what the figures are of."""
    if result.solution.converged:
        yield SpatialFigure(result.scene)
    yield ABOUT.of(_about(result), place="page")


def _about(result: Calibration) -> Iterator[tuple[str, str]]:
    job, solution = result.job, result.solution
    ends = [(len(a.own_joints), a.chain.base, a.chain.tip) for a in job.arm.arms]
    chains = "; ".join(f"{count} joints from {base} to {tip}" for count, base, tip in ends)
    yield "arm", f"{job.arm.robot}, {chains}; {job.arm.urdf[0].name}"
    for name, terms in (("fitted", job.observations), ("validation", job.validation)):
        yield name, "; ".join(map(_counted, terms)) or "nothing"
    estimated = sum(e.std is not None for e in solution.arm_estimates.values())
    term_unknowns = len(solution.problem.parameters) - solution.problem.arm_count
    of_data = (
        f"; {term_unknowns} unknowns of the observations (poses and places)"
        if term_unknowns
        else ""
    )
    yield "unknowns", f"{estimated} of {solution.problem.arm_count} of the arm estimated{of_data}"
    yield "made with", " · ".join(f"{name} {number}" for name, number in versions().items())


def _counted(term: Term) -> str:
    """``225 samples of pairwise_distance, 1,575 distances, at 5 places``."""
    block, samples = term.blocks[0], term.poses.samples
    of = f"{term.kind} of {term.poses.chain}" if term.poses.chain else term.kind
    sentence = f"{len(samples):,} samples of {of}"
    if len(block) != len(samples):
        sentence += f", {len(block):,} {block.name}s"
    if term.place in samples.labels:
        places = len(set(samples.labels[term.place].tolist()))
        sentence += f", at {places} place{'s' * (places != 1)}"
    return sentence


def _parameters(result: Calibration) -> Iterator[Part]:
    solution = result.solution
    if not solution.converged:
        return
    every = outcomes(result.examined)
    arm, of_terms = every[: solution.problem.arm_count], every[solution.problem.arm_count :]
    if largest := ", ".join(_largest_changes(arm)):
        yield Text(f"Largest changes (± one standard deviation): {largest}.", place="console")
    # What is no pose, such as a camera's intrinsics or a radius, is shown nowhere else.
    posed = {name for pose in result.examined.external_poses for name in pose.frame.names}
    posed |= {clock.name for clock in result.examined.clock_offsets}
    posed |= {delay.name for delay in line_delays(solution)}
    alone = [row for row in of_terms if row.estimate.name not in posed]
    if len(alone) <= MANY:
        yield PARAMETERS.of(alone, "Unknowns of the observations, without poses", place="console")
    yield PARAMETERS.of(every, place="verbose")
    estimated = [row for row in arm if row.change is not None]
    yield PARAMETERS.of(estimated, place="page")
    if any(row.state == "prior" for row in estimated):
        yield remark("“prior”: mostly known beforehand; the data determine it only a little.")
    if held := len(arm) - len(estimated):
        s, keep = ("s", "keep their") if held > 1 else ("", "keeps its")
        yield remark(
            f"{held} more parameter{s} {keep} nominal value{s}. The reason is under “What these "
            "data cannot determine”."
        )
    if changes := solution.changes:
        yield Figure(
            partial(_svg, "changes_svg", changes, "parameter-changes"),
            "Change from nominal, ± one standard deviation",
        )
    changed = [row for row in of_terms if row.change is not None]
    yield PARAMETERS.of(changed, f"Unknowns of the observations ({len(changed)})", folded=True)


def _largest_changes(arm: Sequence[Outcome]) -> Iterator[str]:
    """Of lengths and of angles, the parameters that moved farthest."""
    most = 2
    for unit in ("m", "rad"):
        rows = [row for row in arm if row.unit == unit and row.change and row.estimate.std]
        for row in sorted(rows, key=lambda row: -abs(row.change or 0.0))[:most]:
            change, std = text(row.change or 0.0, unit, sign=True), row.estimate.std or 0.0
            yield f"{row.estimate.name} {change} ± {text(std, unit, with_unit=True)}"


def _command(finds: str, line: str) -> Text:
    """A line to copy, which a narrow console must not break."""
    return Text(f"{line}    # {finds}", place="console", look="verbatim")


def _next_steps(result: Calibration) -> Iterator[Part]:
    """Commands to copy, each where it would help."""
    job = shlex.quote(str(result.job.spec.path))
    if not (result.job.files and result.solution.converged):
        return
    notes = " ".join(result.assessment.notes)
    if "suta-calib outliers" in notes:
        yield _command("which rows are wrong", f"suta-calib outliers {job}")
    if any(e.reason != "redundant" for e in result.explanations):
        yield _command("what to measure next", f"suta-calib plan {job} -n 4")


def _clocks(result: Calibration) -> Iterator[Part]:
    """How late what was seen is beside what was read."""
    if clocks := result.examined.clock_offsets:
        yield TIME_OFFSETS.of(clocks)
        yield remark(NOTE_CLOCKS)
    if delays := line_delays(result.solution):
        yield LINE_DELAYS.of(delays)


def _external_poses(result: Calibration) -> Iterator[Part]:
    """What many came for: where cameras, instruments and artefacts are."""
    if poses := result.examined.external_poses:
        # The poses of several placements of an artefact are not of interest.
        few, placements = 3, sum(pose.frame.what == "placement" for pose in poses)
        shown = len(poses) <= few and placements <= 1
        yield IN_SHORT.of(poses, place="console" if shown else "verbose")
        yield EXTERNAL_POSES.of(poses, place="page")
        yield remark(f"{NOTE} {NOTE_GIVEN}" if any(pose.given for pose in poses) else NOTE)


def _markers(result: Calibration) -> Iterator[Part]:
    """Where markers are that nobody had measured."""
    boards = measured_boards(result.solution) if result.solution.converged else {}
    for label, board in boards.items():
        yield from marker_parts(board, label if len(boards) > 1 else "")


def _errors(result: Calibration) -> Iterator[Part]:
    accuracy = result.accuracy
    sets = {"calibration": accuracy.calibration, "validation": accuracy.validation}
    held_out_first = {name: sets[name] for name in ("validation", "calibration")}
    yield errors_in_short(held_out_first)
    if result.solution.converged:
        yield from far_rows(accuracy.calibration)
    yield errors_table(sets, place="detail")
    if not result.solution.converged:
        yield Text(
            "The fit did not converge: “after” is where the solver stopped, and must not be used."
        )
    yield remark(
        "Every error counts here, also rows to which the robust fit gave less weight. Improvement "
        "is that of the RMS."
    )
    if result.solution.converged:
        if held_out := [*held_out_rows(result)]:
            yield HELD_OUT.of(held_out, place="detail")
            yield remark(
                "Predicted: the standard deviation from the scatter of the fitted errors and from "
                "the covariance of the parameters. About 68 % (95 %) of the errors should lie "
                "within 1 (2) predicted standard deviations."
            )
        yield REPEATABILITY.of(repeatability_of(result), place="detail")
    # Held-out errors are what a user of the arm will see: they come first.
    for name in ("validation", "calibration"):
        for k, errors in enumerate(by_kind(sets[name], by_chain=True)):
            if len(errors.before):
                drawn = errors.before, errors.after, errors.unit, errors.name
                yield Figure(
                    partial(_svg, "histogram_svg", *drawn, f"histogram-{name}-{k}"),
                    f"{name.capitalize()}: {errors.quantity}",
                )


def _untold(result: Calibration) -> Iterator[Part]:
    solution = result.solution
    combinations = solution.identification.combinations
    moving = [_that_move(solution, c.direction) for c in combinations]
    named = [combination(group, c.fixed) for group, c in zip(moving, combinations, strict=True)]
    if solution.converged:
        arm = set(solution.problem.names[: solution.problem.arm_count])
        of_arm = [e for e in result.explanations if e.fixed in arm or not arm]
        untold = any(e.reason != "redundant" for e in of_arm)
        place: Place = "detail" if untold else "page"
        yield Text("What these data cannot determine", place=place, look="heading")
        yield from explained([e for e in of_arm if not e.failed], "verbose", MOST_SENTENCES)
        yield from explained([e for e in of_arm if e.failed], "console", MOST_SENTENCES)
        yield from explained([e for e in result.explanations if e.reason != "redundant"], "page")
        if not result.explanations:
            yield Text("Nothing: every parameter that the job frees was estimated.", place="page")
        yield from _held(result)
        several = [name for name, group in zip(named, moving, strict=True) if len(group) > 1]
        if several:
            yield COMBINATIONS.of(
                several, f"Combinations that change no observation ({len(several)})", folded=True
            )
    values = solution.identification.singular_values
    if len(values):
        yield Figure(
            partial(_svg, "singular_values_svg", values, 1.0 / WEAK, named, "singular-values"),
            "Singular values: how well the data determine each combination of parameters",
        )


def _held(result: Calibration) -> Iterator[Part]:
    """Parameters at nominal that no sentence above names, each once and with its reason."""
    every = outcomes(result.examined)
    why = {e.fixed: e.sentence for e in result.explanations if e.reason == "redundant"}
    named = {e.fixed for e in result.explanations} - why.keys()
    rows = []
    for row in every:
        name = row.estimate.name
        if row.change is None and name not in named:
            # Its name stands in the first column.
            reason = why.get(name, "fixed in the job").removeprefix(f"{name} ")
            rows.append((row, reason))
    if not rows:
        return
    # More of them fill a screen.
    few = 8
    title, folded = f"{HELD.title} ({len(rows)})", len(rows) > few
    if not folded:
        yield Text(f"{title}:", place="page")
    yield HELD.of(rows, title if folded else "", place="page", folded=folded)
    states = {state_shown(row) for row, _ in rows}
    if "redundant" in states:
        yield remark(
            "“redundant”: harmless. No data of these kinds can determine it, and it never moves "
            "the tip: its nominal value is a convention."
        )
    if "as drawn" in states:
        yield remark(
            "“as drawn”: no data of these kinds can determine it, but the tip depends on it. There "
            "the tip is only as good as the drawing."
        )


def _that_move(solution: Solution, direction: Mapping[str, float]) -> dict[str, float]:
    """Of a combination, the factors whose parameters do something at the tip."""
    # Of the largest motion, a part that is nothing.
    nothing = 0.01
    parameters = solution.problem.parameters
    moves = {
        name: abs(factor) * (LEVER if parameters[name].unit == "rad" else 1.0)
        for name, factor in direction.items()
    }
    least = nothing * max(moves.values(), default=0.0)
    return {name: factor for name, factor in direction.items() if moves[name] >= least}


def _remaining_errors(result: Calibration) -> Iterator[Part]:
    accuracy, figures = result.accuracy, list[Figure]()
    for name, terms in (("Validation", accuracy.validation), ("Calibration", accuracy.calibration)):
        of = {label: groups(terms, label) for label in (*groupings(), "file")}
        labels = [label for label in groupings() if len(of[label]) > 1]
        # Files are usually split by label: only without labels are they of interest.
        for label in labels or ["file"] * (len(of["file"]) > 1):
            rest = len(of[label]) - MOST_GROUPS
            title = f"{name}: by {label}" + (f" (without the {rest} best)" if rest > 0 else "")
            svg_name = f"errors-{name.lower()}-{label}"
            unit = terms[0].term.error_unit
            figures.append(
                Figure(partial(_svg, "groups_svg", of[label], label, svg_name, unit), title)
            )
    if figures:
        yield Text("Where the remaining errors are", place="page", look="heading")
        yield from figures


def _noise_and_correlations(result: Calibration) -> Iterator[Part]:
    solution = result.solution
    yield NOISE.of(noise_of(result), place="page")
    yield remark(
        "Standard deviation per axis. The standard deviations of the parameters follow from the "
        "values found here."
    )
    if priors := priors_of(result):
        yield PRIORS.of(priors, place="page")
        yield remark(
            "The width of the priors was estimated together with the noise. A factor below one "
            "pulls estimates closer to nominal; a parameter that the data do not determine keeps "
            "the ± of its prior as given. fixed: true beside a prior or a noise level keeps it as "
            "given."
        )
    if (budget := result.examined.tip_budget) is not None:
        yield budget_table(budget, "What the uncertainty of the tip is made of")
        yield remark(
            f"Of {budget.of}. Type A: from scatter. Type B: from what a certificate, a drawing or "
            "the job states."
        )
    names, matrix = solution.correlation(arm=True) if solution.converged else ((), np.eye(0))
    if len(names) < 2:
        return
    yield Text("Correlations", place="page", look="heading")
    if (less := len(names) - MOST_CORRELATED) > 0:
        note = f"{less} parameters with weaker correlations are left out; result.json has all."
        yield remark(note)
    yield Figure(partial(_svg, "correlations_svg", names, matrix, "correlations"))


def _computation(result: Calibration) -> Iterator[Part]:
    solution, path = result.solution, result.job.spec.path
    best = solution.minimum
    phases = ", ".join(f"{phase} {seconds:.3f} s" for phase, seconds in solution.timing.items())
    yield STARTS.of(enumerate(solution.attempts, start=1), place="page")
    yield Text(
        f"{best.solver}: {best.status} after {best.iterations} iterations, cost {best.cost:.6g}. "
        f"{phases}.",
        place="page",
    )
    if result.job.files:
        yield Text(path.name, place="page", look="heading")
        try:
            job = path.read_text(encoding="utf-8", errors="replace")
        except OSError:
            job = "(the job file no longer exists)"
        yield Text(job, place="page", look="verbatim")
    if not result.assessment.usable:
        instead = f". The result is in {NOT_USABLE}" if solution.converged else ""
        yield Text(f"No {CALIBRATED} is written{instead}.")


# What is written


def _files(result: Calibration) -> list[File]:
    """A solution that did not converge has none; one not to be used has another URDF's name."""
    solution, job = result.solution, result.job
    if not solution.converged:
        return []
    return [
        File(
            CALIBRATED if result.assessment.usable else NOT_USABLE,
            lambda: result.job.arm.calibrated_urdf(solution.values),
        ),
        *(
            File(f"{name.removesuffix('.urdf')}_{robot}.urdf", partial(bytes, data))
            for name in [CALIBRATED if result.assessment.usable else NOT_USABLE]
            for robot, data in result.job.arm.calibrated_urdfs(solution.values).items()
        ),
        File("residuals.csv", lambda: _residuals(result)),
        # With what it was made of the folder can go elsewhere; arrays are in no file.
        *(
            [File(inputs_copy.NAME, lambda: inputs_copy.packed(job.spec.path, job.files))]
            if job.files
            else []
        ),
    ]


def _data(result: Calibration) -> Json:
    solution = result.solution
    # The time before the first iteration is the observability analysis.
    timing = {"build": solution.timing.get("check", 0.0)} | solution.timing
    best, starts = (
        STARTS.record((0, solution.minimum)),
        STARTS.records(enumerate(solution.attempts, start=1)),
    )
    return {
        "status": "converged" if solution.converged else "not_converged",
        "job": result.job.spec.path.name,
        "parameters": PARAMETERS.records(outcomes(result.examined)),
        "external_poses": entry(
            "external_poses", lambda: EXTERNAL_POSES.records(result.examined.external_poses)
        ),
        "markers": entry(
            "markers",
            lambda: {
                name: marker_records(board) for name, board in measured_boards(solution).items()
            },
        ),
        "time_offsets": entry(
            "time_offsets", lambda: TIME_OFFSETS.records(result.examined.clock_offsets)
        ),
        "line_delays": LINE_DELAYS.records(line_delays(solution)),
        "unidentified": solution.unidentified,
        "redundant": entry("redundant", lambda: redundant_names(result.explanations)),
        "unobservable": unobservable(solution.identification),
        "widening": solution.widening,
        "held": entry("held", lambda: held_directions(solution)),
        "scale": entry("scale", lambda: SCALE.records(result.examined.scale_effects)),
        "uncertainty": entry("uncertainty", lambda: _uncertainty(result)),
        # Samples that rows of the job leave out by name.
        "excluded": [
            {"in": f"{name}[{k}]", "kind": row.kind, **row.exclude.as_dict()}
            for name in ("observations", "validation")
            for k, row in enumerate(getattr(result.job.spec, name))
            if row.exclude is not None
        ],
        "metrics": entry("metrics", lambda: _metrics(result)),
        "repeatability": entry(
            "repeatability", lambda: REPEATABILITY.records(repeatability_of(result))
        ),
        "timing_s": timing,
        **matrices_of(solution),
        "noise": entry("noise", lambda: NOISE.records(noise_of(result))),
        "priors": entry("priors", lambda: PRIORS.records(priors_of(result))),
        "solver": {"name": solution.minimum.solver, **best, "starts": starts},
        "versions": versions(),
    }


def _uncertainty(result: Calibration) -> list[Json]:
    budget = result.examined.tip_budget
    return [] if budget is None else [budget_record(budget)]


def _residuals(result: Calibration) -> str:
    """Every error as CSV, with a column of the chain where a robot has several."""
    sets = result.labelled_terms
    several = any(term.term.poses.chain for labelled in sets.values() for _, term in labelled)
    return csv_of_groups(RESIDUALS_OF_CHAINS if several else RESIDUALS, residual_rows(sets))


def _metrics(result: Calibration) -> Json:
    """Of each set of data, the figures of the first term's kind and those of each term."""

    def of_first_kind(terms: Sequence[TermAccuracy]) -> Json:
        figures = accuracy_json(terms)
        if not result.solution.converged:
            after = figures["after"]
            figures["after"] = {k: v if k == "count" else None for k, v in after.items()}
        return dict(figures)

    def of_sets(chain: str | None) -> Json:
        content: Json = {}
        for name, every in result.labelled_terms.items():
            labelled = [(la, t) for la, t in every if chain in (None, t.term.poses.chain)]
            by_term = [
                {"kind": term.term.kind, "label": label} | of_first_kind([term])
                for label, term in labelled
            ]
            content[name] = {**of_first_kind([term for _, term in labelled]), "by_term": by_term}
        return content

    terms = (term for labelled in result.labelled_terms.values() for _, term in labelled)
    chains = dict.fromkeys(term.term.poses.chain for term in terms)
    by_chain = {chain: of_sets(chain) for chain in chains if chain}
    return {**of_sets(None), **({"by_chain": by_chain} if by_chain else {})}


def matrices_of(solution: Solution) -> Mapping[str, Any]:
    """Of the arm's estimated parameters, with the standard deviations told of each.

    The covariance has those too that are held, and that the tip hangs on though nothing shows it.
    """
    names = more = tuple[str, ...]()
    correlation = covariance = np.zeros((0, 0))
    if solution.converged:
        names, correlation = solution.correlation(arm=True)
        std = np.array([solution.estimates[name].std for name in names], dtype=float)
        covariance = correlation * np.outer(std, std)
        if (held := solution.spread.held) is not None:
            rows, more = [solution.problem.names.index(name) for name in names], held.names
            across = held.of_estimate[rows] @ held.of_held.T
            square = held.of_held @ held.of_held.T
            covariance = np.block([[covariance, across], [across.T, square]])
    return {
        "correlations": {"parameters": names, "matrix": np.round(correlation, 4)},
        "covariance": {"parameters": (*names, *more), "unit": "m, rad", "matrix": covariance},
    }
