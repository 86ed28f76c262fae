"""Old readings are left out: what a cache still held is not where the arm is now."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Final

from suta_calib.device.reading import Reading, Statistics

# The device's clock runs with this computer's if, over the window, the two agree this closely:
# drivers hand bytes over up to 16 ms late, and a busy computer reads them late.
_LATENESS_S: Final = 0.02
_TOLERANCE: Final = 0.1
# What a cache held comes too fast, never too slowly: a clock may be this much slower, if it is one.
_SLOWER: Final = 0.7
# No cache holds so much that it would come this much too fast for so long: a bad clock then.
_LONG_S: Final = 2.0
_FASTER: Final = 1.0
_FEWEST: Final = 3
# A clock that leaps this far from one frame to the next is another clock, or a cache's end.
_LEAP_S: Final = 1.0


class Freshness:
    """Lets readings through once the device's clock runs with this computer's.

    Bytes from a cache come faster than they were measured, or carry a clock that stands far from
    that of the next frame; live ones come as time goes by, or more slowly by a clock that is slow.
    A clock that is fast is believed after two seconds of it.

    Args:
        window: how long the clocks must agree, s; 0 lets everything through.
        statistics: what is left out is taken out of them and counted as stale.
        on_leap: called with the leap in s when the clock jumps after readings were let through.
    """

    def __init__(
        self, window: float, statistics: Statistics, on_leap: Callable[[float], None]
    ) -> None:
        self._window, self._statistics, self._on_leap = window, statistics, on_leap
        self._points: deque[tuple[float, float]] = deque()
        self._since: float | None = None
        # Of the clock to this computer's, at its most punctual, s.
        self._ahead = -math.inf
        self.last: Reading | None = None
        self.settled = window <= 0
        self._newest: Reading | None = None
        self._dropped = 0
        self._before = statistics.copy()

    def restart(self) -> None:
        """Begin anew: what comes next may be old."""
        if self._window <= 0:
            return
        if self.settled:
            self._before, self._dropped = self._statistics.copy(), 0
        self.settled = False
        self._newest = self._since = None
        self._ahead = -math.inf
        self._points.clear()

    def take(self, readings: list[Reading]) -> tuple[list[Reading], bool]:
        """The readings that are fresh, and whether the clock leapt: then decode anew.

        Args:
            readings: in the order they came; those behind a leap are left out.
        """
        if self._window <= 0:
            self.last = readings[-1] if readings else self.last
            return readings, False
        fresh: list[Reading] = []
        waited = not self.settled
        for index, reading in enumerate(readings):
            leap = self._leap(reading)
            if leap:
                self._leapt(leap, readings[index:])
                break
            self._newest = reading
            if self.settled or self._settles(reading):
                fresh.append(reading)
        if waited and fresh:
            self._statistics.frames += len(fresh)
        self.last = fresh[-1] if fresh else self.last
        return fresh, self._newest is None and bool(readings)

    def _leap(self, reading: Reading) -> float:
        """How far the clock leapt from the reading before; 0 where it went on."""
        before, ahead = self._newest, reading.time - reading.arrival
        if before is None or reading.sequence == before.sequence + 1:
            self._ahead = max(self._ahead, ahead)
            return 0.0
        if self.settled:
            # What was read late seems to be old, and the next then to leap: no clock is ahead of
            # where it was at its most punctual.
            leap = ahead - self._ahead
            self._ahead = max(self._ahead, ahead)
            return leap if leap > _LEAP_S else 0.0
        leap = ahead - (before.time - before.arrival)
        return leap if abs(leap) > _LEAP_S else 0.0

    def _leapt(self, leap: float, left_out: list[Reading]) -> None:
        """Readings from the leap on were decoded with a clock that does not go on; so was a gap."""
        before, counts = self._newest, self._statistics
        if self.settled and before is not None:
            lost = max(left_out[0].sequence - before.sequence - 1, 0)
            counts.lost_frames -= lost
            counts.gaps -= lost > 0
            counts.frames -= len(left_out)
            self._on_leap(leap)
        self.restart()
        self._dropped += len(left_out)

    def _settles(self, reading: Reading) -> bool:
        points = self._points
        points.append((reading.time, reading.arrival))
        while len(points) > _FEWEST and reading.arrival - points[1][1] >= self._window:
            points.popleft()
        host = reading.arrival - points[0][1]
        device = reading.time - points[0][0]
        self._since = reading.arrival if self._since is None else self._since
        faster = _TOLERANCE if reading.arrival - self._since < _LONG_S else _FASTER
        ahead = device - host
        agree = -_LATENESS_S - _SLOWER * host <= ahead <= _LATENESS_S + faster * host
        if len(points) < _FEWEST or host < self._window or not agree:
            self._dropped += 1
            return False
        self._settle()
        return True

    def _settle(self) -> None:
        """Nothing that happened to old readings is the user's concern."""
        interruptions = self._statistics.interruptions
        self._statistics.restore(self._before)
        self._statistics.interruptions = interruptions
        self._statistics.stale_readings += self._dropped
        self.settled = True
        self._points.clear()
