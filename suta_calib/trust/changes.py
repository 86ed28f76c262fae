"""Detects changes during the measurement. An encoder that slipped, a base that crept away.

Small changes hide: the fit spreads them over its unknowns, and every residual stays plausible. Each
of them moves the tip in its own way, though, from some row on or ever more: the hypotheses of
`trust.in_time`. They are weighed with all of the geometry free to follow (`reduced_fit`), so that
nothing is fitted anew. The strongest are told apart by what a robust fit leaves, and confirmed
beside all else that a model may lack, and what neighbouring rows get wrong alike
(`shared_errors`): order in time is mostly order in space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray
from suta_calib.threads import single_threaded
from suta_calib.trust.evidence import Effect, weigh_effects
from suta_calib.trust.examination import Examination, samples_of
from suta_calib.trust.hypothesis import known_hypotheses
from suta_calib.trust.in_time import (
    FEWEST,
    TURN,
    ChangeInTime,
    InTime,
    TipShift,
    by_readings,
    rows_of,
)
from suta_calib.trust.linear_fit import LinearFit, RobustStep
from suta_calib.trust.neighbour_correlation import chance_beside_shared_errors
from suta_calib.trust.reduced_fit import ReducedFit, everything_follows
from suta_calib.trust.rule import Rule


@dataclass(frozen=True, eq=False)
class SuspectedChange:
    """A possible change, at the row where it explains most.

    Attributes:
        hypothesis: what it is; None where a model lacks something instead.
        motion: how it moves the tips.
        term, first, end: term in which it begins, samples of all terms from which on and until
            which it is so.
        p: chance that noise alone makes it explain so much there.
        lowered: squares that it explains, in units of the noise.
        design: how much more scores vary than those of independent rows; at least 1.
    """

    hypothesis: InTime | None
    motion: TipShift
    term: int
    first: int
    end: int
    p: float
    lowered: float
    design: float = 1.0

    @property
    def at_once(self) -> bool:
        """Whether it is so in some rows and not in others."""
        return self.hypothesis is not None and self.hypothesis.at_once

    @property
    def velocity(self) -> FloatArray:
        """(6·samples, k) of the tips, in the samples in which it is so."""
        return self.motion.within(self.first, self.end)


@single_threaded
def changes(answer: Examination, rule: Rule = Rule()) -> tuple[ChangeInTime, ...]:
    """The most significant change, or None."""
    if answer.arm is None:
        return ()
    fit = everything_follows(answer)
    weighed, tests = suspects(fit)
    telling = [suspect for suspect in weighed if tests * suspect.p < rule.false_alarm]
    # Times the share that a change needs, from which on the row is looked for at which it happened:
    # at the rows that are tried first, it seems to explain less.
    look = 0.3
    if not any(suspect.lowered > look * _needed(fit, suspect, rule) for suspect in telling):
        return ()
    # A large change saturates residuals of what is like it too: what it leaves tells them apart,
    # each at the row where it explains most.
    (first, left), *rest = _told_apart(fit, telling[:3])
    before = fit.linear.robust.cost
    lowered = before - left.cost
    if first.hypothesis is None or lowered < _needed(fit, first, rule):
        return ()
    p = min(1.0, tests * _chance(fit, first))
    change = _change(fit, first, first.hypothesis, left, p)
    if p >= rule.false_alarm or not change.sized:
        return ()
    # Squares, in units of the noise, by which what explains data as well differs at most.
    equal = 9.0
    instead = [
        _change(fit, suspect, suspect.hypothesis, also_left, p)
        for suspect, also_left in rest
        if suspect.hypothesis is not None and also_left.cost < left.cost + equal * left.noise
    ]
    sentences = tuple(change.sentence for change in instead if change.sized)
    concerned = fit.linear.squares_where(fit.columns(first.velocity)) / fit.linear.squares
    of_all = lowered / max(before, 1e-300)
    share = lowered / max(concerned * before, 1e-300)
    return (replace(change, instead=sentences, share=share, of_all=of_all),)


def suspects(fit: ReducedFit) -> tuple[list[SuspectedChange], int]:
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
        columns, about = fit.jacobian[:, at], (None, motion, (), problem)
        effects.append(Effect(f"{joint} {family}", columns, plausible[at], about=about))
    weighed = weigh_effects(fit.linear, effects)
    suspected = list[SuspectedChange]()
    for evidence in weighed:
        hypothesis, motion, places, _ = evidence.effect.about
        everywhere = 0, 0, int(table.first[-1])
        term, first, end = everywhere if evidence.window is None else places[evidence.window]
        found = evidence.p_single, evidence.gain, evidence.design
        suspected.append(SuspectedChange(hypothesis, motion, term, first, end, *found))
    tests = weighed[0].tried if weighed else 0
    return sorted(suspected, key=lambda suspect: (suspect.p, -suspect.lowered)), tests


def waves(fit: ReducedFit, suspect: SuspectedChange) -> FloatArray:
    """(6·samples, m) velocity of the tips by other errors of the same encoder, per plausible one.

    Poses in the order of a joint's readings make them come and go in time.
    """
    problem, joint = fit.problem, suspect.motion.joint
    arm = problem.arm
    assert arm is not None
    if suspect.hypothesis is None or joint not in arm.joints:
        return np.zeros((len(suspect.motion.velocity), 0))
    k = arm.joints.index(joint)
    q = np.concatenate([term.poses.samples.q[:, k] for term in problem.terms])
    # So often in a turn, beside those that an eccentric one has.
    turns = np.outer(q, (3, 4, 5, 6))
    shapes = np.repeat(np.hstack([np.cos(turns), np.sin(turns)]), 6, axis=0)
    return np.asarray(TURN * by_readings(problem)[:, :, k].reshape(-1, 1) * shapes)


def _needed(fit: ReducedFit, suspect: SuspectedChange, rule: Rule) -> float:
    """Squared residuals that it must explain; gross errors do not count."""
    first, end = fit.problem.evaluation.table.first[suspect.term : suspect.term + 2]
    sample = samples_of(fit.rows)
    sound = (sample >= first) & (sample < end) & (fit.linear.weights >= 1.0)
    return rule.share * float(np.sum(fit.linear.residual[sound] ** 2))


def _told_apart(
    fit: ReducedFit, telling: Sequence[SuspectedChange]
) -> list[tuple[SuspectedChange, RobustStep]]:
    """Each at its row, what explains most for its few numbers first (Schwarz's criterion)."""
    placed = [_where(fit, suspect) for suspect in telling]
    noise = min(left.noise for _, left in placed)

    def criterion(fitted: tuple[SuspectedChange, RobustStep]) -> float:
        suspect, left = fitted
        determined = left.spent - fit.spent + suspect.at_once
        return left.cost / noise + determined * float(np.log(fit.linear.rows))

    return sorted(placed, key=criterion)


def _where(fit: ReducedFit, suspect: SuspectedChange) -> tuple[SuspectedChange, RobustStep]:
    """The row at which a change happened, and what all leave that follow it.

    With what followed a change that is nearly in its place, each row says whether it comes before
    or after.
    """
    # So often, at most, the row is looked for anew.
    rounds = 4
    left = fit.followed(suspect.velocity)
    term = fit.problem.evaluation.table.first[suspect.term : suspect.term + 2]
    if not suspect.at_once or suspect.end < term[1] or suspect.first == term[0]:
        return suspect, left
    low, high = (term + np.array([FEWEST, -FEWEST])).tolist()
    for _ in range(rounds):
        gain = fit.gained(left, suspect.motion.velocity)
        after = np.cumsum(gain[: suspect.end][::-1])[::-1]
        first = low + int(np.argmax(after[low : high + 1]))
        if first == suspect.first:
            break
        again = fit.followed(suspect.motion.within(first, suspect.end))
        if again.cost >= left.cost:
            break
        suspect, left = replace(suspect, first=first), again
    return suspect, left


def _chance(fit: ReducedFit, suspect: SuspectedChange) -> float:
    """Chance of so much beside what a model may lack and what neighbours have in common."""
    # What an encoder reads too much of its travel looks like its own other errors.
    travel = suspect.hypothesis is not None and suspect.hypothesis.sort == "travel"
    lacking = [
        at for (joint, _), at in fit.lacking.items() if not travel or joint != suspect.motion.joint
    ]
    p = chance_beside_shared_errors(fit, suspect.velocity, lacking, waves(fit, suspect))
    return max(p, _chance_by_clusters(fit.linear, fit.columns(suspect.velocity)))


def _chance_by_clusters(fit: LinearFit, columns: FloatArray) -> float:
    """Chance of so much where rows of one rest share what the arm errs by; 0 where none do.

    By what each rest would say that was left out (the jackknife of clusters: Bell and McCaffrey
    2002): all unknowns together follow the few errors that there are, and the residuals that they
    leave show only a part of these.
    """
    if fit.clusters is None or fit.clusters.shape[1] > 1:
        return 0.0
    root = np.sqrt(fit.weights)[:, None]
    follow = columns + fit.jacobian @ fit.moves(columns)
    score = fit.scores(follow, fit.settled).sum(axis=0)
    inverse = np.linalg.pinv((follow * root).T @ (follow * root), 1e-9, hermitian=True)
    left = (fit.settled - follow @ (inverse @ score))[:, None] * root
    variance, count = np.zeros((len(score), len(score))), fit.cluster_count
    order = np.argsort(fit.clusters[:, 0], kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(fit.clusters[order, 0])) + 1):
        own, gain = follow[rows] * root[rows], fit.jacobian[rows] * root[rows]
        share, axes = np.linalg.eigh(gain @ fit.inverse @ gain.T + own @ inverse @ own.T)
        # A rest that decides nearly alone says nothing of what others err by.
        alone = axes @ ((axes.T @ left[rows]) / np.maximum(1.0 - share, 0.1)[:, None])
        variance += (own.T @ alone) @ (own.T @ alone).T * (count - 1) / count
    rank = max(int(np.linalg.matrix_rank(inverse, 1e-9, hermitian=True)), 1)
    ratio = float(score @ np.linalg.pinv(variance, 1e-9, hermitian=True) @ score)
    return float(fdtrc(rank, max(count - rank, 1), ratio / rank))


def _change(
    fit: ReducedFit, suspect: SuspectedChange, hypothesis: InTime, left: RobustStep, p: float
) -> ChangeInTime:
    more = slice(-suspect.motion.velocity.shape[1], None)
    place = (suspect.term, suspect.first, suspect.end) if suspect.at_once else None
    covariance = left.noise * suspect.design * left.inverse[more, more]
    rows = rows_of(fit.problem, place)
    what = hypothesis.subject(fit.problem, place)
    return hypothesis.change(suspect.motion, left.step[more], covariance, rows, p, what=what)
