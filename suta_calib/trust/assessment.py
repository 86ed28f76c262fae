"""The verdict on a calibration: whether it can be used, in one word and a few sentences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, Level, attempt, judge
from suta_calib.geometry.numbers import register_points, rms_length
from suta_calib.model.robot import AnyArm
from suta_calib.model.tilt import is_share
from suta_calib.solver.solution import Solution
from suta_calib.terms import ArmPoses, Term
from suta_calib.trust.accuracy import Accuracy
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.contradictions import gross_rows
from suta_calib.trust.explanation import Explanation, HeldReason
from suta_calib.trust.extended_problem import LOOKS_LIKE
from suta_calib.trust.hypothesis import Finding
from suta_calib.trust.linearised import ExtensionGain, best_extension
from suta_calib.trust.patterns import matches
from suta_calib.trust.priors import PriorNotes
from suta_calib.trust.repeats import LACKING
from suta_calib.trust.scale_effects import ScaleEffect, held_unseen
from suta_calib.units import Unit, stored, text, unit_name
from suta_calib.words import listed


def assess_calibration(examined: CalibrationExamination) -> Assessment:
    """Verdict from convergence, validation errors, bounds, fit, noise and unidentified parameters.

    Returns:
        ``bad`` if the solution must not be used, or the calibrated arm is worse than the nominal
        one on held-out data; ``care`` where something must be known.
    """
    solution, accuracy, failed = examined.solution, examined.accuracy, list[str]()
    terms = [*solution.problem.terms, *(item.term for item in accuracy.validation)]
    doubts = dict(judge("the samples", lambda: _doubts(terms), failed))
    if not solution.converged:
        return _not_converged(examined, doubts, failed)
    fewer = attempt("judged: a part of the rows", lambda: examined.fewer, examined, failed)
    contradicting = judge("contradictions", lambda: examined.contradictions, failed)
    # What looks like other faults is said before all that it would be taken for.
    foremost = attempt("judged: the model", lambda: _foremost(fewer), None)
    # A fit that other readings explain far better has residuals that say nothing of joints.
    cause = (
        judge("other readings", lambda: _cause(examined, foremost), failed) if contradicting else []
    )
    named = judge("the model", lambda: _named_cause(fewer, accuracy, alone=not cause), failed)
    changed = [] if named else judge("changes", lambda: fewer.changes, failed)
    # An arm that was fitted in two states is neither; an encoder's scale is the same in all rows.
    mixed = [c for c in changed if c.kind != "travel" and _far_better(c.of_all, examined)]
    # What explains residuals that are far too large is said before them.
    first = named if foremost or any(item.bad for item in contradicting) else []
    against = [
        (item.without_guess if foremost else item.sentence, item.bad)
        for item in contradicting
        if not (foremost and item.of_scale)
    ]
    worse = "The calibrated arm is worse than the nominal arm on the validation data."
    fitted_only = (
        "There are no validation data. The errors shown are those of the fitted data, and errors "
        "elsewhere are larger."
    )
    nothing = PriorNotes()
    priors = attempt("judged: priors", lambda: examined.priors, nothing, failed)
    beliefs = (
        []
        if foremost
        else judge("priors that rows state", lambda: fewer.contradicted_beliefs, failed)
    )
    is_worse = attempt("judged: validation data", lambda: accuracy.worse, False, failed)
    bad = [
        *cause,
        *(change.sentence for change in mixed),
        *([worse] if is_worse else []),
        *(sentence for sentence, is_bad in against if is_bad),
        *priors.bad,
        *(belief.sentence for belief in beliefs if belief.bad),
        *(sentence for sentence, level in doubts.items() if level == "bad"),
    ]
    explained = foremost is not None or bool(changed)
    care = [
        *(change.sentence for change in changed if change not in mixed),
        *(sentence for sentence, is_bad in against if not is_bad),
        *(sentence for sentence, level in doubts.items() if level == "care"),
        *([] if accuracy.validation or accuracy.unjudged else [fitted_only]),
        *([] if cause else judge("rows", lambda: matches(solution, "rows"), failed)),
        *judge("the gain", lambda: _on_gain(accuracy, explained=explained), failed),
        *(belief.sentence for belief in beliefs if not belief.bad),
        *judge("parameters", lambda: _on_parameters(examined), failed),
        *judge("zeros", lambda: [split.sentence for split in examined.prior_splits], failed),
        *judge("the scale", lambda: _on_guessed_scale(examined), failed),
        *judge("redundancy", lambda: _on_redundancy(examined), failed),
        *([] if first else named),
        *judge(
            "residuals",
            lambda: _beside_geometry(
                *(examined, fewer), named=bool(named or changed), suspect=not (cause or priors.bad)
            ),
            failed,
        ),
        *priors.care,
        *accuracy.unjudged,
    ]
    alone_bad = bool(first) and foremost is not None and foremost.level == "bad"
    (bad if bad or alone_bad else care)[:0] = first
    moved = [] if named else judge("changes", lambda: [c.sentence for c in fewer.changes], failed)
    notes = {*bad, *care}
    assessment = Assessment.of(
        solution.sentence,
        bad=bad,
        care=care,
        facts=[
            *(sentence for sentence, level in doubts.items() if level == "good"),
            *judge("what is held at nominal", lambda: _as_drawn(examined), failed),
            *judge("the scale", lambda: _on_scale(examined), failed),
            *priors.facts,
            *judge("widened ±", lambda: _on_widening(solution), failed),
        ],
    ).with_care(failed)
    faults = tuple(note for note in (*cause, *named, *moved) if note in notes)
    return replace(assessment, faults=faults)


def assess_solution(solution: Solution) -> Assessment:
    """The verdict from the fitted data alone, as in `Solution.assessment`."""
    return assess_calibration(CalibrationExamination.of(solution))


def _doubts(terms: Sequence[Term]) -> Iterable[tuple[str, Level]]:
    of_arms = (term.poses for term in terms if isinstance(term.poses, ArmPoses))
    return [
        *(doubt for term in terms for doubt in term.doubts.items()),
        *((doubt, "care") for poses in of_arms for doubt in poses.felt_doubts),
    ]


def _not_converged(
    examined: CalibrationExamination, doubts: Mapping[str, Level], failed: list[str]
) -> Assessment:
    """Of a solution that did not converge: what may be the cause."""
    solution = examined.solution
    notes = [doubt for doubt, level in doubts.items() if level == "bad"]
    notes = notes or _causes(examined, failed)
    notes = notes or judge(
        "single rows", lambda: [row.sentence for row in gross_rows(solution)], failed
    )
    patterns = judge("patterns", lambda: matches(solution, "note"), failed)
    return Assessment("bad", solution.sentence, (*patterns, *notes, *failed))


def _foremost(fewer: CalibrationExamination) -> Finding | None:
    """What is said before all that it would be taken for; None where nothing is."""
    cause = fewer.strongest_cause
    return cause if cause is not None and cause.hypothesis.before_others else None


def _cause(examined: CalibrationExamination, foremost: Finding | None = None) -> list[str]:
    """The data read in another way, where that explains them far better.

    Far better than with ``foremost``, too: an arm's own motion passes for a moved instrument.
    """
    solution = examined.solution
    if obvious := matches(solution, "cause"):
        return [] if solution.converged else obvious
    cause = examined.other_reading
    if cause is None:
        return matches(solution, "suspicion")
    left = 1.0 if foremost is None else math.sqrt(max(1.0 - foremost.evidence.share, 0.0))
    far_better = cause.before * left > examined.rule.far_better * cause.after
    return [cause.sentence] if far_better else []


def _far_better(share: float, examined: CalibrationExamination) -> bool:
    """Whether what explains this share of the squares lowers the misfit as another reading must."""
    return share > 1.0 - examined.rule.far_better**-2


def _on_gain(accuracy: Accuracy, *, explained: bool) -> list[str]:
    """An arm that was right before is neither made better nor spoilt, if nothing else is named."""
    gain = accuracy.gain
    if gain is None or gain.better or gain.worse:
        return []
    before, after = (text(rms, gain.unit, with_unit=True) for rms in (gain.before, gain.after))
    return [
        f"On the validation data the calibrated arm ({after}) is not clearly better than the "
        f"nominal arm ({before})."
        + ("" if explained else " The nominal arm may have been right already.")
    ]


def _on_parameters(examined: CalibrationExamination) -> list[str]:
    """What other data would tell, by what to measure; and what ended at a bound."""
    solution = examined.solution
    by_remedy: dict[tuple[HeldReason, str], list[Explanation]] = {}
    for explanation in examined.explanations:
        if explanation.reason != "redundant":
            by_remedy.setdefault((explanation.reason, explanation.remedy), []).append(explanation)
    how = {
        "untold": "could not be determined and",
        "badly told": "could not be determined well enough and",
    }
    notes = [
        f"{listed([item.fixed for item in held])} {how[reason]} {_keep_nominal(held)}."
        f"{_at_stake(solution, held)} To determine more: {remedy}."
        for (reason, remedy), held in by_remedy.items()
    ]
    ended = [n for n, e in solution.arm_estimates.items() if e.state == "at_bound"]
    # A link may well turn where it begins, or where it ends.
    if bounded := [name for name in ended if not is_share(name)]:
        notes.append(
            f"{listed(bounded)} ended at a bound. Look for a wrong unit or a wrong artefact; if "
            "there is none, widen the bound."
        )
    clocks = {p.name for term in solution.problem.terms for p in term.of_clock}
    estimates = solution.estimates
    if bounded := [n for n, e in estimates.items() if n in clocks and e.state == "at_bound"]:
        notes.append(
            f"{listed(bounded)} ended at the bound that the job gives. Give a larger one; if it "
            "ends there again, readings and observations are not of the same motion."
        )
    return notes


def _as_drawn(examined: CalibrationExamination) -> list[str]:
    """A note on redundant parameters that the tip depends on: these are not a convention."""
    held = [explanation for explanation in examined.explanations if explanation.as_drawn]
    if not held:
        return []
    return [
        f"Observations of these kinds cannot determine {listed([item.fixed for item in held])}, "
        f"which {_keep_nominal(held)}. No ± includes an error there."
        f"{_at_stake(examined.solution, held)}"
    ]


def _on_scale(examined: CalibrationExamination) -> list[str]:
    """A note on the scale: if measured lengths are too long, so is the arm, without residuals."""
    unseen, guessed = held_unseen(examined.solution), _guessed_scales(examined)
    carried = [e.sentence for e in examined.scale_effects if e.carries and e not in guessed]
    return [*carried, *([unseen] if unseen else [])]


def _on_guessed_scale(examined: CalibrationExamination) -> list[str]:
    """A scale that nobody measured, and that is worth more at the tip than the errors shown."""
    return [effect.unseen_in(rms) for effect, rms in _guessed_scales(examined).items()]


def _guessed_scales(examined: CalibrationExamination) -> dict[ScaleEffect, float]:
    """Effects of such scales, each with the held-out error that does not show it, m."""
    gain = examined.accuracy.gain
    if gain is None or gain.unit != "m":
        return {}
    effects = (effect for effect in examined.scale_effects if effect.carries and effect.guessed)
    return {effect: gain.after for effect in effects if effect.tip > gain.after}


def _on_widening(solution: Solution) -> list[str]:
    """Held-out errors that the fitted rows did not let one expect."""
    if solution.widening <= 1.0:
        return []
    return [
        "The validation errors are larger than the noise and the covariance predict. Every ± was "
        f"therefore multiplied by {solution.widening:.1f}, and now agrees with these errors."
    ]


def _at_stake(solution: Solution, held: Sequence[Explanation]) -> str:
    """Error of the tip if held parameters differ from the drawing; the largest of each unit."""
    parameters = solution.problem.parameters
    worst: dict[Unit, Explanation] = {}
    for explanation in sorted(held, key=lambda item: item.moves):
        if explanation.moves:
            worst[parameters[explanation.fixed].unit] = explanation
    losses = [
        f" If {value.fixed if len(held) > 1 else 'that'} is wrong by 1 {unit_name(unit)}, the tip "
        f"is wrong by {text(value.moves * stored(1.0, unit), 'm', with_unit=True)} in other "
        "postures."
        for unit, value in worst.items()
    ]
    return "".join(losses)


def _keep_nominal(held: Sequence[Explanation]) -> str:
    """End of a sentence about parameters that keep their URDF values."""
    return "keeps its URDF value" if len(held) == 1 else "keep their URDF values"


def _on_redundancy(examined: CalibrationExamination) -> list[str]:
    """Noise that is learnt from few residuals may be off by half, and every ± with it."""
    solution = examined.solution
    equations = sum(term.equations() for term in solution.problem.terms)
    # Equations beyond the unknowns from which on residuals tell the noise to a third or so.
    if equations - examined.effective_unknowns >= 6:
        return []
    return [
        f"{equations} independent equations for {len(solution.free)} unknowns: too few to estimate "
        "the noise well. Every ± may be several times too small. Measure more."
    ]


def _causes(examined: CalibrationExamination, failed: list[str]) -> list[str]:
    """What may have spoilt a fit that did not converge; of joints its residuals say nothing."""
    model = judge("the model", lambda: _cause_of_model(examined), failed)
    foremost = attempt("judged: the model", lambda: _foremost(examined.fewer), None)
    readings = judge("other readings", lambda: _cause(examined, foremost), failed)
    return [*model, *readings] if foremost else readings or model


def _cause_of_model(examined: CalibrationExamination) -> list[str]:
    """An error that the model lacks."""
    cause = examined.fewer.strongest_cause
    if cause is None or cause.evidence.effect.parameters:
        return []
    return [cause.sentence]


def _named_cause(examined: CalibrationExamination, accuracy: Accuracy, *, alone: bool) -> list[str]:
    """What explains the residuals better than a change while the rows were measured, if anything.

    Where parameters describe it, it stands here only if estimating them predicts left-out rows
    better.

    ``alone`` says whether no other reading of the data explains them far better.
    """
    cause = examined.strongest_cause
    if cause is None:
        return []
    if cause.hypothesis.before_others:
        return [cause.sentence]
    if not alone:
        return []
    share = cause.evidence.share_beyond_choice
    if any(change.share >= share for change in examined.changes):
        return []
    names = cause.evidence.effect.parameters
    if not names:
        return [cause.sentence]
    gain = _best_extension(examined, accuracy, [names])
    return [] if gain is None else [f"{cause.sentence} {_with_it(gain)}."]


def _best_extension(
    examined: CalibrationExamination, accuracy: Accuracy, choices: Sequence[Sequence[str]]
) -> ExtensionGain | None:
    """The extension that predicts left-out rows best; None if there is none or too few rows."""
    linear = examined.linearised
    return None if linear is None else best_extension(linear, accuracy.validation, choices)


def _beside_geometry(
    examined: CalibrationExamination, fewer: CalibrationExamination, *, named: bool, suspect: bool
) -> list[str]:
    """What a URDF cannot hold, and what the residuals look like, held geometry last.

    A note on what the model lacks stands here only if estimating it predicts left-out rows better,
    and the residuals are ``suspect``: they tell of the arm, and of no other reading of the data.
    """
    notes, solution = list[str](), examined.solution
    arm = solution.problem.arm
    beside = {} if arm is None else arm.nongeometric
    estimates = solution.arm_estimates.items()
    if arm is not None and arm.tilt_sensors:
        notes.append(_on_tilt_sensors(solution, arm))
    tilts = {p.name for s in arm.tilt_sensors for p in s.all_parameters} if arm else set[str]()
    lost = [n for n, e in estimates if n in beside and not beside[n].in_urdf(e.value)]
    if held := [name for name in lost if name not in tilts]:
        notes.append(
            f"A URDF cannot hold {listed(held)}. calibrated.urdf has the geometry only, and is not "
            "accurate alone: use it with the corrections in result.json (track and validate apply "
            "them with --result)."
        )
    if named:
        return notes
    if arm is None or not suspect:
        return notes
    return [*notes, *(_like_an_error(fewer, examined.accuracy) or _like_geometry(examined, fewer))]


def _on_tilt_sensors(solution: Solution, arm: AnyArm) -> str:
    """That no URDF holds them, and how far they move the tip beside a constant lean of the arm."""
    values, moved = solution.values, list[FloatArray]()
    for poses in (term.poses for term in solution.problem.terms):
        if isinstance(poses, ArmPoses) and "tilt" in poses.conditions:
            _, leaning = poses.at(values)
            _, level = poses.arm.forward(poses.samples.q, values, poses.samples.conditions)
            rotation, position = register_points(level, leaning)
            moved.append(leaning - level @ rotation.T - position)
    links = listed([sensor.link for sensor in arm.tilt_sensors])
    size = text(rms_length(np.vstack(moved)), "m", with_unit=True) if moved else "an amount"
    return (
        f"The tilt sensors of {links} move the tip by {size} (RMS). A URDF cannot hold this: "
        "calibrated.urdf is the arm without them. validate uses them, with --result result.json; "
        "track has no readings of them."
    )


def _like_an_error(fewer: CalibrationExamination, accuracy: Accuracy) -> list[str]:
    """An error beside geometry that the residuals look like, where estimating it helps."""
    suspects = [test for test in fewer.score_tests if test.suspicious]
    suspects.sort(key=lambda test: -test.explains)
    together = [name for test in suspects for name in test.names]
    # Suspects that are tried one by one, beside all of them together.
    choices = [*(test.names for test in suspects[:3]), together]
    gain = _best_extension(fewer, accuracy, choices) if suspects else None
    if gain is None:
        return []
    in_it = [test for test in suspects if set(test.names) & set(gain.names)]
    worst, *further = in_it
    more = f" (and {len(further)} more errors of this sort)" if further else ""
    return [
        f"The residuals of {worst.joint} look like {LOOKS_LIKE[worst.family]}{more}. "
        f"{_with_it(gain)}. Run suta-calib extend: it prints what to add to the job."
    ]


def _like_geometry(examined: CalibrationExamination, fewer: CalibrationExamination) -> list[str]:
    """Geometry that the job holds as drawn, where estimating it helps."""
    lack = [fit for fit in examined.lack_of_fit if fit.ratio > LACKING]
    if not lack and not fewer.geometry_is_held:
        return []
    assert examined.arm is not None
    fitted = examined.solution.problem.arm_parameters
    held = [n for n in examined.arm.geometric if n not in fitted]
    gain = _best_extension(fewer, examined.accuracy, [held]) if held else None
    if gain is None:
        return []
    repeats = [
        f"The residuals ({text(fit.residual, fit.unit, with_unit=True)}) are {fit.ratio:.1f} "
        "times the scatter of repeats of the same touch "
        f"({text(fit.repeat, fit.unit, with_unit=True)})."
        for fit in lack
    ]
    return [
        " ".join(
            [
                *repeats,
                "The residuals look like errors of dimensions that the job fixes.",
                f"{_with_it(gain, 'they are')}.",
                "Estimate these dimensions (select: geometric, with prior_mm and prior_deg).",
            ]
        )
    ]


def _with_it(gain: ExtensionGain, this_is: str = "this is") -> str:
    """Effect of estimating it on the errors of rows that were left out of the fit."""
    before, after = (text(rms, gain.unit, with_unit=True) for rms in (gain.before, gain.after))
    return (
        f"If {this_is} estimated too, the error of rows left out of the fit falls from {before} to "
        f"{after}"
    )
