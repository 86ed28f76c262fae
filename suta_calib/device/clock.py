"""The device's clock: unwrapped, and whether it runs with this computer's.

A device counts with few bits; what a cache still held is not where the arm is now.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from suta_calib.device.reading import Reading, Statistics


class DeviceClock:
    """Unwraps the frames' u16 sequence number and u32 time in µs.

    Both wrap: at 768 Hz after 85 s and after 72 minutes. A pause may hide whole turns of a
    counter: those of the clock are found from the time of arrival, those of the sequence number
    from the clock and the rate so far.
    """

    def __init__(self) -> None:
        self._anchor: tuple[int, float, float] | None = None
        self._reset()

    def _reset(self) -> None:
        self._started = False
        self._raw_sequence = self._raw_time = 0
        self._sequence = self._microseconds = 0
        self._arrival = 0.0
        self._frames = self._steps = self._span = 0
        self._shift = 0.0  # s, from the clock as sent to the time given out

    def unwrap(self, sequence: int, time_us: int, arrival: float) -> tuple[int, float, int]:
        """Unwrapped number and time, s, of the next frame, and how many are missing before it."""
        lost = 0
        if self._started:
            lost = self._advance(sequence, time_us, arrival)
        else:
            self._started = True
            self._sequence, self._microseconds = sequence, time_us
            if self._anchor is not None:
                last_sequence, last_time, last_arrival = self._anchor
                self._sequence = last_sequence + 1
                now = last_time + max(arrival - last_arrival, 0.0)
                self._shift = now - time_us * 1e-6
        self._raw_sequence, self._raw_time, self._arrival = sequence, time_us, arrival
        return self._sequence, self._microseconds * 1e-6 + self._shift, lost

    def resume(self, sequence: int, time: float, arrival: float) -> None:
        """Go on from a reading of before, by arrival, whatever the next frame's counters say."""
        self._reset()
        self._anchor = (sequence, time, arrival)

    def _advance(self, sequence: int, time_us: int, arrival: float) -> int:
        sequences = 1 << 16
        clock = 1 << 32
        # A pause has to be this long before its wraps are counted: no device sends 65,536 frames in
        # it.
        long_pause_s = 1.0
        enough_frames = 100
        elapsed = (time_us - self._raw_time) % clock
        # Never fewer than none: what comes in one piece has one time of arrival.
        elapsed += clock * max(0, round(((arrival - self._arrival) / 1e-6 - elapsed) / clock))
        step = (sequence - self._raw_sequence) % sequences
        if elapsed * 1e-6 > long_pause_s and self._frames >= enough_frames:
            expected = elapsed * self._steps / max(self._span, 1)
            step += sequences * max(0, round((expected - step) / sequences))
        self._sequence += step
        self._microseconds += elapsed
        self._frames += 1
        self._steps += step
        self._span += elapsed
        return max(step - 1, 0)


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
        """The readings that are fresh, none behind a leap, and whether it leapt: decode anew."""
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
        # A clock that leaps this far from one frame to the next is another clock, or a cache's end.
        leap_s = 1.0
        before, ahead = self._newest, reading.time - reading.arrival
        if before is None or reading.sequence == before.sequence + 1:
            self._ahead = max(self._ahead, ahead)
            return 0.0
        if self.settled:
            # What was read late seems to be old, and the next then to leap: no clock is ahead of
            # where it was at its most punctual.
            leap = ahead - self._ahead
            self._ahead = max(self._ahead, ahead)
            return leap if leap > leap_s else 0.0
        leap = ahead - (before.time - before.arrival)
        return leap if abs(leap) > leap_s else 0.0

    def _leapt(self, leap: float, left_out: list[Reading]) -> None:
        """Readings from the leap on were decoded with a clock that does not go on; so was a gap."""
        before, counts = self._newest, self._statistics
        if self.settled and before is not None:
            lost = max(left_out[0].sequence - before.sequence - 1, 0)
            # Frames of the gap that came damaged were not counted as lost.
            counts.lost_frames = max(counts.lost_frames - lost, 0)
            counts.gaps = max(counts.gaps - (lost > 0), 0)
            counts.frames -= len(left_out)
            self._on_leap(leap)
        self.restart()
        self._dropped += len(left_out)

    def _settles(self, reading: Reading) -> bool:
        # The device's clock runs with this computer's if, over the window, the two agree this
        # closely: drivers hand bytes over up to 16 ms late, and a busy computer reads them late.
        lateness_s = 0.02
        fewest = 3
        points = self._points
        points.append((reading.time, reading.arrival))
        while len(points) > fewest and reading.arrival - points[1][1] >= self._window:
            points.popleft()
        host = reading.arrival - points[0][1]
        device = reading.time - points[0][0]
        self._since = reading.arrival if self._since is None else self._since
        # No cache holds so much that it would come twice too fast for 2 s: a bad clock then.
        faster = 0.1 if reading.arrival - self._since < 2.0 else 1.0
        ahead = device - host
        # What a cache held comes too fast, never too slowly: a clock may be this much slower, if it
        # is one.
        agree = -lateness_s - 0.7 * host <= ahead <= lateness_s + faster * host
        if len(points) < fewest or host < self._window or not agree:
            self._dropped += 1
            return False
        # Nothing that happened to old readings is the user's concern.
        interruptions = self._statistics.interruptions
        self._statistics.restore(self._before)
        self._statistics.interruptions = interruptions
        self._statistics.stale_readings += self._dropped
        self.settled = True
        points.clear()
        return True
