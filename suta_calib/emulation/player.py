"""An emulated arm in real time on a pseudo-terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from heapq import merge
from operator import itemgetter
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.emulation.motion import Motion, Stops
from suta_calib.emulation.stream import Emulation, packets
from suta_calib.emulation.terminal import PseudoTerminal

# How often somebody who opens the port, or asks to stop, is looked for, s.
_LOOK: Final = 2e-3
# What is sent, and read, at most so late is punctual, s.
_PUNCTUAL: Final = 0.03
_NEXT: Final = "end of the round: the arm rests at the first place of the next round"


@dataclass()
class Played:
    """What was sent.

    Attributes:
        sent: packets that went out.
        unheard: packets that did not, because nobody listened or nobody read.
        silent: packets that faults kept from being sent.
        late: largest delay behind the clock, s.
    """

    sent: int = 0
    unheard: int = 0
    silent: int = 0
    late: float = 0.0

    def __str__(self) -> str:
        return (
            f"{self.sent} frames sent, {self.unheard} not read by any program, {self.silent} "
            f"suppressed by faults; at most {1000.0 * self.late:.1f} ms late"
        )


class Player:
    """Streams an emulation at its rate.

    Every packet has its time on the clock, so that delays do not add up: what is late is sent at
    once. The motion, and the times of all faults, begin when the port is first opened; the
    device's clock runs from the start.

    Args:
        emulation: the arm.
        terminal: the port.
        on_event: told in words when the port is opened, vanishes or comes back, and when a round
            is over.
        gated: whether the arm waits between rounds; see `RoundClock`.
        recorded: whether the true trajectory is kept, for as long as it plays.
        patient: whether it waits for whoever has the port open and has not read for so long that
            the port is full (flow control), and then makes up for it, instead of going on unheard;
            and does not leave the first place of a round before its reader has kept up for a
            while: one that believes what it reads only then has the whole rest before it.
    """

    def __init__(
        self,
        emulation: Emulation,
        terminal: PseudoTerminal,
        on_event: Callable[[str], None] = lambda _: None,
        *,
        gated: bool = True,
        recorded: bool = False,
        patient: bool = False,
    ) -> None:
        self.played = Played()
        self._emulation, self._terminal, self._tell = emulation, terminal, on_event
        self._gated, self._recorded, self._patient = gated, recorded, patient
        self._first = self._punctual = 0
        self._late = self._asked_since = 0.0
        self._packet = b""
        self._blocks: list[tuple[FloatArray, FloatArray]] = []

    @property
    def trajectory(self) -> TrueTrajectory:
        """What the arm truly did since the port was first opened."""
        # What is computed ahead has not happened.
        played, joints = self.played, len(self._emulation.device.joints)
        count = played.sent + played.unheard + played.silent
        periods = range(self._first, self._first + count)
        time = np.array([self._emulation.time_us(period) for period in periods]) / 1e6
        at = np.concatenate([np.empty(0), *(at for at, _ in self._blocks)])
        q = np.concatenate([np.empty((0, joints)), *(q for _, q in self._blocks)])
        return TrueTrajectory(time, at[:count], q[:count])

    def run(
        self, seconds: float, stopped: Callable[[], bool] = lambda: False, *, wait: bool = True
    ) -> None:
        """Play until the time is up or somebody asks to stop.

        Args:
            seconds: how long in all, waiting included.
            stopped: whether somebody asks.
            wait: for somebody to open the port before anything moves.
        """
        began = time.perf_counter()
        end = began + seconds
        while wait and not self._terminal.heard():
            if stopped() or time.perf_counter() >= end:
                return
            time.sleep(_LOOK)
        opened = time.perf_counter()
        self._tell("the port was opened" if wait else "started")
        self._first = round((opened - began) * self._emulation.rate)
        heard, ready = self._terminal.heard, self._ready if self._patient else None
        clock = None
        if self._gated:
            clock = RoundClock(self._emulation.motion, heard, ready, lambda: self._tell(_NEXT))
        log = (lambda *block: self._blocks.append(block)) if self._recorded else None
        stream = packets(self._emulation, self._first, clock, log)
        sending = ((due, partial(self._send, data, stopped)) for due, data in stream)
        absences = self._emulation.faults.absences
        vanishing = (
            step for w in absences for step in ((w.start, self._vanish), (w.end, self._return))
        )
        acts: Iterator[tuple[float, Callable[[], None]]]
        acts = merge(sending, vanishing, key=itemgetter(0))
        for due, act in acts:
            if not _sleep_until(opened + due, end, stopped):
                return
            self._late = time.perf_counter() - opened - due
            self.played.late = max(self.played.late, self._late)
            act()

    def _send(self, data: bytes, stopped: Callable[[], bool]) -> None:
        if not data:
            self.played.silent += 1
            return
        self._packet = data
        while not (went := self._terminal.write(data)) and self._patient:
            if stopped() or not self._terminal.heard():
                break
            time.sleep(_LOOK)
        self.played.sent += went
        self.played.unheard += not went
        self._punctual = self._punctual + 1 if went and self._late < _PUNCTUAL else 0

    def _ready(self) -> bool:
        """Whether somebody has the port open and has kept up for a while."""
        now, rate = time.perf_counter(), self._emulation.rate
        heard = self._terminal.heard()
        self._asked_since = self._asked_since or now
        if not heard or self._terminal.unread > _PUNCTUAL * rate * len(self._packet):
            self._punctual = 0
        # Whoever reads punctually for 0.3 s has kept up, or is taken to have done so after 20 s.
        ready = heard and (self._punctual >= 0.3 * rate or now - self._asked_since > 20.0)
        if ready or not heard:
            self._asked_since = 0.0
        return ready

    def _vanish(self) -> None:
        self._terminal.close()
        self._tell("the port disappeared")

    def _return(self) -> None:
        self._terminal.open()
        self._tell(f"the port is back as {self._terminal.name}")


def _sleep_until(due: float, end: float, stopped: Callable[[], bool]) -> bool:
    """Wait; whether the time came before the end and before anybody asked to stop."""
    while not stopped():
        now = time.perf_counter()
        if now >= due and due < end:
            return True
        if now >= end:
            return False
        time.sleep(min(due - now, end - now, 0.05))
    return False


@dataclass(frozen=True, eq=False)
class TrueTrajectory(Displayable):
    """True readings at the time stamps of the frames, sent or not.

    Attributes:
        time: (n,) device clock, s, not wrapped; a reboot does not show in it.
        motion_time: (n,) time of the motion, s.
        q: (n, joints) true readings, without noise, rad (m).
    """

    time: FloatArray
    motion_time: FloatArray
    q: FloatArray

    def __len__(self) -> int:
        return len(self.time)

    def at(self, time: FloatArray) -> FloatArray:
        """(n, joints) true readings at times of the device's clock (n,), s, interpolated."""
        columns = [np.interp(time, self.time, column) for column in self.q.T]
        return np.stack(columns, axis=-1)


class RoundClock:
    """Time of the motion: the stream's, but it waits at the end of each round.

    A round is one placement gone through once. Its last rest lasts until the port is closed after
    at least half of it; then the arm is on the first place of the next round, and goes on when
    the port is opened again. So one emulated arm serves one ``measure`` after the other, however
    long they take to start.

    Args:
        motion: what the arm does; motions without rounds are never held.
        heard: whether anybody has the port open.
        ready: whether that is somebody who has kept up; the first place of each round, that of the
            first one too, is not left before. By default whoever has the port open is ready.
        on_round: told when a round is over.
    """

    def __init__(
        self,
        motion: Motion,
        heard: Callable[[], bool],
        ready: Callable[[], bool] | None = None,
        on_round: Callable[[], None] = lambda: None,
    ) -> None:
        self._heard, self._ready, self._on_round = heard, ready or heard, on_round
        self._origin = 0.0
        self._gates: list[tuple[float, float]] = []
        self._between = False
        self._begun = ready is None or not isinstance(motion, Stops)
        if isinstance(motion, Stops):
            # After the last round the arm rests for good: no gate there.
            self._gates = [
                (motion.arrival(stop) + motion.rest / 2, motion.arrival(stop + 1))
                for stop in motion.rounds[:-1]
            ]
            self._half = motion.rest / 2

    def __call__(self, time: FloatArray) -> FloatArray:
        """(n,) time of the motion at (n,) times of the stream, increasing from call to call."""
        if not self._begun:
            if not self._ready():
                return np.zeros_like(time)
            self._begun, self._origin = True, float(time[0])
        if not self._gates:
            return time - self._origin
        leave, resume = self._gates[0]
        at = np.asarray(time - self._origin, dtype=float)
        if not self._between:
            if at[-1] < leave or self._heard():
                held: FloatArray = np.minimum(at, leave + self._half)
                return held
            self._between = True
            self._on_round()
        if not self._ready():
            # Resting on the first place of the next round.
            return np.full_like(time, resume)
        self._between = False
        self._gates.pop(0)
        self._origin = float(time[0]) - resume
        return time - self._origin
