"""An emulated arm in real time on a pseudo-terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from heapq import merge
from typing import Final

from suta_calib.emulation.recorder import Recorder, TrueTrajectory
from suta_calib.emulation.rounds import RoundClock
from suta_calib.emulation.stream import Emulation, MotionTime, forget, packets, unchanged
from suta_calib.emulation.terminal import PseudoTerminal

# How often somebody who opens the port, or asks to stop, is looked for, s.
_LOOK: Final = 2e-3
_LONGEST_SLEEP: Final = 0.05


@dataclass
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

    @property
    def periods(self) -> int:
        """Packets in all."""
        return self.sent + self.unheard + self.silent


class Player:
    """Streams an emulation at its rate.

    Every packet has its time on the clock, so that delays do not add up: what is late is sent at
    once. The motion, and the times of all faults, begin when the port is first opened; the
    device's clock runs from the start.

    Args:
        emulation: the arm.
        terminal: the port.
        on_event: told in words when the port is opened, vanishes or comes back.
        gated: whether the arm waits between rounds; see `RoundClock`.
        recorded: whether the true trajectory is kept, for as long as it plays.
    """

    def __init__(
        self,
        emulation: Emulation,
        terminal: PseudoTerminal,
        on_event: Callable[[str], None] = lambda _: None,
        *,
        gated: bool = True,
        recorded: bool = False,
    ) -> None:
        self.played = Played()
        self._emulation, self._terminal, self._tell = emulation, terminal, on_event
        self._gated, self._recorded = gated, recorded
        self._recorder = Recorder(emulation)

    @property
    def trajectory(self) -> TrueTrajectory:
        """What the arm truly did since the port was first opened."""
        return self._recorder.trajectory(self.played.periods)

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
        first = round((opened - began) * self._emulation.rate)
        self._recorder = Recorder(self._emulation, first)
        for due, act in merge(self._sending(first), self._vanishing(), key=lambda each: each[0]):
            if not _sleep_until(opened + due, end, stopped):
                return
            self.played.late = max(self.played.late, time.perf_counter() - opened - due)
            act()

    def _sending(self, first: int) -> Iterator[tuple[float, Callable[[], None]]]:
        emulation = self._emulation
        clock: MotionTime = RoundClock(emulation.motion, self._terminal.heard)
        if not self._gated:
            clock = unchanged
        log = self._recorder if self._recorded else forget
        for due, data in packets(emulation, first, clock, log):
            yield due, partial(self._send, data)

    def _send(self, data: bytes) -> None:
        if not data:
            self.played.silent += 1
        elif self._terminal.write(data):
            self.played.sent += 1
        else:
            self.played.unheard += 1

    def _vanishing(self) -> Iterator[tuple[float, Callable[[], None]]]:
        for window in self._emulation.faults.absences:
            yield window.start, self._vanish
            yield window.end, self._return

    def _vanish(self) -> None:
        self._terminal.close()
        self._tell("the port is gone")

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
        time.sleep(min(min(due, end) - now, _LONGEST_SLEEP))
    return False
