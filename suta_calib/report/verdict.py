"""Whether a result may be used, in one word and a few sentences."""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.assessment import Assessment, Level
from suta_calib.diagnostics.accuracy import Accuracy
from suta_calib.diagnostics.lack_of_fit import LackOfFit, lack_of_fit
from suta_calib.diagnostics.score_tests import score_tests
from suta_calib.report.result import Result, arm_estimates
from suta_calib.solver.solution import Solution, State
from suta_calib.units import text

# Noise that differs from what the job states by more than this factor deserves a word.
SURPRISING: Final = 2.0
# Residuals over the scatter of repeats from which a model is said to lack something.
LACKING: Final = 1.5
MOST_NAMES: Final = 6
# Equations beyond the unknowns from which on residuals tell the noise to a third or so.
REDUNDANT: Final = 6


def judge(result: Result) -> Assessment:
    """Weigh convergence, held-out errors, bounds and what could not be told."""
    solution = result.solution
    if not solution.converged:
        return Assessment("bad", solution.sentence, ("No calibrated URDF is written.",))
    notes = (
        *_on_validation(result.accuracy),
        *_on_parameters(solution),
        *_on_fit(solution),
        *_beside_geometry(solution),
        *_on_noise(solution),
        *_on_exclusions(result),
        *_on_seating(result),
    )
    worse = _validation_change(result.accuracy) > 0
    level: Level = "bad" if worse else "care" if notes else "good"
    return Assessment(level, solution.sentence, notes)


def _validation_change(accuracy: Accuracy) -> float:
    before = Accuracy.overall(accuracy.validation, "before").rms
    return Accuracy.overall(accuracy.validation, "after").rms - before


def _on_validation(accuracy: Accuracy) -> list[str]:
    if not accuracy.validation:
        return ["There are no validation data: the errors shown are those of the fitted data."]
    if _validation_change(accuracy) > 0:
        return ["The calibrated arm is worse than the nominal one on the validation data."]
    return []


def _on_parameters(solution: Solution) -> list[str]:
    states: dict[State, list[str]] = {}
    for name, estimate in arm_estimates(solution).items():
        states.setdefault(estimate.state, []).append(name)
    notes = []
    if held := states.get("unidentified"):
        notes.append(f"These data cannot tell {listed(held)}: held at nominal.")
    if bounded := states.get("at_bound"):
        notes.append(
            f"{listed(bounded)} ended at a bound: widen it, or look for the wrong unit or "
            "the wrong artefact."
        )
    return notes


def _on_fit(solution: Solution) -> list[str]:
    lacking = [_lacking(fit) for fit in lack_of_fit(solution) if fit.ratio > LACKING]
    return [*_redundancy(solution), *lacking]


def _redundancy(solution: Solution) -> list[str]:
    """Noise that is learnt from few residuals may be off by half, and every ± with it."""
    problem = solution.problem
    equations = sum(term.equations() for term in problem.terms)
    known = int(np.count_nonzero(problem.prior_precision()[solution.free]))
    left = equations + known - len(solution.free)
    if left >= REDUNDANT:
        return []
    return [
        f"{equations} independent equations for {len(solution.free)} unknowns: so few to spare "
        "tell little of the noise, and every ± may be several times too small. Measure more."
    ]


def _lacking(fit: LackOfFit) -> str:
    found = text(fit.residual, fit.unit, with_unit=True)
    explained = text(fit.repeat, fit.unit, with_unit=True)
    return (
        f"The residuals ({found}) are {fit.ratio:.1f} times what repeats of the same touch scatter "
        f"({explained}): the model lacks something. Values and ± hold only within it; free more "
        "of the geometry (select: geometric)."
    )


def _beside_geometry(solution: Solution) -> list[str]:
    """What a URDF cannot hold, and what the residuals look like beside geometry."""
    notes = []
    parameters = solution.problem.parameters
    values = {n: e.value for n, e in arm_estimates(solution).items()}
    if held := [n for n, value in values.items() if value and not parameters[n].geometric]:
        notes.append(
            f"A URDF cannot hold {listed(held)}: calibrated.urdf is the geometry only, and its tip "
            "is right only with the corrections in result.json (track and validate apply them "
            "with --result)."
        )
    suspects: dict[str, None] = {}
    for test in score_tests(solution):
        if test.suspicious:
            what = "a joint that yields" if test.family == "compliance" else "an eccentric encoder"
            suspects.setdefault(f"{test.joint} look like {what}")
    if suspects:
        notes.append(
            f"The residuals of {next(iter(suspects))}: run suta-calib extend, which says whether "
            "such a term predicts left-out data better."
        )
    return notes


def _on_noise(solution: Solution) -> list[str]:
    notes = []
    blocks = solution.problem.blocks
    for block, assumed, found in zip(blocks, solution.sigmas, solution.noise, strict=True):
        if block.noise.sigma is not None and not 1 / SURPRISING < found / assumed < SURPRISING:
            notes.append(
                f"The {block.name} residuals scatter by {text(found, block.unit, with_unit=True)}; "
                f"the job says {text(assumed, block.unit, with_unit=True)}."
            )
    return notes


def _on_exclusions(result: Result) -> list[str]:
    spec = result.job.spec
    rows = (*spec.observations, *spec.validation)
    return [f"The job excludes {r.exclude} from {r.kind}." for r in rows if r.exclude is not None]


def _on_seating(result: Result) -> list[str]:
    """Held-out touches of an artefact whose sockets only the observations know to be wide."""
    spec = result.job.spec
    wide = {r.artefact for r in spec.observations if r.seated}
    tight = [r for r in spec.validation if not r.seated]
    return [
        f"The validation row of {r.kind} has no seating, and the observations of the same artefact "
        "do: its errors hold what the seating would take away. Give it the same key."
        for r in tight
        if r.artefact is not None and r.artefact in wide
    ]


def listed(names: list[str], most: int = MOST_NAMES) -> str:
    """Names in a sentence; only a count of those beyond the first few."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")
