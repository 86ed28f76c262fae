"""Did something change while it was measured? An encoder that slipped, a base that crept away.

Small changes hide: the fit spreads them over its unknowns, and every residual stays plausible. Each
of them moves the tip in its own way, though, from some row on or ever more: a column of derivatives
that no unknown of the job has (`suspects`). It is tested with all of the geometry free to follow
(`following`), so that nothing is fitted anew, and then beside all else that a model may lack, and
what neighbouring rows get wrong alike (`shared_errors`): order in time is mostly order in space.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from suta_calib.diagnostics.following import (
    Followed,
    Following,
    everything_follows,
    followed,
    gained,
    whitened,
)
from suta_calib.diagnostics.shared_errors import chance_beside_shared_errors
from suta_calib.diagnostics.suspects import (
    Telling,
    most_telling,
    stretches,
    suspects,
    waves,
)
from suta_calib.threads import single_threaded
from suta_calib.trust.examination import Examination
from suta_calib.units import Unit, text


@dataclass(frozen=True)
class ChangeOptions:
    """What is looked for, and from when on it is said.

    Attributes:
        fewest: rows before and after a change.
        level: chance that one of all tests calls sound data changed.
        share: of a term's squares without its gross errors, which a change must explain: where the
            model lacks much, and rows are many, everything is significant and little of it is the
            cause.
        worth_a_look: times that share, from which on the row is looked for at which it happened:
            at the rows that are tried first, it seems to explain less.
        alike: squares, in units of the noise, by which what explains data as well differs at most.
        times_std: standard deviations that a size must be away from zero to be said.
        tried: so many of what may have changed are told apart by what they leave.
        rounds: so often, at most, the row at which each of these happened is looked for anew.
    """

    fewest: int = 10
    level: float = 1e-3
    share: float = 0.25
    worth_a_look: float = 0.3
    alike: float = 9.0
    times_std: float = 3.0
    tried: int = 3
    rounds: int = 4


@dataclass(frozen=True)
class Disturbance:
    """Something that was not the same for all rows.

    Attributes:
        kind: ``slip``, ``drift`` or ``travel`` of an encoder; ``base`` or ``tip`` that was moved;
            ``base creep``, ``tip creep``.
        joint: whose encoder it is; empty otherwise.
        since: file and row from which on it is so; empty where it is so all along.
        until: file and row until which it is so; empty where that is the last.
        instead: sentences of what explains these data as well.
        size, std: by how much, and its standard deviation: rad of a slip, and of a drift until the
            last row; a number of a travel; metres of what was moved or crept until the last row.
        turn, turn_std: what was moved or crept was turned by that, rad; NaN where it was not.
        p: chance of residuals so suspicious, allowing for the number of tests.
        share: of the squared residuals that it explains.
    """

    kind: str
    joint: str
    since: str
    size: float
    std: float
    p: float
    until: str = ""
    instead: tuple[str, ...] = ()
    share: float = 0.0
    turn: float = math.nan
    turn_std: float = math.nan

    def sized(self, options: ChangeOptions) -> bool:
        """Whether its size, or its turn, is several times its standard deviation."""
        return abs(self.size) > options.times_std * self.std or not math.isnan(self.turn)

    @property
    def sentence(self) -> str:
        """What it is, and what to look at; and what these data cannot tell from it."""
        return " Or, which these data cannot tell from it: ".join([self._alone, *self.instead])

    @property
    def _alone(self) -> str:
        if self.kind == "travel":
            return (
                f"{self.joint} reads {100 * self.size:+.3f} ± {100 * self.std:.3f} % of its travel "
                "too much: does its encoder lose or double counts, or is a gear ratio wrong?"
            )
        unit: Unit = "rad" if self.kind in ("slip", "drift") else "m"
        by = _with_std(self.size, self.std, unit)
        if not math.isnan(self.turn):
            # A size that is hardly more than its ± says nothing beside a turn.
            turned = _with_std(self.turn, self.turn_std, "rad")
            shifted = self.size > ChangeOptions.times_std * self.std
            by = f"{by} and {turned}" if shifted else turned
        if self.kind == "slip":
            when = f"from {self.since} to {self.until} than in other rows"
            if not self.until:
                when = f"from {self.since} on than before"
            return (
                f"{self.joint} reads {by} more {when}: did its encoder slip, or was its zero set "
                "anew?"
            )
        if self.kind == "drift":
            return (
                f"The zero of {self.joint} drifted by {by} while the rows were measured: let it "
                "warm up, and look whether its encoder sits fast."
            )
        what = "tool, or what is on it," if self.kind.startswith("tip") else "base, or what it met,"
        if self.kind.endswith("creep"):
            return f"The {what} crept by {by} while the rows were measured: let it warm up, fix it."
        if self.until:
            return (
                f"The {what} was elsewhere by {by} from {self.since} to {self.until}: give these "
                "rows another label."
            )
        return (
            f"The {what} was moved by {by} at {self.since}: give the rows after it another label."
        )


@single_threaded
def changes(
    answer: Examination, options: ChangeOptions = ChangeOptions()
) -> tuple[Disturbance, ...]:
    """The most telling change, where there is one.

    Args:
        answer: a converged one, of terms over an arm.
        options: what is looked for.
    """
    if answer.arm is None:
        return ()
    fit = everything_follows(answer)
    found, tried = most_telling(fit, [*suspects(fit)], stretches(fit, options.fewest))
    telling = [each for each in found if tried * each.p < options.level]
    if not any(
        each.lowered > options.worth_a_look * _needed(fit, each, options) for each in telling
    ):
        return ()
    # A large change saturates residuals of what is like it too: what it leaves tells them apart,
    # each at the row where it explains most.
    (where, done), *others = _told_apart(fit, telling[: options.tried], options)
    before = followed(fit).left
    lowered = before - done.left
    if where.suspect.kind == "model" or lowered < _needed(fit, where, options):
        return ()
    p = min(1.0, tried * _chance(fit, where))
    first = _change(fit, where, done, p)
    if p >= options.level or not first.sized(options):
        return ()
    noise = done.scatter / max(fit.equations - done.spent, 1.0)
    instead = tuple(
        other.sentence
        for each in others
        if each[0].suspect.kind != "model" and each[1].left < done.left + options.alike * noise
        if (other := _change(fit, *each, p)).sized(options)
    )
    share = lowered / max(before, 1e-300)
    return (replace(first, instead=instead, share=share),)


def _needed(fit: Following, each: Telling, options: ChangeOptions) -> float:
    """Squares that it must explain; of gross errors, which nothing explains, none."""
    blocks = fit.problem.terms[each.term].blocks
    mine = [r for r in fit.rows if any(r.line.view.block is b for b in blocks)]
    sound = sum(float(np.sum(whitened(r)[r.line.weight >= 1.0] ** 2)) for r in mine)
    return options.share * sound


def _told_apart(
    fit: Following, telling: Sequence[Telling], options: ChangeOptions
) -> list[tuple[Telling, Followed]]:
    """Each at its row, what explains most for its few numbers first (Schwarz's criterion)."""
    tried = [_where(fit, each, options) for each in telling]
    noise = min(done.scatter / max(fit.equations - done.spent, 1.0) for _, done in tried)

    def criterion(each: tuple[Telling, Followed]) -> float:
        where, done = each
        told = done.spent - fit.spent + where.suspect.at_once
        return done.left / noise + told * float(np.log(fit.equations))

    return sorted(tried, key=criterion)


def _where(fit: Following, where: Telling, options: ChangeOptions) -> tuple[Telling, Followed]:
    """The row at which a change happened, and what all leave that follow it.

    With what followed a change that is nearly in its place, each row says whether it comes before
    or after.
    """
    done = followed(fit, where.suspect.within(where.first, where.end))
    term = fit.problem.evaluation.table.first[where.term : where.term + 2]
    if not where.suspect.at_once or where.end < term[1] or where.first == term[0]:
        return where, done
    low, high = (term + np.array([options.fewest, -options.fewest])).tolist()
    for _ in range(options.rounds):
        gain = gained(fit, done, where.suspect.motion)
        after = np.cumsum(gain[: where.end][::-1])[::-1]
        first = low + int(np.argmax(after[low : high + 1]))
        if first == where.first:
            break
        again = followed(fit, where.suspect.within(first, where.end))
        if again.left >= done.left:
            break
        where, done = replace(where, first=first), again
    return where, done


def _chance(fit: Following, where: Telling) -> float:
    """Chance of so much beside what a model may lack and what neighbours have in common."""
    # Data in which nothing stands out have no use for it.

    suspect = where.suspect
    # What an encoder reads too much of its travel looks like its own other errors.
    lacking = [
        at
        for (joint, _), at in fit.lacking.items()
        if suspect.kind != "travel" or joint != suspect.joint
    ]
    velocity = suspect.within(where.first, where.end)
    return chance_beside_shared_errors(fit, velocity, lacking, waves(fit, suspect))


def _change(fit: Following, where: Telling, done: Followed, p: float) -> Disturbance:
    suspect, first = where.suspect, fit.problem.evaluation.table.first
    size, std = done.size(fit)
    turn, turn_std = math.nan, math.nan
    if suspect.motion.shape[1] == 6:
        turn, turn_std = done.size(fit, turn=True)
        if turn < ChangeOptions.times_std * turn_std:
            turn, turn_std = math.nan, math.nan
    since = until = ""
    if suspect.at_once:
        origin = [row for term in fit.problem.terms for row in term.poses.samples.origin]
        since = origin[where.first]
        until = "" if where.end in (first[where.term + 1], first[-1]) else origin[where.end - 1]
    name = suspect.kind, suspect.joint
    return Disturbance(*name, since, size, std, p, until, turn=turn, turn_std=turn_std)


def _with_std(size: float, std: float, unit: Unit) -> str:
    return f"{text(size, unit)} ± {text(std, unit, with_unit=True)}"
