"""One run of the tracker: readings in, poses out, and how long each took."""

from __future__ import annotations

import gc
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.device.bus import Bus
from suta_calib.device.reading import Reading
from suta_calib.tracking.publisher import Publisher
from suta_calib.tracking.tracker import TrackedPose, Tracker
from suta_calib.units import ms


class LatencyStatistics:
    """How long something takes, over any number of times, in constant memory.

    Percentiles are right within 1 %; mean, standard deviation and maximum are exact.
    """

    # The first edge of the bins, s, and the ratio of their edges; so many reach to 100 s. Shorter
    # and longer times share the outermost.
    _FIRST, _RATIO, _BINS = 1e-6, 1.02, 932

    def __init__(self) -> None:
        self.count = 0
        self.maximum = 0.0
        self._sum = self._sum_of_squares = 0.0
        # A list: counting in one costs a quarter of what it costs in an array.
        self._bins = [0] * self._BINS

    def add(self, seconds: float) -> None:
        """Count one."""
        self.count += 1
        self._sum += seconds
        self._sum_of_squares += seconds * seconds
        if seconds > self.maximum:
            self.maximum = seconds
        index = int(math.log(max(seconds / self._FIRST, 1.0), self._RATIO))
        self._bins[min(index, self._BINS - 1)] += 1

    @property
    def mean(self) -> float:
        """Mean, s; NaN before the first."""
        return self._sum / self.count if self.count else math.nan

    @property
    def jitter(self) -> float:
        """Standard deviation, s; NaN before the first."""
        if not self.count:
            return math.nan
        return math.sqrt(max(self._sum_of_squares / self.count - self.mean**2, 0.0))

    def percentile(self, percent: float) -> float:
        """The time that ``percent`` % do not exceed, s; NaN before the first."""
        if not self.count:
            return math.nan
        cumulative = np.cumsum(self._bins)
        index = int(np.searchsorted(cumulative, percent / 100.0 * self.count))
        middle = self._FIRST * self._RATIO ** (index + 0.5)
        return float(min(middle, self.maximum))

    def histogram(self) -> tuple[FloatArray, FloatArray]:
        """Edges (bins + 1,) s and counts (bins,), from the first to the last that is not empty."""
        counts = np.array(self._bins, dtype=float)
        filled = np.flatnonzero(counts) if self.count else np.zeros(1, dtype=np.intp)
        first, last = int(filled[0]), int(filled[-1]) + 1
        edges = np.asarray(self._FIRST * self._RATIO ** np.arange(first, last + 1), dtype=float)
        return edges, counts[first:last]

    def summary(self) -> dict[str, float | int]:
        """Count, and ``mean_ms``, ``jitter_ms`` and percentiles for JSON."""
        figures: dict[str, float | int] = {"count": self.count}
        figures |= {f"p{p:g}_ms": ms(self.percentile(p)) for p in (50, 95, 99)}
        figures |= {"max_ms": ms(self.maximum) if self.count else math.nan}
        return figures | {"mean_ms": ms(self.mean), "jitter_ms": ms(self.jitter)}


class TrackingSession:
    """Takes readings from a source, and hands poses to publishers.

    The latency of a pose is the time from the arrival of its frame's last byte to the moment the
    last publisher has handed it over: to the network's stack for network publishers, to the
    writing thread for files.

    Args:
        tracker: makes poses.
        publishers: in the order in which they get each pose.
        rate: most poses a second of the device's clock; every reading by default.

    Attributes:
        latency: of every pose published.
        interval: between the arrivals of successive poses' frames: the jitter of the device and of
            the operating system.
        readings, valid, invalid: how many readings, and poses of either kind.
        last: the latest pose.
        last_valid: the latest valid one.
        began, ended: of the run, `time.perf_counter`; running: whether it lasts.
    """

    def __init__(
        self, tracker: Tracker, publishers: Sequence[Publisher], rate: float | None = None
    ) -> None:
        self.tracker, self.publishers = tracker, tuple(publishers)
        self._period = 0.0 if rate is None else 1.0 / rate
        self._due = -float("inf")
        self.latency, self.interval = LatencyStatistics(), LatencyStatistics()
        self.readings = self.valid = self.invalid = 0
        self.last: TrackedPose | None = None
        self.last_valid: TrackedPose | None = None
        self.began = self.ended = time.perf_counter()
        self.running = False

    def run(
        self, source: Bus, seconds: float | None = None, stop: Callable[[], bool] = lambda: False
    ) -> None:
        """Track until the time is over, or ``stop`` says so, or an error or Ctrl-C ends it.

        Args:
            source: of the readings.
            seconds: from the arrival of the first reading on, s: what has arrived by then is
                tracked, however late a busy computer comes to it.
            stop: whether somebody asks to stop.
        """
        self.began, self.running = time.perf_counter(), True
        lasts = math.inf if seconds is None else seconds
        # A device that has not been heard for 10 s, and does not come back, is not waited for.
        end, first = self.began + 10.0 + lasts, True
        try:
            while not stop():
                left = end - time.perf_counter()
                # One look at the bus is short: the run's end is not noticed before.
                readings = source.read(min(0.05, max(left, 0.0)))
                if readings and first:
                    end, first = readings[0].arrival + lasts, False
                elif not readings and left <= 0:
                    break
                self.take(*(reading for reading in readings if reading.arrival <= end))
                if readings and readings[-1].arrival > end:
                    break
        finally:
            self.ended, self.running = time.perf_counter(), False

    def take(self, *readings: Reading) -> None:
        """Publish the poses of readings that came together, as many as the rate allows."""
        self.readings += len(readings)
        poses = [self.tracker.pose(reading) for reading in readings if self._is_due(reading.time)]
        for pose in poses:
            for publisher in self.publishers:
                publisher.publish(pose)
        for publisher in self.publishers:
            publisher.flush()
        now = time.perf_counter()
        for pose in poses:
            self._count(pose, now)

    def _count(self, pose: TrackedPose, published: float) -> None:
        self.latency.add(published - pose.arrival)
        if self.last is not None:
            self.interval.add(max(pose.arrival - self.last.arrival, 0.0))
        self.last = pose
        if pose.valid:
            self.valid += 1
            self.last_valid = pose
        else:
            self.invalid += 1

    def summary(self) -> dict[str, Any]:
        """Counts, latency and publishers for JSON."""
        lasted = self.ended - self.began
        return {
            "seconds": lasted,
            "readings": self.readings,
            "poses": {"valid": self.valid, "invalid": self.invalid},
            "rate_hz": self.latency.count / lasted if lasted > 0 else 0.0,
            "latency": self.latency.summary(),
            "interval": self.interval.summary(),
            "publishers": {p.name: p.statistics() for p in self.publishers},
        }

    def _is_due(self, now: float) -> bool:
        """Keeps to multiples of the period, so that a late frame does not shift all others."""
        if not self._period:
            return True
        late = now - self._due
        # Far before it is due, the device has begun to count anew.
        # Of a period, that a frame may come early: clocks count in whole microseconds.
        if -10 * self._period < late < -0.05 * self._period:
            return False
        self._due = self._due + self._period if abs(late) < self._period else now + self._period
        return True


@contextmanager
def low_latency() -> Iterator[None]:
    """Make Python answer quickly: threads give way soon, and old objects are not looked through.

    Enter it before the port is opened: sorting out the old objects takes a tenth of a second.
    """
    before = sys.getswitchinterval()
    # s; Python's own 5 ms would let a thread that writes a file hold up a pose for as long.
    sys.setswitchinterval(2e-5)
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)


class Pace:
    """Counts a second, of a number that only grows, over the last second or two."""

    def __init__(
        self, count: Callable[[], int], clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self._count, self._clock = count, clock
        self._looks: deque[tuple[float, int]] = deque([(clock(), count())])

    def __call__(self) -> float:
        """Growth per second since the oldest look within the window."""
        now = self._clock()
        self._looks.append((now, self._count()))
        while len(self._looks) > 2 and now - self._looks[0][0] > 1.5:
            self._looks.popleft()
        (then, before), (now, after) = self._looks[0], self._looks[-1]
        return (after - before) / max(now - then, 1e-9)
