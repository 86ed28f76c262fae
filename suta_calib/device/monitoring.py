"""What a stream of readings looks like at the moment: for somebody who watches it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from suta_calib.arrays import BoolArray
from suta_calib.device.description import DeviceSpec
from suta_calib.device.formats import format_of
from suta_calib.device.reading import Reading

if TYPE_CHECKING:
    from suta_calib.arrays import FloatArray

# Before that, late reading by this computer is larger than any clock's error.
_CLOCK_AFTER_S: Final = 5.0


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The last second of a stream.

    Attributes:
        names: the joints.
        angles: (n,) of the last reading, rad; NaN before the first.
        noise: (n,) standard deviation over the window of the readings without error flag, rad;
            NaN where there are fewer than two.
        error: (n,) the error flag was raised in the window.
        warning: (n,) the same for the warning flag.
        rate: readings per second of this computer's time over the window; 0 where none came.
        clock_ppm: how much faster the device's clock runs than this computer's; None too early.
    """

    names: tuple[str, ...]
    angles: FloatArray
    noise: FloatArray
    error: BoolArray
    warning: BoolArray
    rate: float
    clock_ppm: float | None


class Monitor:
    """Keeps the readings of the last ``window`` s.

    Args:
        spec: the device.
        window: s.
    """

    def __init__(self, spec: DeviceSpec, window: float = 1.0) -> None:
        self._names, self._window = spec.names, window
        self._has_clock = format_of(spec).has_clock
        self._recent: deque[Reading] = deque()
        self._first: Reading | None = None
        self._last: Reading | None = None

    @property
    def last(self) -> Reading | None:
        """The newest reading, however old."""
        return self._last

    def add(self, readings: Iterable[Reading]) -> None:
        """Take the next readings, oldest first."""
        for reading in readings:
            self._first = self._first or reading
            self._last = reading
            self._recent.append(reading)

    def snapshot(self, now: float) -> Snapshot:
        """The window that ends ``now`` (`time.perf_counter`, s)."""
        recent = self._recent
        while recent and now - recent[0].arrival > self._window:
            recent.popleft()
        count = len(self._names)
        none = np.zeros(count, dtype=np.bool_)
        error = np.array([r.error for r in recent]) if recent else none[None]
        warning = np.array([r.warning for r in recent]) if recent else none[None]
        angles = np.array([r.angles for r in recent]).reshape(-1, count)
        return Snapshot(
            names=self._names,
            angles=np.full(count, np.nan) if self._last is None else self._last.angles,
            noise=_deviation(angles, error[: len(angles)]),
            error=np.asarray(error.any(axis=0)),
            warning=np.asarray(warning.any(axis=0)),
            rate=self._rate(now),
            clock_ppm=self._clock_ppm(),
        )

    def _rate(self, now: float) -> float:
        if not self._recent or self._first is None:
            return 0.0
        # Shortly after the start the window is not full yet.
        span = min(now - self._first.arrival, self._window)
        return len(self._recent) / span if span > 0 else 0.0

    def _clock_ppm(self) -> float | None:
        if not self._has_clock or self._first is None or self._last is None:
            return None
        host = self._last.arrival - self._first.arrival
        if host < _CLOCK_AFTER_S:
            return None
        return 1e6 * ((self._last.time - self._first.time) / host - 1.0)


def _deviation(angles: FloatArray, error: BoolArray) -> FloatArray:
    """Standard deviation on the circle, column by column, of the angles without error, rad."""
    if len(angles) < 2:
        return np.full(angles.shape[1], np.nan)
    valid = ~error
    # About a valid angle, the differences do not wrap.
    about = angles[valid.argmax(axis=0), np.arange(angles.shape[1])]
    difference = np.where(valid, np.remainder(angles - about + math.pi, math.tau) - math.pi, 0.0)
    count = valid.sum(axis=0)
    mean = difference.sum(axis=0) / np.maximum(count, 1)
    squares = np.where(valid, (difference - mean) ** 2, 0.0).sum(axis=0)
    return np.where(count > 1, np.sqrt(squares / np.maximum(count - 1, 1)), np.nan)
