"""Something that is not the same for all rows: what the hypotheses about changes in time share.

A change moves the tips of some rows in its own way: a column of derivatives times the rows that
suffer. `trust.changes` tells the changes apart and confirms the strongest: order in time is
mostly order in space, so that errors of a model come and go with the rows too.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import skew
from suta_calib.solver.information import Rows
from suta_calib.solver.problem import Problem
from suta_calib.terms.term import Term
from suta_calib.trust.evidence import Effect, Evidence, Stretches
from suta_calib.trust.examination import Examination
from suta_calib.trust.hypothesis import AddedVariable
from suta_calib.units import Unit, text

# What is plausible: a turn, rad, and a shift, m.
TURN: Final = 0.01
SHIFT: Final = 5e-3
# Rows before and after a change, and times at which something may have changed within one term.
FEWEST: Final = 10
TIMES: Final = 40
# Standard deviations that a turn, or the shift beside one, must be away from zero to be said.
SAID_FROM: Final = 3.0


@dataclass(frozen=True, eq=False)
class TipShift:
    """How the tips move if something changed.

    Attributes:
        joint: whose encoder it is; empty otherwise.
        velocity: (6·samples, k) of every tip, per unit.
        plausible: (k,) size.
    """

    joint: str
    velocity: FloatArray
    plausible: FloatArray

    def within(self, first: int, end: int) -> FloatArray:
        """(6·samples, k) velocity of the tips if it is so in these samples alone."""
        velocity = np.zeros_like(self.velocity)
        velocity[6 * first : 6 * end] = self.velocity[6 * first : 6 * end]
        return velocity


@dataclass(frozen=True)
class ChangeInTime:
    """Something that was not the same for all rows.

    Attributes:
        hypothesis: what changed.
        joint: whose encoder it is; empty otherwise.
        since: file and row from which on it is so; empty where it is so all along.
        size, std: by how much, and its standard deviation, in `InTime.unit`: of a drift or a
            creep until the last row.
        p: chance of residuals so suspicious, allowing for the number of tests.
        until: file and row until which it is so; empty where that is the last.
        instead: sentences of what explains these data as well.
        share: of the squared residuals that it explains.
        turn, turn_std: what was moved or crept was turned by that, rad; NaN where it was not.
    """

    hypothesis: InTime
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

    @property
    def kind(self) -> str:
        """As of the hypothesis."""
        return self.hypothesis.sort

    @property
    def sized(self) -> bool:
        """Whether its size, or its turn, is several times its standard deviation."""
        return abs(self.size) > SAID_FROM * self.std or not math.isnan(self.turn)

    @property
    def amount(self) -> str:
        """Its size with ±, and its turn. A size that is hardly more than its ± says nothing."""
        by = _with_std(self.size, self.std, self.hypothesis.unit)
        if math.isnan(self.turn):
            return by
        turned = _with_std(self.turn, self.turn_std, "rad")
        return f"{by} and {turned}" if self.size > SAID_FROM * self.std else turned

    @property
    def sentence(self) -> str:
        """What it is, and what to look at; and what these data cannot tell from it."""
        first = self.hypothesis.statement(self)
        return " Or, which these data cannot tell from it: ".join([first, *self.instead])


class InTime(AddedVariable):
    """Something that is not the same for all rows.

    Attributes:
        sort: its name in lists.
        at_once: whether it is so in some rows and not in others, or ever more.
        unit: of its size.
    """

    sort: ClassVar[str]
    at_once: ClassVar[bool] = False
    unit: ClassVar[Unit] = "m"
    # `trust.changes` does, beside errors that neighbouring rows share.
    confirmed_later: ClassVar[bool] = True

    @abstractmethod
    def motions(self, problem: Problem) -> Iterator[TipShift]:
        """How the tips move, about the point where the problem was linearised last."""

    @abstractmethod
    def statement(self, change: ChangeInTime) -> str:
        """What it is, and what to look at."""

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each motion; none where rows look at several samples, such as distances."""
        if all(block.samples.shape[1] == 1 for block in answer.problem.blocks):
            answer.table  # noqa: B018 (it brings the problem to the solution)
            yield from self.effects_of(answer.problem, answer.rows)

    def effects_of(self, problem: Problem, rows: Sequence[Rows]) -> Iterator[Effect]:
        """The same for rows that look at one sample each."""
        places, windows = stretches(problem) if self.at_once else [], None
        if self.at_once:
            if not places:
                return
            samples = [
                np.repeat(
                    r.line.view.block.samples[:, 0] + r.line.view.first_sample,
                    r.line.residual.shape[1],
                )
                for r in rows
            ]
            windows = Stretches(np.concatenate(samples), np.array(places)[:, 1:])
        for motion in self.motions(problem):
            columns = np.vstack([columns_of(r, motion.velocity) for r in rows])
            name, about = f"{self.sort} {motion.joint}".strip(), (self, motion, places, problem)
            yield Effect(name, columns, motion.plausible, windows, about=about)

    def sentence(self, evidence: Evidence) -> str:
        """What it is, its size with ±, and what to look at."""
        hypothesis, motion, places, problem = evidence.effect.about
        size, std = evidence.length(slice(0, 3))
        turn, turn_std = evidence.length(slice(3, 6))
        if len(evidence.size) == 1:
            size, turn = float(evidence.size[0]), math.nan
        elif turn < SAID_FROM * turn_std:
            turn, turn_std = math.nan, math.nan
        place = None if evidence.window is None else places[evidence.window]
        since, until = rows_of(problem, place)
        p, share = evidence.p_value, evidence.share
        return ChangeInTime(
            *(hypothesis, motion.joint, since, size, std, p, until),
            *((), share, turn, turn_std),
        ).sentence


def rows_of(problem: Problem, place: tuple[int, int, int] | None) -> tuple[str, str]:
    """File and row from which on, and until which, a change is; empty where it ends with the term.

    Args:
        problem: of the samples.
        place: term, first sample and end, as of `stretches`; None all along.
    """
    if place is None:
        return "", ""
    term, begin, end = place
    first = problem.evaluation.table.first
    origin = [row for t in problem.terms for row in t.poses.samples.origin]
    return origin[begin], "" if end in (first[term + 1], first[-1]) else origin[end - 1]


def stretches(problem: Problem, fewest: int = FEWEST) -> list[tuple[int, int, int]]:
    """Term, first sample and end of all that may have been measured in another state.

    Whatever follows a row, in its term or altogether; a file by itself.

    Args:
        problem: of which terms.
        fewest: samples in each, and beside it in its term.
    """
    term_of = dict[tuple[int, int], int]()
    starts = problem.evaluation.table.first.tolist()
    for k, term in enumerate(problem.terms):
        a, b, last = starts[k], starts[k + 1], starts[-1]
        if b - a <= 2 * fewest:
            continue
        times = np.unique(np.linspace(a + fewest, b - fewest, TIMES).astype(np.intp)).tolist()
        ends = [(t, end) for t in times for end in {b, last}]
        number = np.array([file for file, _ in term.poses.samples.files()])
        edges = [a, *(a + 1 + np.flatnonzero(np.diff(number))).tolist(), b]
        files = [(x, y) for x, y in pairwise(edges) if y - x >= fewest]
        ends += [file for file in files if file != (a, b)]
        ends += [(a, last)] if k else []
        for end in ends:
            term_of.setdefault(end, k)
    return [(k, *end) for end, k in term_of.items()]


def columns_of(rows: Rows, velocity: FloatArray) -> FloatArray:
    """(n·d, k) how whitened rows change with velocities (6·samples, k) of the tips."""
    by_pose = rows.line.by_pose / rows.line.sigma[:, None, None]
    return np.asarray(rows.line.pattern.by_parameters(by_pose, velocity))


# ── motions ─────────────────────────────────────────────────────────────────────────────────────


def by_readings(problem: Problem) -> FloatArray:
    """(samples, 6, joints) velocity of every tip by what each encoder reads too much, per unit."""
    arm, table = problem.arm, problem.evaluation.table
    assert arm is not None
    of_movers = table.velocity[:, [problem.names.index(name) for name in arm.offsets]]
    # What the encoder reads too much, the arm is turned less.
    return np.asarray(-(of_movers @ arm.gearing).reshape(-1, 6, len(arm.joints)))


def of_base(problem: Problem) -> FloatArray:
    """(samples, 6, 6) velocity of every tip by a shift and a turn along the axes of the base."""
    position = problem.evaluation.table.position
    velocity = np.zeros((len(position), 6, 6))
    velocity[:, :3, :3] = velocity[:, 3:, 3:] = np.eye(3)
    velocity[:, :3, 3:] = -skew(position - position.mean(axis=0))
    return velocity


def of_tip(problem: Problem) -> FloatArray:
    """(samples, 6, 6) the same along the tip's own axes, and about the tip."""
    axes = np.swapaxes(problem.evaluation.table.rotation.reshape(-1, 3, 3), 1, 2)
    velocity = np.zeros((len(axes), 6, 6))
    velocity[:, :3, :3] = velocity[:, 3:, 3:] = axes
    return velocity


def so_far(problem: Problem) -> Iterator[FloatArray]:
    """(samples,) which share of each term's rows has been measured, zero in all others."""
    first = problem.evaluation.table.first
    for a, b in pairwise(first.tolist()):
        share = np.zeros(first[-1])
        share[a:b] = np.arange(b - a) / (b - a)
        yield share


def flat(velocity: FloatArray, share: FloatArray | float = 1.0) -> FloatArray:
    """(6·samples, k) velocities (samples, 6, k) times how much of them each sample has."""
    scaled = velocity * np.broadcast_to(share, len(velocity))[:, None, None]
    return np.asarray(scaled.reshape(-1, velocity.shape[2]))


TWIST: Final = np.repeat([SHIFT, TURN], 3)


def _with_std(size: float, std: float, unit: Unit) -> str:
    return f"{text(size, unit)} ± {text(std, unit, with_unit=True)}"


def later_half(term: Term) -> BoolArray:
    """(n,) rows of a term from one near its middle on, at which a change is looked for."""
    times = np.linspace(FEWEST, len(term.poses) - FEWEST, TIMES).astype(np.intp)
    return np.asarray(np.arange(len(term.poses)) >= times[TIMES // 2])
