"""Something that is not the same for all rows: what the hypotheses about changes in time share.

A change moves the tips of some rows in its own way: a column of derivatives times the rows that
suffer. `trust.changes` tells the changes apart and confirms the strongest: order in time is
mostly order in space, so that errors of a model come and go with the rows too.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import skew
from suta_calib.model.parameters import End
from suta_calib.solver.information import Rows
from suta_calib.solver.problem import Problem
from suta_calib.terms.term import Term
from suta_calib.trust.evidence import Effect, Evidence, Stretches, length_of
from suta_calib.trust.examination import Examination, by_motion, samples_of
from suta_calib.trust.hypothesis import AddedVariable, SpoiltData, Truth
from suta_calib.trust.simulated_faults import arm_of, chains_of, displaced
from suta_calib.units import Unit, with_std

# A turn that is plausible, rad.
TURN: Final = 0.01
# Rows before and after a change, and times at which something may have changed within one term.
FEWEST: Final = 10
TIMES: Final = 40
# Standard deviations that a turn, or the shift beside one, must be away from zero to be said.
SAID_FROM: Final = 3.0


@dataclass(frozen=True, eq=False)
class TipShift:
    """How the tips move if something changed.

    Attributes:
        joint: whose encoder it is; of several chains, at the end of which one it is; or empty.
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
        joint: as of `TipShift`.
        since: file and row from which on it is so; empty where it is so all along.
        size, std: by how much, and its standard deviation, in `InTime.unit`: of a drift or a
            creep until the last row.
        p: chance of residuals so suspicious, allowing for the number of tests.
        until: file and row until which it is so; empty where that is the last.
        instead: sentences of what explains these data as well.
        share: of the squared residuals that it explains, of rows in which it is so.
        turn, turn_std: what was moved or crept was turned by that, rad; NaN where it was not.
        what: a camera or a body that these rows alone look at, by its label; or empty.
        of_all: as `share`, of the squared residuals of all rows.
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
    what: str = ""
    of_all: float = 0.0

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
        by = with_std(self.size, self.std, self.hypothesis.unit)
        if math.isnan(self.turn):
            return by
        turned = with_std(self.turn, self.turn_std, "rad")
        return f"{by} and {turned}" if self.size > SAID_FROM * self.std else turned

    @property
    def sentence(self) -> str:
        """What it is, and what to look at; and what these data cannot tell from it."""
        first = self.hypothesis.statement(self)
        return " These data fit another cause as well: ".join([first, *self.instead])


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

    def subject(self, problem: Problem, place: tuple[int, int, int] | None) -> str:
        """What rows at one of the `stretches` alone look at, by its label; empty for no such."""
        del problem, place
        return ""

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
            windows = Stretches(samples_of(rows), np.array(places)[:, 1:])
        for motion in self.motions(problem):
            name, about = f"{self.sort} {motion.joint}".strip(), (self, motion, places, problem)
            columns = by_motion(rows, motion.velocity)
            yield Effect(name, columns, motion.plausible, windows, about=about)

    def change(
        self,
        motion: TipShift,
        size: FloatArray,
        covariance: FloatArray,
        rows: tuple[str, str],
        p: float,
        share: float = 0.0,
        what: str = "",
    ) -> ChangeInTime:
        """The change of such a size (k,), from and until two rows, of some `subject`."""
        (amount, std), turn = length_of(size[:3], covariance[:3, :3]), (math.nan, math.nan)
        if len(size) == 1:
            amount = float(size[0])
        else:
            turn = length_of(size[3:], covariance[3:, 3:])
            turn = turn if turn[0] >= SAID_FROM * turn[1] else (math.nan, math.nan)
        since, until = rows
        of_rows = since, amount, std, p, until, (), share
        return ChangeInTime(self, motion.joint, *of_rows, *turn, what)

    def sentence(self, evidence: Evidence) -> str:
        """What it is, its size with ±, and what to look at."""
        hypothesis, motion, places, problem = evidence.effect.about
        place = None if evidence.window is None else places[evidence.window]
        change: ChangeInTime = hypothesis.change(
            *(motion, evidence.size, evidence.covariance, rows_of(problem, place)),
            *(evidence.p_value, evidence.share, hypothesis.subject(problem, place)),
        )
        return change.sentence


def rows_of(problem: Problem, place: tuple[int, int, int] | None) -> tuple[str, str]:
    """File and row from which on, and until which, a change is; empty where it ends with the term.

    The place is one of `stretches`; None all along.
    """
    if place is None:
        return "", ""
    term, begin, end = place
    first = problem.evaluation.table.first
    origin = [row for t in problem.terms for row in t.poses.samples.origin]
    return origin[begin], "" if end in (first[term + 1], first[-1]) else origin[end - 1]


def stretches(problem: Problem) -> list[tuple[int, int, int]]:
    """Term, first sample and end of all that may have been measured in another state.

    Whatever follows a row, in its term or altogether; a file by itself.
    """
    term_of = dict[tuple[int, int], int]()
    starts = problem.evaluation.table.first.tolist()
    for k, term in enumerate(problem.terms):
        a, b, last = starts[k], starts[k + 1], starts[-1]
        if b - a <= 2 * FEWEST:
            continue
        times = np.unique(np.linspace(a + FEWEST, b - FEWEST, TIMES).astype(np.intp)).tolist()
        ends = [(t, end) for t in times for end in {b, last}]
        number = np.array([file for file, _ in term.poses.samples.files()])
        edges = [a, *(a + 1 + np.flatnonzero(np.diff(number))).tolist(), b]
        files = [(x, y) for x, y in pairwise(edges) if y - x >= FEWEST]
        ends += [file for file in files if file != (a, b)]
        ends += [(a, last)] if k else []
        for end in ends:
            term_of.setdefault(end, k)
    return [(k, *end) for end, k in term_of.items()]


# ── motions ─────────────────────────────────────────────────────────────────────────────────────


def by_readings(problem: Problem) -> FloatArray:
    """(samples, 6, joints) velocity of every tip by what each encoder reads too much, per unit."""
    arm, table = problem.arm, problem.evaluation.table
    assert arm is not None
    of_movers = table.velocity[:, [problem.names.index(name) for name in arm.offsets]]
    # What the encoder reads too much, the arm is turned less.
    return np.asarray(-(of_movers @ arm.gearing).reshape(-1, 6, len(arm.joints)))


def so_far(problem: Problem) -> Iterator[FloatArray]:
    """(samples,) which share of each term's rows has been measured, zero in all others."""
    first = problem.evaluation.table.first
    for a, b in pairwise(first.tolist()):
        share = np.zeros(first[-1])
        share[a:b] = np.arange(b - a) / (b - a)
        yield share


def _flat(velocity: FloatArray, share: FloatArray | float = 1.0) -> FloatArray:
    """(6·samples, k) velocities (samples, 6, k) times how much of them each sample has."""
    scaled = velocity * np.broadcast_to(share, len(velocity))[:, None, None]
    return np.asarray(scaled.reshape(-1, velocity.shape[2]))


class EncoderInTime(InTime):
    """One joint reads too much, by an amount that is not the same for all rows."""

    unit: ClassVar[Unit] = "rad"
    plausible: ClassVar[float] = TURN

    def shares(self, problem: Problem, joint: int) -> Iterable[FloatArray | float]:
        """Of the amount, how much each sample (samples,) has: one motion for each."""
        return (1.0,)

    def motions(self, problem: Problem) -> Iterator[TipShift]:
        """One for each joint and share."""
        arm, velocity = problem.arm, by_readings(problem)
        assert arm is not None
        for k, joint in enumerate(arm.joints):
            for share in self.shares(problem, k):
                motion = _flat(velocity[:, :, [k]], share)
                yield TipShift(joint, motion, np.array([self.plausible]))


class FrameInTime(InTime):
    """Every tip is displaced and turned with a frame: from a row on, or ever more.

    Attributes:
        what: that frame, as a sentence names it.
        end: of which end of the chains it is: each has its own.
    """

    what: ClassVar[str]
    end: ClassVar[End]

    @abstractmethod
    def axes(self, rotation: FloatArray) -> FloatArray:
        """(n, 3, 3) the frame's axes in the base, for rotations (n, 3, 3) of the tips."""

    def velocity(self, problem: Problem) -> FloatArray:
        """(samples, 6, 6) of every tip, by a shift and a turn along the frame's axes."""
        table = problem.evaluation.table
        velocity = np.zeros((len(table.position), 6, 6))
        axes = self.axes(np.swapaxes(table.rotation.reshape(-1, 3, 3), 1, 2))
        velocity[:, :3, :3] = velocity[:, 3:, 3:] = axes
        return velocity

    def motions(self, problem: Problem) -> Iterator[TipShift]:
        """Of each end, one where it happens at once, else one for each term."""
        velocity, chains = self.velocity(problem), chains_of(problem.terms, self.end)
        arms = [(arm_of(term), len(term.poses)) for term in problem.terms]
        for name, alike in chains.items():
            own = np.concatenate([np.full(n, float(arm in alike)) for arm, n in arms])
            for share in (1.0,) if self.at_once else so_far(problem):
                if np.any(own * share):
                    # A shift of 5 mm is plausible.
                    motion = _flat(velocity, own * share)
                    yield TipShift(name, motion, np.repeat([5e-3, TURN], 3))

    def subject(self, problem: Problem, place: tuple[int, int, int] | None) -> str:
        """What stands at this end, where rows of one term of several look at it, and no others."""
        first = problem.evaluation.table.first
        if place is None or len(problem.terms) == 1 or place[2] > first[place[0] + 1]:
            return ""
        frames = [f for f in problem.terms[place[0]].outside if f.within == self.end]
        owners = [f.owner for term in problem.terms for f in term.outside]
        if len(frames) != 1 or owners.count(frames[0].owner) > 1:
            return ""
        label = frames[0].owner.partition("[")[2].rstrip("]")
        return f"{frames[0].what} {label}".strip()

    def statement(self, change: ChangeInTime) -> str:
        """From where to where, by how much."""
        chain = f" of chain {change.joint}" if change.joint else ""
        what = change.what or self.what.format(chain)
        if not self.at_once:
            return (
                f"The {what} crept by {change.amount} while the rows were measured. Let it "
                "warm up, or fix it, and measure again."
            )
        if change.until:
            return (
                f"The {what} was at another place, by {change.amount}, from {change.since} to "
                f"{change.until}. Give these rows another label."
            )
        return (
            f"The {what} was moved by {change.amount} at {change.since}. Give the rows after "
            "it another label."
        )

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """Two millimetres: from the middle on, or until the last row."""
        by = 2e-3 * np.array([0.6, 0.0, 0.8])
        twist = np.zeros((len(data.poses), 6))
        share = later_half(data) if self.at_once else np.arange(len(twist)) / len(twist)
        twist[:, :3] = self.axes(data.poses.at(values)[0]) @ by * share[:, None]
        return SpoiltData(displaced(data, values, twist), np.array([*by, 0.0, 0.0, 0.0]))


class BaseInTime(FrameInTime):
    """A base, an instrument or an artefact."""

    what = "base{}, or what it measures,"
    end = "base"

    def axes(self, rotation: FloatArray) -> FloatArray:
        """Those of the base."""
        return np.broadcast_to(np.eye(3), rotation.shape)

    def velocity(self, problem: Problem) -> FloatArray:
        """A turn is one about the middle of all tips."""
        velocity, position = super().velocity(problem), problem.evaluation.table.position
        velocity[:, :3, 3:] = -skew(position - position.mean(axis=0))
        return velocity


class TipInTime(FrameInTime):
    """A tool, or what is on it; it turns about the tip."""

    what = "tool{}, or the target on it,"
    end = "tip"

    def axes(self, rotation: FloatArray) -> FloatArray:
        """Those of the tip."""
        return rotation


def later_half(term: Term) -> BoolArray:
    """(n,) rows of a term from one near its middle on, at which a change is looked for."""
    times = np.linspace(FEWEST, len(term.poses) - FEWEST, TIMES).astype(np.intp)
    return np.asarray(np.arange(len(term.poses)) >= times[TIMES // 2])
