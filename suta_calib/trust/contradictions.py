"""Contradictions to a result: from residuals, priors, validation samples and starts.

Converged is not true: with enough unknowns and priors a solver explains rows in the wrong order.
Each check compares two things that agree for honest data, whatever the arm, in units of what is
known of them; robustly, so that a few gross rows accuse nobody.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import chdtrc

from suta_calib.model.parameters import POSITION, Parameter, is_base
from suta_calib.solver.evaluation import Linearised
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term
from suta_calib.terms.length_scale import is_stretch
from suta_calib.terms.poses import ArmPoses
from suta_calib.trust.accuracy import fitted_too
from suta_calib.trust.common_scale import CommonScale, beyond_drawing, common_scales
from suta_calib.trust.held_out import HeldOutErrors, robust_level
from suta_calib.trust.patterns import matches
from suta_calib.trust.repeats import noise_of_rows
from suta_calib.units import text

# Residuals' level over the noise that the job states, or that is assumed, from which on an answer
# must not be used: ten times as much is no matter of a careful or a careless hand. And from which
# on it must be known.
RESIDUAL, RESIDUAL_CARE = 10.0, 3.0
# Prior standard deviations from nominal beyond which a parameter must not be.
PULL: Final = 10.0
# Held-out errors over what noise and covariance make one expect; another day or another hand may
# double them.
HELD_OUT, HELD_OUT_CARE = 3.0, 1.7
# Standard deviations that a ratio, or a scale, must be off before it says anything.
SIGNIFICANCE: Final = 4.0
# Of a print, the stretch that must be known, and the chance of a prior's pull that is none.
STRETCHED, STRETCH_CHANCE = 0.01, 1e-3
# A common factor on all lengths of an artefact, an instrument or the arm that must be known.
SCALE_CARE: Final = 2e-3


@dataclass(frozen=True)
class Contradiction:
    """One contradiction.

    Attributes:
        bad: whether the answer must not be used because of it.
        finding: what disagrees, and by how much.
        guess: at the cause, which is not said where another cause is found; empty for none.
        of_scale: whether it is about the scale of lengths, which other causes look like.
    """

    bad: bool
    finding: str
    guess: str = ""
    of_scale: bool = False

    @property
    def sentence(self) -> str:
        """The finding, with the guess at its cause."""
        return f"{self.finding}: {self.guess}." if self.guess else self.finding

    @property
    def without_guess(self) -> str:
        """The finding alone."""
        return f"{self.finding}." if self.guess else self.finding


def contradictions(
    solution: Solution, held_out: Sequence[HeldOutErrors]
) -> tuple[Contradiction, ...]:
    """All contradictions to a converged result, the worst first."""
    residuals = list(_residuals(solution))
    disagreements = [
        *residuals,
        *_held_out(solution, held_out),
        # What does not fit at all has no scale.
        *([] if any(residual.bad for residual in residuals) else _on_scale(solution)),
        *_priors(solution),
        *_tips(solution),
        *(Contradiction(False, sentence) for sentence in matches(solution, "cause", "note")),
        *_repeated(solution, list(dict.fromkeys(item.term for item in held_out))),
    ]
    same, tried = solution.agreeing, len(solution.attempts)
    if tried > 1 and same < 0.5 * tried:
        sentence = (
            f"Only {same} of {tried} starts reached this minimum. There may be a better one, or "
            "the data do not fit the model. Tighten the bounds, or raise solver.starts."
        )
        disagreements.append(Contradiction(False, sentence))
    return tuple(sorted(disagreements, key=lambda item: not item.bad))


def _residuals(solution: Solution) -> Iterator[Contradiction]:
    """Of each block against the noise that is stated, and against one another."""
    problem = solution.problem
    sigmas = problem.assumed_sigmas()
    lines = problem.linearise(solution.x, sigmas)
    units = _noise_units(problem)
    levels = [robust_level(line.residual) for line in lines]
    ratios = [
        level / float(np.median(line.sigma)) for level, line in zip(levels, lines, strict=True)
    ]
    owners = [j for j, term in enumerate(problem.terms) for _ in term.blocks]
    # Terms of which a block fits: their rows are not wrong as a whole.
    fitting = {owner for owner, ratio in zip(owners, ratios, strict=True) if ratio < RESIDUAL_CARE}
    blocks = zip(lines, units, sigmas, solution.noise, levels, ratios, strict=True)
    for k, (line, unit, assumed, learnt, level, times) in enumerate(blocks):
        block, chain = line.view.block, problem.terms[owners[k]].of_chain
        given = block.noise.sigma is not None
        scatter, stated = (text(v, block.unit, with_unit=True) for v in (level, assumed))
        if given and times > RESIDUAL_CARE:
            yield Contradiction(
                times > RESIDUAL,
                f"The {block.name} residuals{chain} are {scatter} per axis, {times:.0f} times the "
                f"noise that the job states ({stated}): the data do not fit this arm. If the "
                f"instrument really has so much noise, state it (sigma_{unit}).",
            )
        elif not given and times > RESIDUAL_CARE:
            yield from _unstated(solution, k, times, unit, chain, right_rows=owners[k] in fitting)
        elif given and learnt * RESIDUAL_CARE < assumed:
            yield Contradiction(
                False,
                f"The {block.name} residuals{chain} are "
                f"{text(learnt, block.unit, with_unit=True)} per axis, far less than the "
                f"noise that the job states ({stated}). Priors then pull "
                f"the estimates too much. State a smaller sigma_{unit}.",
            )
        if level > 1e-9:
            yield from _gross(line, unit, chain)


def _unstated(
    solution: Solution, k: int, times: float, unit: str, chain: str, *, right_rows: bool
) -> Iterator[Contradiction]:
    """Large residuals of block ``k``, of which no noise is stated, against what rows scatter."""
    rows, bad = noise_of_rows(solution)[k], times > RESIDUAL
    level = text(rows.level, rows.unit, with_unit=True)
    # From twice what rows themselves scatter on, noise is no explanation: neighbours' estimate is
    # right to a fifth, and the model's error in it.
    if not math.isnan(rows.noise) and rows.ratio < 2.0:
        # Repeats that scatter as much are noise, and every ± has it; not where it is so large that
        # no instrument has it.
        if rows.source == "repeats" and not bad:
            return
        # Where positions fit, the rows are right: then orientations as rough as those of a small
        # marker are noise.
        bad = bad and not right_rows
        cause = (
            f"{rows.source} differ by as much. Either the instrument has so much noise, or "
            f"single rows are wrong. If it is the instrument, state its noise (sigma_{unit})"
        )
    elif math.isnan(rows.noise):
        cause = (
            "no posture was measured twice, so it is unknown whether this is noise. If the "
            f"instrument has so much noise, state it (sigma_{unit}). If not, measure some postures "
            "twice"
        )
    else:
        noise = text(rows.noise, rows.unit, with_unit=True)
        cause = (
            f"{rows.source} scatter by only {noise}. The model lacks something, or a group of "
            "rows is wrong"
        )
    yield Contradiction(bad, f"The {rows.name} residuals{chain} are {level} per axis", cause)


def _noise_units(problem: Problem) -> list[str]:
    """The unit in which a job states the noise of each block."""
    blocks = ((term, block) for term in problem.terms for block in term.blocks)
    return [term.unit if block.unit == "m" else "deg" for term, block in blocks]


def gross_rows(solution: Solution) -> Iterator[Contradiction]:
    """Blocks of which many rows stand far off from most, wherever a solver stopped."""
    lines = solution.problem.linearise(solution.x, solution.problem.assumed_sigmas())
    chains = [term.of_chain for term in solution.problem.terms for _ in term.blocks]
    for line, unit, chain in zip(lines, _noise_units(solution.problem), chains, strict=True):
        yield from _gross(line, unit, chain)


def _gross(line: Linearised, unit: str, chain: str) -> Iterator[Contradiction]:
    block = line.view.block
    norms = np.linalg.norm(line.residual, axis=1) / math.sqrt(line.residual.shape[1])
    # Three gross touches of ten are in half of all distances: the best quarter says what most
    # would be.
    sound = robust_level(line.residual, 0.25)
    # Times the level of most beyond which a row is gross: normal noise has one in a million, a
    # hand's measurement some in a hundred.
    times = 5.0
    gross = norms > times * max(sound, 1e-12)
    share, plain = float(np.mean(gross)), math.isinf(block.noise.huber)
    weight = float(np.sum(norms[gross] ** 2) / max(np.sum(norms**2), 1e-300))
    # However few they are, with half of the squares they decide more than all others. Plain least
    # squares follow every row.
    decided = plain and weight > 0.5
    if decided or share > (0.02 if plain else 0.1):
        how_many = (
            f"{100 * share:.0f} % of the" if share >= 0.01 else f"{gross.sum()} of {len(gross)}"
        )
        yield Contradiction(
            # No touch explains so many.
            share > 0.35,
            f"{how_many} {block.name} residuals{chain} are more than "
            f"{times:.0f} times as large as most"
            + (f", {100 * weight:.0f} % of the sum of squares" if decided else "")
            + ". Run suta-calib outliers, which shows what these rows have in common"
            + (f", and set huber_{unit} to give such rows less weight." if plain else "."),
        )


def _held_out(solution: Solution, errors: Sequence[HeldOutErrors]) -> Iterator[Contradiction]:
    for e in errors:
        larger = math.log(max(e.ratio, 1e-9))
        if abs(larger) < SIGNIFICANCE * e.ratio_std:
            continue
        # A machine's tip may scatter by its encoders: more where it reaches farther.
        if e.ratio > HELD_OUT_CARE and e.ratio_by_joint_noise(solution) < HELD_OUT_CARE:
            continue
        # Parameters that may be far off, but are not, say nothing of the fitted rows.
        if e.ratio * HELD_OUT < 1.0 and e.level * HELD_OUT < e.by_noise:
            yield Contradiction(
                False,
                f"The {e.name} validation errors of {e.term.called} are "
                f"{text(e.level, e.unit, with_unit=True)} per axis, {1.0 / e.ratio:.1f} times "
                "smaller than the fitted rows predict "
                f"({text(e.fitted, e.unit, with_unit=True)}). Something is wrong in the fitted "
                "rows, such as labels, and the result follows it. Run suta-calib outliers.",
            )
        if e.ratio < HELD_OUT_CARE:
            continue
        moved = e.placed_anew < e.level / HELD_OUT
        cause = (
            "the instrument or the artefact was moved, because these errors vanish if its pose is "
            "fitted to the validation rows alone. Give these rows another label or placement"
            if moved
            else (
                "look for another unit, another day or other conditions; or the unknowns are too "
                "many, and fit only the fitted rows"
            )
        )
        yield Contradiction(
            e.ratio > HELD_OUT,
            f"The {e.name} validation errors of {e.term.called} are "
            f"{text(e.level, e.unit, with_unit=True)} per axis, {e.ratio:.1f} times what noise "
            f"and covariance predict (fitted: {text(e.fitted, e.unit, with_unit=True)})",
            cause,
        )


def _on_scale(solution: Solution) -> Sequence[Contradiction]:
    """A print of another size is the likelier cause of lengths that are all too long."""
    scales = list(_scales(solution))
    return scales if any(scale.bad for scale in scales) else list(_stretched(solution)) or scales


def _scales(solution: Solution) -> Iterator[Contradiction]:
    named = False
    # The share of the priors' pulls, or of the residuals, that a scale must explain.
    scale_gain = 0.5
    for scale in common_scales(solution):
        size, of_arm = abs(scale.value), scale.what == "arm"
        # The arm's lengths say it only by growing evenly.
        least = 2.0 if of_arm else SIGNIFICANCE
        if (
            scale.significance < least
            or scale.gain < scale_gain
            # Beyond a tenth it is no scale, but data that do not fit.
            or not SCALE_CARE < size < 0.1
            # An arm may by chance be a little long in most of its lengths.
            or (of_arm and size - least * scale.std < SCALE_CARE)
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
        # Where priors alone speak against it: of 42 sound sets one had an arm that was four prior
        # standard deviations long.
        weak = scale.by_priors and scale.significance < 6.0
        yield Contradiction(
            # Half a per cent moves a tip at arm's length by millimetres.
            size > 5e-3 and not of_arm and not weak,
            f"{sentence}. Check the scale and the certificate of the artefact or instrument, and "
            "whether the URDF is of another arm.",
            of_scale=True,
        )
    beyond = None if named else beyond_drawing(solution)
    if beyond is not None and beyond.gain > scale_gain:
        yield from _on_drawing(solution, beyond)


def _on_one_alone(solution: Solution, name: str, off: float) -> Contradiction:
    """A parameter that is far off alone, where a scale would make all of them so."""
    p = solution.problem.parameters[name]
    by, prior = (text(v, p.unit, with_unit=True) for v in (off, p.prior or 0.0))
    return Contradiction(
        False,
        f"{name} differs from its nominal value by {by}, but its prior is {prior}. The prior "
        "keeps it too close to nominal, and other parameters absorb the rest. Correct this value "
        "in the URDF, or widen its prior.",
    )


def _on_drawing(solution: Solution, scale: CommonScale) -> Iterator[Contradiction]:
    """Lengths that came out longer together than a drawing of the arm's grade lets them be."""
    if scale.significance > SIGNIFICANCE and abs(scale.value) > SCALE_CARE:
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
            "certificate of the artefact or instrument, and whether the URDF is of another arm.",
        )


def _priors(solution: Solution) -> Iterator[Contradiction]:
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
    # Two in 10⁶ of what a prior means is five off.
    far = [(pull, name) for pull, wide, name in pulls if pull > min(5.0 * wide, PULL)]
    if not far:
        return
    worst, name = max(far)
    p = parameters[name]
    more = f" and {len(far) - 1} more" if len(far) > 1 else ""
    stated = [pull for pull, n in far if not parameters[n].prior_assumed]
    says = "usual values" if p.prior_assumed else "its prior"
    yield Contradiction(
        any(pull > PULL for pull in stated),
        f"{name}{more} ended {worst:.0f} standard deviations from {says} (by "
        f"{text(values[name] - p.nominal, p.unit, with_unit=True)}, prior "
        f"{text(p.prior, p.unit, with_unit=True)})",
        "either the prior or the data are wrong"
        + _mounted([parameters[name] for _, name in far], solution.problem.terms),
    )


def _stretched(solution: Solution) -> Iterator[Contradiction]:
    """A print whose estimated stretch is more than printers do, and than its prior allows."""
    parameters = [p for p in solution.problem.parameters.values() if is_stretch(p) and p.prior]
    for owner in dict.fromkeys(p.owner for p in parameters):
        mine = [p for p in parameters if p.owner == owner]
        found = {p.key: solution.values[p.name] for p in mine}
        pulls = [found[p.key] / p.prior for p in mine if p.prior]
        # Half a per cent is a printer; two are a page that was made to fit, 94 to 97 %.
        if max(map(abs, found.values())) < STRETCHED:
            continue
        if chdtrc(len(pulls), float(np.square(pulls).sum())) > STRETCH_CHANCE:
            continue
        lengths = " and ".join(
            f"{100 * abs(value):.1f} % {'longer' if value > 0 else 'shorter'} along {axis}"
            for axis, value in found.items()
        )
        name = owner.partition("[")[2].removesuffix("]")
        yield Contradiction(
            False,
            f"{name} seems to be {lengths} than its file says, more than printers do. Perhaps it "
            "was printed to fit the page, or a length in its file is wrong. The fit takes up only "
            "a part of it. Measure it with a ruler along x and along y, and correct its file.",
            of_scale=True,
        )


def _mounted(far: Sequence[Parameter], terms: Sequence[Term]) -> str:
    """A note on a tip far from its nominal place: another point on its link was measured."""
    for term in terms:
        poses, mount = term.poses, term.on_unknown_mount
        if mount is None or not isinstance(poses, ArmPoses):
            continue
        if any(p.owner == poses.arm.segments[-1].owner for p in far):
            return f". Perhaps {mount[0]}"
    return ""


def _tips(solution: Solution) -> Iterator[Contradiction]:
    """A tip that ended far off, though no other length did: another point was measured."""
    parameters = solution.problem.parameters
    estimates = solution.arm_estimates
    # A prior speaks for itself (`_priors`), and a base in a cell may stand anywhere.
    lengths = [
        parameters[name]
        for name, e in estimates.items()
        if e.std and parameters[name].key in POSITION and parameters[name].prior is None
    ]
    mounts = {
        term.poses.arm.segments[-1].owner: on_mount[0]
        for term in solution.problem.terms
        if isinstance(term.poses, ArmPoses) and (on_mount := term.on_unknown_mount) is not None
    }
    for tip, mount in mounts.items():
        of_tip = [p for p in lengths if p.owner == tip]
        # Who lets a tip be farther off than the rest knows that it may be.
        most = max((p.upper - p.lower for p in of_tip), default=0.0)
        other_causes = [
            p
            for p in lengths
            if p.owner not in mounts and not is_base(p.owner) and p.upper - p.lower >= most
        ]
        off, rest = (
            np.array([estimates[p.name].value - p.nominal for p in group])
            for group in (of_tip, other_causes)
        )
        # Fewer lengths do not say how far off this arm is: of 5 that are alike one in 10⁴ tips is
        # ten times as far off.
        if not of_tip or len(rest) < 5:
            continue
        axis, arm = (float(np.sqrt(np.mean(values**2))) for values in (off, rest))
        certain = max(abs(d) / estimates[p.name].std for p, d in zip(of_tip, off, strict=True))
        if axis > PULL * arm and certain > SIGNIFICANCE:
            yield Contradiction(
                False,
                f"The tip {tip} ended {text(float(np.linalg.norm(off)), 'm', with_unit=True)} from "
                f"its place in the URDF, though other lengths changed by only "
                f"{text(arm, 'm', with_unit=True)} (RMS). The data cannot tell a wrong place in "
                "the URDF from a target beside the tip: the calibrated tip is the point that was "
                f"measured. Perhaps {mount}.",
            )


def _repeated(solution: Solution, validation: Sequence[Term]) -> Iterator[Contradiction]:
    same = fitted_too(solution.problem.terms, validation)
    if again := int(same.sum()):
        yield Contradiction(
            False,
            f"{again} of {len(same)} validation rows were fitted too: "
            + ("no row was held out." if again == len(same) else "these were not held out."),
        )
