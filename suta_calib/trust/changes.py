"""Did something change while it was measured? An encoder that slipped, a base that crept away.

Small changes hide: the fit spreads them over its unknowns, and every residual stays plausible. Each
of them moves the tip in its own way, though, from some row on or ever more: the hypotheses of
`trust.in_time`. They are weighed with all of the geometry free to follow (`reduced_fit`), so that
nothing is fitted anew. The strongest are told apart by what a robust fit leaves, and confirmed
beside all else that a model may lack, and what neighbouring rows get wrong alike
(`shared_errors`): order in time is mostly order in space.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.threads import single_threaded
from suta_calib.trust.evidence import Effect, weigh_effects
from suta_calib.trust.examination import Examination
from suta_calib.trust.hypothesis import known_hypotheses
from suta_calib.trust.in_time import (
    FEWEST,
    SAID_FROM,
    TURN,
    ChangeInTime,
    InTime,
    TipShift,
    by_readings,
    columns_of,
    rows_of,
)
from suta_calib.trust.reduced_fit import (
    Followed,
    ReducedFit,
    everything_follows,
    followed,
    gained,
    whitened,
)
from suta_calib.trust.rule import Rule
from suta_calib.trust.shared_errors import chance_beside_shared_errors

# Errors of an encoder come so often in a turn, beside those that an eccentric one has.
WAVES: Final = 3, 4, 5, 6


@dataclass(frozen=True)
class ChangeOptions:
    """How changes are told apart.

    Attributes:
        rule: when a change is said. Of its share, gross errors do not count.
        worth_a_look: times that share, from which on the row is looked for at which it happened:
            at the rows that are tried first, it seems to explain less.
        equal: squares, in units of the noise, by which what explains data as well differs at most.
        tried: so many of what may have changed are told apart by what they leave.
        rounds: so often, at most, the row at which each of these happened is looked for anew.
    """

    rule: Rule = Rule()
    worth_a_look: float = 0.3
    equal: float = 9.0
    tried: int = 3
    rounds: int = 4


@dataclass(frozen=True, eq=False)
class Suspect:
    """What may have changed, where it explains most.

    Attributes:
        hypothesis: what it is; None where a model lacks something instead.
        motion: how it moves the tips.
        term, first, end: term in which it begins, samples of all terms from which on and until
            which it is so.
        p: chance that noise alone makes it explain so much there.
        lowered: squares that it explains, in units of the noise.
    """

    hypothesis: InTime | None
    motion: TipShift
    term: int
    first: int
    end: int
    p: float
    lowered: float

    @property
    def at_once(self) -> bool:
        """Whether it is so in some rows and not in others."""
        return self.hypothesis is not None and self.hypothesis.at_once

    @property
    def velocity(self) -> FloatArray:
        """(6·samples, k) of the tips, in the samples in which it is so."""
        return self.motion.within(self.first, self.end)


@single_threaded
def changes(
    answer: Examination, options: ChangeOptions = ChangeOptions()
) -> tuple[ChangeInTime, ...]:
    """The most telling change, where there is one.

    Args:
        answer: a converged one, of terms over an arm.
        options: how changes are told apart.
    """
    if answer.arm is None:
        return ()
    fit, rule = everything_follows(answer), options.rule
    weighed, tests = suspects(fit)
    telling = [suspect for suspect in weighed if tests * suspect.p < rule.false_alarm]
    look = options.worth_a_look
    if not any(suspect.lowered > look * _needed(fit, suspect, rule) for suspect in telling):
        return ()
    # A large change saturates residuals of what is like it too: what it leaves tells them apart,
    # each at the row where it explains most.
    (first, left), *rest = _told_apart(fit, telling[: options.tried], options)
    before = followed(fit).left
    lowered = before - left.left
    if first.hypothesis is None or lowered < _needed(fit, first, rule):
        return ()
    p = min(1.0, tests * _chance(fit, first))
    share = lowered / max(before, 1e-300)
    change = _change(fit, first, first.hypothesis, left, p)
    if p >= rule.false_alarm or not change.sized:
        return ()
    noise = left.scatter / max(fit.equations - left.spent, 1.0)
    instead = [
        _change(fit, suspect, suspect.hypothesis, also_left, p)
        for suspect, also_left in rest
        if suspect.hypothesis is not None and also_left.left < left.left + options.equal * noise
    ]
    sentences = tuple(change.sentence for change in instead if change.sized)
    return (replace(change, instead=sentences, share=share),)


def suspects(fit: ReducedFit) -> tuple[list[Suspect], int]:
    """All that may have changed, or that a model lacks, where it explains most.

    Returns:
        Those that the data determine, least likely by chance first; and how many were tried.
    """
    problem, table = fit.problem, fit.problem.evaluation.table
    effects = [
        effect
        for hypothesis in known_hypotheses().values()
        if isinstance(hypothesis, InTime)
        for effect in hypothesis.effects_of(problem, fit.rows)
    ]
    plausible = problem.parameters.array("plausible")
    for (joint, family), at in fit.lacking.items():
        motion = TipShift(joint, table.velocity[:, at], plausible[at])
        columns = np.vstack([columns_of(r, motion.velocity) for r in fit.rows])
        name, about = f"{joint} {family}", (None, motion, (), problem)
        effects.append(Effect(name, columns, plausible[at], about=about))
    weighed = weigh_effects(fit.linear, effects)
    suspected = list[Suspect]()
    for evidence in weighed:
        hypothesis, motion, places, _ = evidence.effect.about
        everywhere = 0, 0, int(table.first[-1])
        term, first, end = everywhere if evidence.window is None else places[evidence.window]
        p, gain = evidence.p_single, evidence.gain
        suspected.append(Suspect(hypothesis, motion, term, first, end, p, gain))
    tests = weighed[0].tried if weighed else 0
    return sorted(suspected, key=lambda suspect: (suspect.p, -suspect.lowered)), tests


def waves(fit: ReducedFit, suspect: Suspect) -> FloatArray:
    """(6·samples, m) velocity of the tips by other errors of the same encoder, per plausible one.

    Poses in the order of a joint's readings make them come and go in time.
    """
    problem, joint = fit.problem, suspect.motion.joint
    arm = problem.arm
    assert arm is not None
    if suspect.hypothesis is None or not joint:
        return np.zeros((len(suspect.motion.velocity), 0))
    k = arm.joints.index(joint)
    q = np.concatenate([term.poses.samples.q[:, k] for term in problem.terms])
    turns = np.outer(q, WAVES)
    shapes = np.repeat(np.hstack([np.cos(turns), np.sin(turns)]), 6, axis=0)
    return np.asarray(TURN * by_readings(problem)[:, :, k].reshape(-1, 1) * shapes)


def _needed(fit: ReducedFit, suspect: Suspect, rule: Rule) -> float:
    """Squares that it must explain; of gross errors, which nothing explains, none."""
    blocks = fit.problem.terms[suspect.term].blocks
    mine = [r for r in fit.rows if any(r.line.view.block is b for b in blocks)]
    sound = sum(float(np.sum(whitened(r)[r.line.weight >= 1.0] ** 2)) for r in mine)
    return rule.share * sound


def _told_apart(
    fit: ReducedFit, telling: Sequence[Suspect], options: ChangeOptions
) -> list[tuple[Suspect, Followed]]:
    """Each at its row, what explains most for its few numbers first (Schwarz's criterion)."""
    placed = [_where(fit, suspect, options) for suspect in telling]
    noise = min(left.scatter / max(fit.equations - left.spent, 1.0) for _, left in placed)

    def criterion(fitted: tuple[Suspect, Followed]) -> float:
        suspect, left = fitted
        determined = left.spent - fit.spent + suspect.at_once
        return left.left / noise + determined * float(np.log(fit.equations))

    return sorted(placed, key=criterion)


def _where(fit: ReducedFit, suspect: Suspect, options: ChangeOptions) -> tuple[Suspect, Followed]:
    """The row at which a change happened, and what all leave that follow it.

    With what followed a change that is nearly in its place, each row says whether it comes before
    or after.
    """
    left = followed(fit, suspect.velocity)
    term = fit.problem.evaluation.table.first[suspect.term : suspect.term + 2]
    if not suspect.at_once or suspect.end < term[1] or suspect.first == term[0]:
        return suspect, left
    low, high = (term + np.array([FEWEST, -FEWEST])).tolist()
    for _ in range(options.rounds):
        gain = gained(fit, left, suspect.motion.velocity)
        after = np.cumsum(gain[: suspect.end][::-1])[::-1]
        first = low + int(np.argmax(after[low : high + 1]))
        if first == suspect.first:
            break
        again = followed(fit, suspect.motion.within(first, suspect.end))
        if again.left >= left.left:
            break
        suspect, left = replace(suspect, first=first), again
    return suspect, left


def _chance(fit: ReducedFit, suspect: Suspect) -> float:
    """Chance of so much beside what a model may lack and what neighbours have in common."""
    # What an encoder reads too much of its travel looks like its own other errors.
    travel = suspect.hypothesis is not None and suspect.hypothesis.sort == "travel"
    lacking = [
        at for (joint, _), at in fit.lacking.items() if not travel or joint != suspect.motion.joint
    ]
    return chance_beside_shared_errors(fit, suspect.velocity, lacking, waves(fit, suspect))


def _change(
    fit: ReducedFit, suspect: Suspect, hypothesis: InTime, left: Followed, p: float
) -> ChangeInTime:
    size, std = left.size(fit)
    turn, turn_std = math.nan, math.nan
    if suspect.motion.velocity.shape[1] == 6:
        turn, turn_std = left.size(fit, turn=True)
        if turn < SAID_FROM * turn_std:
            turn, turn_std = math.nan, math.nan
    place = (suspect.term, suspect.first, suspect.end) if suspect.at_once else None
    since, until = rows_of(fit.problem, place)
    name = hypothesis, suspect.motion.joint
    return ChangeInTime(*name, since, size, std, p, until, turn=turn, turn_std=turn_std)
