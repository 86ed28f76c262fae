"""Many robots followed at once: after every row of each it is decided whether something changed.

Files are looked at by one process, which knows of all. What decides about the rows of a robot
(`check.Follow`) stays in one worker process from its first row to its last (`workers.seats`), and
what is said there by a row goes back at once. The robots of a worker process that ended begin again
with the first rows of their files; the one that was worked on does so once.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal
from uuid import uuid4

from suta_calib.check import Follow, FollowStep
from suta_calib.check.growing import LOOKS, FollowedFile, GrowingFile
from suta_calib.check.read_back import ReadBack
from suta_calib.display import Displayable
from suta_calib.errors import InputError, SutaCalibError
from suta_calib.fleet.checking import CheckedFleet, CheckRobots, summary_of
from suta_calib.fleet.robots import FleetRobot
from suta_calib.fleet.running import begun, crashed, guarded, reason_of
from suta_calib.fleet.summary import JobResult
from suta_calib.fleet.workers import Crash, Submit, outcome, seats

State = Literal["reading", "waiting", "sound", "held", "changed", "failed"]
# Lines that are handed over at a time: an interrupt waits for them.
_LINES: Final = 20
# Seconds after which a worker that says nothing is given up; one of a cluster may be gone.
_PATIENCE: Final = 300.0


@dataclass(frozen=True)
class FollowedRobot(Displayable):
    """Where one robot of many is.

    Attributes:
        name: of it.
        state: its result is being read; no row yet; nothing changed; the last row is far off and
            waits for the next; something changed; or its rows cannot be read any more.
        rows: so far.
        behind: lines that are there and not yet looked at.
        evidence: of a change, and the limit that says so (`FollowStep`).
        limit: of it.
        note: what changed, or went wrong.
    """

    name: str
    state: State
    rows: int = 0
    behind: int = 0
    evidence: float = 0.0
    limit: float = 0.0
    note: str = ""


Show = Callable[[Sequence[FollowedRobot]], object]


def follow_robots(
    work: CheckRobots,
    robots: Sequence[FleetRobot],
    *,
    workers: int = 1,
    dask: str | None = None,
    seconds: float | None = None,
    over: Callable[[], bool] = lambda: False,
    show: Show = lambda _: None,
    say: Callable[[str], object] = lambda _: None,
) -> CheckedFleet:
    """Follow the rows of many robots as they are appended to files, until all have changed.

    A robot of which something changed, or whose rows cannot be read, is done; the others go on.

    Args:
        work: how.
        robots: of `read_robots`; the samples of each are one file, which may be yet to come.
        workers: processes on this computer; with one, this process decides.
        dask: address of a Dask cluster that decides in their place; its workers must see the
            results under the same paths.
        seconds: how long, from when all results are read; None for ever. Rows that were read by
            then are still looked at.
        over: whether to end now, with what is known.
        show: called a few times a second with where each robot is.
        say: called with a sentence when time is up and rows are yet to be looked at.

    Raises:
        InputError: no cluster at that address.
    """
    work.refuse_missing()
    began, since = time.perf_counter(), None
    if dask is not None:
        work, robots = work.elsewhere(), [robot.absolute() for robot in robots]
    with seats(min(workers, len(robots)), dask) as submits:
        places = [_Worker(submit) for submit in submits]
        followed = [_Following(work, robot, k, places) for k, robot in enumerate(robots)]
        last = False
        while not over() and not all(robot.done for robot in followed):
            round_began = time.monotonic()
            for robot in followed:
                robot.advance(look=not last)
            show([robot.told for robot in followed])
            if since is None and all(robot.read or robot.done for robot in followed):
                since = time.monotonic()
            if last and not any(robot.busy for robot in followed):
                break
            if seconds is not None and since is not None and not last:
                last = time.monotonic() - since >= seconds
                if last:
                    for robot in followed:
                        robot.advance(look=True)
                    if rows := sum(robot.behind for robot in followed if not robot.done):
                        what = "rows are" if rows > 1 else "row is"
                        say(f"time is up: {rows:,} {what} still looked at")
            passed = time.monotonic() - round_began
            time.sleep(max(0.0, (LOOKS / 10 if last else LOOKS) - passed))
        for robot in followed:
            robot.end()
        results = [robot.result for robot in followed]
        show([robot.told for robot in followed])
    return summary_of(work, results, time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Worker:
    """A process where robots are worked on, and those that wait for it, the first one first."""

    submit: Submit
    queue: list[_Following] = field(default_factory=list)


class _Following:
    """One robot, as the process that knows of all sees it."""

    def __init__(
        self, work: CheckRobots, robot: FleetRobot, number: int, places: Sequence[_Worker]
    ) -> None:
        self._work, self._robot, self._number, self._places = work, robot, number, places
        self._row: JobResult | None = None
        self._attempts, self._began = 0, time.monotonic()
        self._grown = GrowingFile(self._robot.samples[0])
        self._lines, self._due, self._looked = b"", 0, False
        self._warnings: tuple[str, ...] = ()
        self._begin()

    def _begin(self) -> None:
        """From the first row on."""
        self._key, self._taken, self._error = uuid4().hex, 0, ""
        self._step: FollowStep | None = None
        self.read = False
        self._do(_read)

    @property
    def done(self) -> bool:
        """Whether its row is known."""
        return self._row is not None

    @property
    def busy(self) -> bool:
        """Whether something is yet to come of rows that were there."""
        return not self.done and (self._pending is not None or self.behind > 0)

    @property
    def result(self) -> JobResult:
        """Its row."""
        assert self._row is not None
        return self._row

    @property
    def behind(self) -> int:
        """Rows that were read and are not yet handed over; the first line is no row."""
        return max(self._lines.count(b"\n") - max(self._taken, 1), 0)

    @property
    def told(self) -> FollowedRobot:
        """Where it is."""
        name, step, row = self._robot.name, self._step, self._row
        rows = 0 if step is None else step.rows
        told = FollowedRobot(name, "sound", rows, self.behind)
        if step is not None:
            told = replace(told, evidence=step.evidence, limit=step.limit)
        if row is not None and row.verdict == "failed":
            return replace(told, state="failed", behind=0, note=row.error)
        if step is not None and step.changed:
            return replace(told, state="changed", behind=0, note="" if row is None else row.reason)
        if not self.read:
            return replace(told, state="reading")
        if step is None:
            return replace(told, state="waiting", note=f"waits for {self._robot.samples[0]}")
        return replace(told, state="held") if step.held else told

    def advance(self, *, look: bool) -> None:
        """Take what came of the rows before, and hand over those that came."""
        if self._pending is not None:
            self._take()
        if self.done or self._pending is not None:
            return
        self._looked = self._looked or look
        try:
            if look and not self.behind and (found := self._grown.look()) is not None:
                self._lines, fresh = found
                if fresh:
                    self._taken = self._due = 0
        except SutaCalibError as error:
            self._stop(str(error))
            return
        if self.behind:
            self._hand_over()
            if self._pending is not None and self._pending.done():
                self._take()

    def end(self) -> None:
        """Its row with what is known: when no more rows are to come."""
        while not self.done:
            if self._pending is None:
                if not self._looked:
                    file = self._robot.samples[0]
                    return self._fail(f"{file}: ended before its rows were read; follow longer")
                if self._taken < self._due:
                    self._hand_over()
                else:
                    self._do(_conclude)
            self._take(wait=True)
        return None

    def _hand_over(self) -> None:
        """The next rows are looked at."""
        last = min(max(self._taken, 1) + _LINES, self._lines.count(b"\n"))
        self._do(_decide, self._lines, self._taken, last)
        self._taken = last

    def _do(self, work: Callable[[_Given], Any], *lines: Any) -> None:
        """Have something done where this robot is worked on."""
        self._place = self._places[(self._number + self._attempts) % len(self._places)]
        given = _Given(self._key, self._work, self._robot, *lines)
        self._asked, self._innocent = time.monotonic(), False
        self._pending: Future[Any] | None = self._place.submit(work, given)
        self._place.queue.append(self)

    def _take(self, *, wait: bool = False) -> None:
        """What came of it, if it is there."""
        pending = self._pending
        assert pending is not None
        while wait and not pending.done() and time.monotonic() - self._asked < _PATIENCE:
            time.sleep(LOOKS / 10)
        if not pending.done():
            if time.monotonic() - self._asked >= _PATIENCE:
                self._crash(Crash(f"no answer for {_PATIENCE:.0f} s"))
            return
        answer = outcome(pending)
        if isinstance(answer, Crash):
            self._crash(answer)
            return
        self._place.queue.remove(self)
        self._pending = None
        if isinstance(answer, _Lost):
            self._again()
        elif isinstance(answer, JobResult):
            heard, seconds = (*self._warnings, *answer.warnings), time.monotonic() - self._began
            self._row = replace(answer, warnings=heard, seconds=seconds)
            if self._error:
                self._row = replace(self._row, verdict="failed", error=self._error)
        else:
            self.read, self._step = self.read or not answer.error, answer.step or self._step
            self._warnings = tuple(dict.fromkeys((*self._warnings, *answer.warnings)))
            if answer.error:
                self._stop(answer.error)
            elif self._step is not None and self._step.changed:
                self._do(_conclude)

    def _crash(self, crash: Crash) -> None:
        """Its process ended: whoever was worked on there, the first in the queue, has one more."""
        queue = self._place.queue
        at = queue.index(self)
        innocent = self._innocent or any(robot.has_crashed for robot in queue[:at])
        for robot in queue[at + 1 :]:
            robot._innocent = True
        queue.remove(self)
        self._pending, self._attempts = None, self._attempts + (not innocent)
        if self._attempts < 2:
            self._again()
        else:
            self._row = crashed(self._work, self._robot, crash)

    @property
    def has_crashed(self) -> bool:
        """Whether its process ended before an answer came."""
        pending = self._pending
        return pending is not None and pending.done() and isinstance(outcome(pending), Crash)

    def _again(self) -> None:
        """Once more from the first row on, in another process."""
        self._due = max(self._due, self._taken)
        self._begin()

    def _stop(self, error: str) -> None:
        """No row can be read any more; what those before show is kept."""
        if self._step is None or not self._step.rows:
            self._fail(error)
        else:
            self._error = error
            self._do(_conclude)

    def _fail(self, error: str) -> None:
        self._row = replace(begun(self._work, self._robot), error=error, warnings=self._warnings)


# What is done in a worker process.


@dataclass(frozen=True)
class _Given:
    """What a worker is given.

    Attributes:
        key: of the robot in this run.
        work: how it is checked.
        robot: which.
        lines: of its file that are complete.
        first: how many of them were taken before.
        last: how many are taken then.
    """

    key: str
    work: CheckRobots
    robot: FleetRobot
    lines: bytes = b""
    first: int = 0
    last: int = 0


@dataclass(frozen=True)
class _Taken:
    """What came of rows."""

    step: FollowStep | None = None
    error: str = ""
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Lost:
    """Instead of an answer: this process is another one than that where the robot was begun."""


# By the robot's key: its result, its rows, and the hash of its result when it was read.
_at_work: dict[str, tuple[ReadBack, FollowedFile, dict[str, str]]] = {}


def _read(given: _Given) -> _Taken:
    """Begin with a robot."""

    def begin() -> None:
        work, robot = given.work, given.robot
        inputs, answer = work.hashes_of(robot), work.read(robot.path)
        if not isinstance(answer, ReadBack):
            raise InputError(
                f"a result of {answer.command.name}",
                "one of calibrate: only these can be followed",
                file=answer.file,
                hint="check it without --follow",
            )
        follow = Follow(answer.checker, work.false_alarm)
        rows = FollowedFile(robot.samples[0], lambda f: work.terms(answer, robot, f), follow)
        _at_work[given.key] = answer, rows, inputs

    return _tried(given, begin)


def _decide(given: _Given) -> _Taken | _Lost:
    """Look at rows that came."""
    if given.key not in _at_work:
        return _Lost()
    _, rows, _ = _at_work[given.key]
    taken = _tried(given, lambda: rows.take(given.lines, given.first, given.last))
    # Of rows before a broken one, too.
    return replace(taken, step=rows.follow.step)


def _conclude(given: _Given) -> JobResult | _Lost:
    """What is known of a robot at the end, written."""
    if given.key not in _at_work:
        return _Lost()
    answer, rows, inputs = _at_work.pop(given.key)
    row = begun(given.work, given.robot)
    return guarded(
        row, lambda: given.work.concluded(given.robot, row, answer, rows.check(), inputs)
    )


def _tried(given: _Given, work: Callable[[], FollowStep | None]) -> _Taken:
    """What came of it; an error stops this robot alone."""
    with warnings.catch_warnings(record=True) as said:
        try:
            step, error = work(), ""
        except Exception as problem:  # noqa: BLE001 (a fault that one robot meets stops no other)
            step, error = None, reason_of(problem, str(given.robot.path))
    return _Taken(step, error, tuple(" ".join(str(warning.message).split()) for warning in said))
