"""What contradicts an answer: its residuals, its priors, its held-out samples, its own starts.

Converged is not true: with enough unknowns and priors a solver explains rows in the wrong order.
Each check compares two things that agree for honest data, whatever the arm, in units of what is
known of them; robustly, so that a few gross rows accuse nobody.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from suta_calib.solver.evaluation import Linearised
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term
from suta_calib.trust.accuracy import fitted_too
from suta_calib.trust.common_scale import CommonScale, beyond_drawing, common_scales
from suta_calib.trust.held_out import HeldOutErrors, robust_level
from suta_calib.trust.patterns import matches
from suta_calib.trust.repeats import noise_of_rows
from suta_calib.units import text


@dataclass(frozen=True)
class ContradictionOptions:
    """From where on two things that should agree do not.

    Attributes:
        residual: residuals' level over the noise that the job states, or that is assumed: ten times
            as much is no matter of a careful or a careless hand.
        residual_care: the same from which on it must be known.
        unexplained: residuals over what rows themselves scatter, from which on noise is no
            explanation: neighbours' estimate is right to a fifth, and the model's error in it.
        gross_level: times the level of most beyond which a row is gross: normal noise has one in a
            million, a hand's measurement some in a hundred.
        gross_care, gross_bad: shares of them from which on it must be known, and that no touch
            explains.
        gross_plain: the same share as the first where plain least squares follow every row.
        gross_weight: share of the sum of squares that such rows have there: however few they are,
            they decide more than all others.
        pull, pull_care: parameters this many prior standard deviations from nominal; two in 10⁶ of
            what a prior means is five off.
        held_out, held_out_care: held-out errors over what noise and covariance make one expect;
            another day or another hand may double them.
        significance: standard errors that a ratio must be off before it says anything.
        scale, scale_care: a common factor on all lengths of an artefact or an instrument, or of the
            arm: half a per cent moves a tip at arm's length by millimetres.
        scale_most: beyond which it is no scale, but data that do not fit.
        scale_significance: standard deviations that it must be off.
        scale_by_priors: the same to refuse an answer where priors alone speak against it: of 42
            sound sets one had an arm that was four prior standard deviations long.
        scale_of_arm: the same of the arm's lengths, which say it only by growing evenly; so many
            below the estimate, the factor must still be more than ``scale_care``.
        scale_gain: share of the priors' pulls or the residuals that it must explain.
        starts: share of the starts that must end in the same minimum.
    """

    residual: float = 10.0
    residual_care: float = 3.0
    unexplained: float = 2.0
    gross_level: float = 5.0
    gross_care: float = 0.1
    gross_bad: float = 0.35
    gross_plain: float = 0.02
    gross_weight: float = 0.5
    pull: float = 10.0
    pull_care: float = 5.0
    held_out: float = 3.0
    held_out_care: float = 1.7
    significance: float = 4.0
    scale: float = 5e-3
    scale_care: float = 2e-3
    scale_most: float = 0.1
    scale_significance: float = 4.0
    scale_by_priors: float = 6.0
    scale_of_arm: float = 2.0
    scale_gain: float = 0.5
    starts: float = 0.5


@dataclass(frozen=True)
class Contradiction:
    """One disagreement.

    Attributes:
        bad: whether the answer must not be used because of it.
        sentence: what disagrees, and by how much.
    """

    bad: bool
    sentence: str


def contradictions(
    solution: Solution,
    held_out: Sequence[HeldOutErrors],
    options: ContradictionOptions = ContradictionOptions(),
) -> tuple[Contradiction, ...]:
    """Everything that disagrees with a converged answer, the worst first.

    Args:
        solution: of terms over an arm.
        held_out: its held-out errors.
        options: from where on it counts.
    """
    residuals = list(_residuals(solution, options))
    disagreements = [
        *residuals,
        *_held_out(solution, held_out, options),
        # What does not fit at all has no scale.
        *([] if any(residual.bad for residual in residuals) else _scales(solution, options)),
        *_priors(solution, options),
        *(Contradiction(False, m.sentence) for m in matches(solution, "cause", "note")),
        *_repeated(solution, list(dict.fromkeys(item.term for item in held_out))),
    ]
    same, tried = solution.agreeing, len(solution.attempts)
    if tried > 1 and same < options.starts * tried:
        sentence = (
            f"Only {same} of {tried} starts ended in this minimum: there may be a better one, or "
            "the data fit none well. Tighten the bounds, or raise solver.starts."
        )
        disagreements.append(Contradiction(False, sentence))
    return tuple(sorted(disagreements, key=lambda item: not item.bad))


def _residuals(solution: Solution, options: ContradictionOptions) -> Iterator[Contradiction]:
    """Of each block against the noise that is stated, and against one another."""
    problem = solution.problem
    sigmas = problem.assumed_sigmas()
    lines = problem.linearise(solution.x, sigmas)
    units = _noise_units(problem)
    blocks = zip(lines, units, sigmas, solution.noise, strict=True)
    for k, (line, unit, assumed, learnt) in enumerate(blocks):
        block, level = line.view.block, robust_level(line.residual)
        given = block.noise.sigma is not None
        times = level / float(np.median(line.sigma))
        scatter, stated = (text(v, block.unit, with_unit=True) for v in (level, assumed))
        if given and times > options.residual_care:
            yield Contradiction(
                times > options.residual,
                f"The {block.name} residuals are {scatter} per axis, {times:.0f} times the "
                f"{stated} that the job states: the data do not fit this arm. If the instrument "
                f"really has so much noise, state it (sigma_{unit}).",
            )
        elif not given and times > options.residual_care:
            yield from _unstated(solution, k, times, unit, options)
        elif given and learnt * options.residual_care < assumed:
            yield Contradiction(
                False,
                f"The {block.name} residuals are {text(learnt, block.unit, with_unit=True)} per "
                f"axis, far less than the {stated} that the job states: it lets priors weigh too "
                "much.",
            )
        if level > 1e-9:
            yield from _gross(line, unit, options)


def _unstated(
    solution: Solution, k: int, times: float, unit: str, options: ContradictionOptions
) -> Iterator[Contradiction]:
    """Large residuals of block ``k``, of which no noise is stated, against what rows scatter."""
    # Residuals as small as is assumed need no such look.

    rows = noise_of_rows(solution)[k]
    level = text(rows.level, rows.unit, with_unit=True)
    if not math.isnan(rows.noise) and rows.ratio < options.unexplained:
        # Repeats that scatter as much are noise, and every ± has it; not where it is so large that
        # no instrument has it.
        if rows.source == "repeats" and times <= options.residual:
            return
        cause = (
            f"{rows.source} differ by as much. Either the instrument has so much noise, or "
            f"single rows are wrong. If it is the instrument, state its noise (sigma_{unit})"
        )
    elif math.isnan(rows.noise):
        cause = (
            "no row repeats another, so the data do not show whether that is noise. If the "
            f"instrument has so much noise, state it (sigma_{unit}). If not, measure some "
            "postures twice"
        )
    else:
        noise = text(rows.noise, rows.unit, with_unit=True)
        cause = (
            f"{rows.source} scatter by only {noise}. The model lacks something, or a group of "
            "rows is wrong"
        )
    yield Contradiction(
        times > options.residual,
        f"The {rows.name} residuals are {level} per axis: {cause}.",
    )


def _noise_units(problem: Problem) -> list[str]:
    """The unit in which a job states the noise of each block."""
    blocks = ((term, block) for term in problem.terms for block in term.blocks)
    return [term.unit if block.unit == "m" else "deg" for term, block in blocks]


def gross_rows(
    solution: Solution, options: ContradictionOptions = ContradictionOptions()
) -> Iterator[Contradiction]:
    """Blocks of which many rows stand far off from most, wherever a solver stopped.

    Args:
        solution: converged or not.
        options: from where on it counts.
    """
    lines = solution.problem.linearise(solution.x, solution.problem.assumed_sigmas())
    for line, unit in zip(lines, _noise_units(solution.problem), strict=True):
        yield from _gross(line, unit, options)


def _gross(line: Linearised, unit: str, options: ContradictionOptions) -> Iterator[Contradiction]:
    block = line.view.block
    norms = np.linalg.norm(line.residual, axis=1) / math.sqrt(line.residual.shape[1])
    # Three gross touches of ten are in half of all distances: the best quarter says what most
    # would be.
    sound = robust_level(line.residual, 0.25)
    gross = norms > options.gross_level * max(sound, 1e-12)
    share, plain = float(np.mean(gross)), math.isinf(block.noise.huber)
    weight = float(np.sum(norms[gross] ** 2) / max(np.sum(norms**2), 1e-300))
    decided = plain and weight > options.gross_weight
    if decided or share > (options.gross_plain if plain else options.gross_care):
        how_many = (
            f"{100 * share:.0f} % of the" if share >= 0.01 else f"{gross.sum()} of {len(gross)}"
        )
        yield Contradiction(
            share > options.gross_bad,
            f"{how_many} {block.name} residuals are more than "
            f"{options.gross_level:.0f} times as large as most"
            + (f", {100 * weight:.0f} % of the sum of squares" if decided else "")
            + ": run suta-calib outliers, which says what they have in common"
            + (f", and give huber_{unit}, so that they are believed less." if plain else "."),
        )


def _held_out(
    solution: Solution, errors: Sequence[HeldOutErrors], options: ContradictionOptions
) -> Iterator[Contradiction]:
    for e in errors:
        larger = math.log(max(e.ratio, 1e-9))
        if abs(larger) < options.significance * e.ratio_std:
            continue
        if e.ratio > options.held_out_care:
            # A machine's tip may scatter by its encoders: more where it reaches farther.
            by_joints = e.ratio_by_joint_noise(solution)
            if by_joints < options.held_out_care:
                continue
        if e.ratio * options.held_out < 1.0:
            yield Contradiction(
                False,
                f"Held-out {e.name} errors of {e.term.kind.replace('_', ' ')} are "
                f"{text(e.level, e.unit, with_unit=True)} per axis, {1.0 / e.ratio:.1f} "
                f"times smaller than those of the fitted rows explain "
                f"({text(e.fitted, e.unit, with_unit=True)}): something is wrong in the "
                "fitted rows that is not in these, such as labels, and the answer follows it.",
            )
        if e.ratio < options.held_out_care:
            continue
        moved = e.placed_anew < e.level / options.held_out
        cause = (
            "fitting where the instrument or the artefact stood to the held-out rows alone removes "
            "them: it was moved; give these rows another label or placement"
            if moved
            else "another unit or day, other conditions, or unknowns that only fit the fitted rows"
        )
        yield Contradiction(
            e.ratio > options.held_out,
            f"Held-out {e.name} errors of {e.term.kind.replace('_', ' ')} are "
            f"{text(e.level, e.unit, with_unit=True)} per axis, {e.ratio:.1f} times what "
            f"noise and the covariance explain (fitted: "
            f"{text(e.fitted, e.unit, with_unit=True)}): {cause}.",
        )


def _scales(solution: Solution, options: ContradictionOptions) -> Iterator[Contradiction]:
    named = False
    for scale in common_scales(solution):
        size, of_arm = abs(scale.value), scale.what == "arm"
        least = options.scale_of_arm if of_arm else options.scale_significance
        if (
            scale.significance < least
            or scale.gain < options.scale_gain
            or not options.scale_care < size < options.scale_most
            # An arm may by chance be a little long in most of its lengths.
            or (of_arm and size - least * scale.std < options.scale_care)
        ):
            continue
        named = True
        if scale.one_alone is not None:
            yield _on_one_alone(solution, *scale.one_alone)
            continue
        by, longer = f"{100 * size:.2f} ± {100 * scale.std:.2f} %", scale.value > 0
        sentence = (
            f"All lengths of the arm came out {by} {'longer' if longer else 'shorter'} than nominal"
            if of_arm
            else f"The data agree better if all lengths of the {scale.what} are {by} too "
            f"{'long' if longer else 'short'}"
        )
        if scale.by_priors and not of_arm:
            sentence = (
                f"{sentence}, or if all lengths of the arm are that much "
                f"{'longer' if longer else 'shorter'} than their priors allow"
            )
        weak = scale.by_priors and scale.significance < options.scale_by_priors
        yield Contradiction(
            size > options.scale and not of_arm and not weak,
            f"{sentence}: check the scale and the certificate of what was measured with, and "
            "whether the URDF is of another arm.",
        )
    beyond = None if named else beyond_drawing(solution)
    if beyond is not None and beyond.gain > options.scale_gain:
        yield from _on_drawing(solution, beyond, options)


def _on_one_alone(solution: Solution, name: str, off: float) -> Contradiction:
    """A parameter that is far off alone, where a scale would make all of them so."""
    p = solution.problem.parameters[name]
    by, prior = (text(v, p.unit, with_unit=True) for v in (off, p.prior or 0.0))
    return Contradiction(
        False,
        f"{name} alone is {by} off its nominal value, but its prior is {prior}. The prior keeps "
        "it from moving so far, and other parameters absorb the rest. Correct this value in the "
        "URDF, or widen its prior.",
    )


def _on_drawing(
    solution: Solution, scale: CommonScale, options: ContradictionOptions
) -> Iterator[Contradiction]:
    """Lengths that came out longer together than a drawing of the arm's grade lets them be."""
    if scale.significance > options.scale_significance and abs(scale.value) > options.scale_care:
        assert solution.problem.arm is not None
        grade = solution.problem.arm.grade
        drawn = (
            f"more than a {grade} arm allows" if grade else "more than even a printed arm allows"
        )
        yield Contradiction(
            False,
            f"All lengths of the arm came out {100 * abs(scale.value):.2f} % "
            f"{'longer' if scale.value > 0 else 'shorter'} than nominal. That is {drawn} "
            f"({100 * scale.std:.2g} %, one standard deviation). Check the scale and the "
            "certificate of what was measured with, and whether the URDF is of another arm.",
        )


def _priors(solution: Solution, options: ContradictionOptions) -> Iterator[Contradiction]:
    parameters, values = solution.problem.parameters, solution.values
    # Priors that the fit has widened are judged as a group (`judge_priors`), up to a limit.
    widened = np.ones(len(parameters))
    if solution.weights is not None:
        widened = np.maximum(solution.weights.prior_scale, 1.0)
    pulls = [
        (abs(values[p.name] - p.nominal) / p.prior, wide, p.name)
        for p, wide in zip(parameters.values(), widened.tolist(), strict=True)
        if p.prior and p.free
    ]
    far = [
        (pull, name)
        for pull, wide, name in pulls
        if pull > min(options.pull_care * wide, options.pull)
    ]
    if not far:
        return
    worst, name = max(far)
    p = parameters[name]
    more = f" and {len(far) - 1} more" if len(far) > 1 else ""
    stated = [pull for pull, n in far if not parameters[n].prior_assumed]
    says = "is usual" if p.prior_assumed else "the priors say"
    yield Contradiction(
        any(pull > options.pull for pull in stated),
        f"{name}{more} ended {worst:.0f} standard deviations from what {says} (by "
        f"{text(values[name] - p.nominal, p.unit, with_unit=True)}, prior "
        f"{text(p.prior, p.unit, with_unit=True)}): the prior is wrong, or the data are.",
    )


def _repeated(solution: Solution, validation: Sequence[Term]) -> Iterator[Contradiction]:
    same = fitted_too(solution.problem.terms, validation)
    if again := int(same.sum()):
        yield Contradiction(
            False,
            f"{again} of {len(same)} validation rows were fitted too: "
            + ("nothing was held out." if again == len(same) else "they were not held out."),
        )
