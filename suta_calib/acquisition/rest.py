"""Whether an arm rests: what its readings do together against the noise of its encoders.

Noise is what neighbouring readings do to each other: the middle one of three against the line
through the outer two tells it, also while the arm moves. Motion is a mean that changes: the arm
rests while the two halves of a short window agree but for noise, and the window scatters no more
than a hand trembles (4 to 12 Hz) that holds an arm which is seated. A mean over two seconds has
nothing of that tremor left.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.acquisition.averaging import spread, steps, unwrapped_about_median
from suta_calib.arrays import FloatArray
from suta_calib.device.reading import Reading
from suta_calib.geometry.numbers import wrap
from suta_calib.units import from_deg

# A pause between readings that is worth telling, s.
STALL: Final = 0.5


@dataclass(frozen=True)
class RestSettings:
    """What counts as rest.

    Attributes:
        window: length of the sliding window, s.
        least: readings it must hold, however slow the stream.
        drift: change of the mean, from one half of the window to the other, that a seated arm may
            show whatever its noise, rad.
        tremble: scatter (standard deviation) that it may show whatever its noise, rad.
        noises: scatter in units of the noise that is still rest.
        hysteresis: how many times as much ends a rest as begins one.
        gap: pause in the stream after which nothing is known of the arm, s.
        hop: how often the window is looked at, s.
        motion: how far a joint must have turned for it to be a motion and no bump, rad.
        onset: what happened so long before the arm is seen to move is already motion, s.
        tremor: one as slow as 4 Hz does not average out of less than half its period, s.
    """

    window: float = 0.25
    least: int = 8
    drift: float = from_deg(0.02)
    tremble: float = from_deg(0.1)
    noises: float = 3.0
    hysteresis: float = 2.0
    gap: float = 0.5
    hop: float = 0.025
    motion: float = from_deg(0.25)
    onset: float = 0.15
    tremor: float = 0.1


@dataclass(frozen=True, eq=False)
class Look:
    """One look at the window.

    Attributes:
        readings: those that came since the last look.
        angles: (n,) where the arm is now, rad: medians of the latest few readings.
        resting: whether it rests; None where too little is known yet.
        moving: indices of the joints that keep it from resting.
        gap: s without readings before this look, zero where there was no pause.
    """

    readings: tuple[Reading, ...]
    angles: FloatArray
    resting: bool | None
    moving: tuple[int, ...] = ()
    gap: float = 0.0


DEFAULT_REST = RestSettings()


class RestDetector:
    """Looks at a stream of readings again and again, with hysteresis.

    Args:
        settings: what counts as rest.
        even: the times of readings are those of their arrival and mean little; take them as
            evenly spaced.

    Attributes:
        noise: (n,) noise of each encoder so far, rad; NaN before anything is known.
    """

    def __init__(self, settings: RestSettings = DEFAULT_REST, *, even: bool = False) -> None:
        self._settings, self._even = settings, even
        self._window: deque[Reading] = deque()
        self._fresh: list[Reading] = []
        # Noise in the latest looks.
        self._noises: deque[FloatArray] = deque(maxlen=400)
        self._resting: bool | None = None
        self._gap = 0.0
        self._interrupted = False
        self.noise: FloatArray = np.array([np.nan])

    def feed(self, readings: Iterable[Reading]) -> list[Look]:
        """Looks that new readings give occasion to."""
        looks = []
        for reading in readings:
            if self._window:
                step = reading.time - self._window[-1].time
                # A clock that runs backwards is another one: the device was started again.
                if self._interrupted or not 0 <= step <= self._settings.gap:
                    looks += [self._look()] if self._fresh else []
                    self._gap = max(abs(step), self._settings.gap)
                    self._window.clear()
                    self._resting = None
                self._interrupted = False
            self._window.append(reading)
            self._fresh.append(reading)
            hop = reading.time - self._fresh[0].time
            # So many readings are looked at whatever their clock says.
            if hop >= self._settings.hop or len(self._fresh) > 400:
                looks.append(self._look())
        return looks

    def interrupt(self) -> None:
        """What comes next does not follow what came before, whatever its time says."""
        self._interrupted = True

    def _look(self) -> Look:
        fresh, self._fresh = tuple(self._fresh), []
        settings, window = self._settings, self._window
        while len(window) > settings.least and window[-1].time - window[1].time >= settings.window:
            window.popleft()
        angles = np.array([reading.angles for reading in window])
        now = unwrapped_about_median(angles[-max(3, len(fresh)) :])[0]
        gap, self._gap = self._gap, 0.0
        # Lines that came in one piece bear one time: count them rather than wait for the clock.
        span = window[-1].time - window[0].time
        if len(window) < settings.least or span < 0.8 * settings.window:
            return Look(fresh, now, None, gap=gap)
        moving = self._moving(angles)
        self._resting = not moving.any()
        return Look(fresh, now, self._resting, tuple(np.flatnonzero(moving).tolist()), gap)

    def _moving(self, angles: FloatArray) -> FloatArray:
        """(n,) whether each joint scatters or drifts more than noise and tremor explain."""
        _, deviation = unwrapped_about_median(angles)
        times = None if self._even else np.array([reading.time for reading in self._window])
        self._noises.append(noise_level(angles, times))
        # Motion can only add to it, and a lost frame can: the lowest is the noise.
        self.noise = np.min(np.array(self._noises), axis=0)
        s, scatter = self._settings, spread(deviation)
        least, factor = 1.5 * steps(deviation), s.hysteresis if self._resting else 1.0
        tremble = np.maximum(s.tremble, np.maximum(s.noises * self.noise, least))
        # Two means of half the window each differ by this much, one time in 100 000.
        chance = 4.5 * 2 * self.noise / np.sqrt(len(deviation))
        drift = np.maximum(s.drift, np.maximum(chance, least))
        # A single gross error must not move a mean.
        most = np.maximum(6.0 * scatter, 2 * drift)
        clipped, half = np.clip(deviation, -most, most), len(deviation) // 2
        change = clipped[-half:].mean(axis=0) - clipped[:half].mean(axis=0)
        return np.asarray((scatter > factor * tremble) | (np.abs(change) > factor * drift))


def noise_level(angles: FloatArray, times: FloatArray | None = None) -> FloatArray:
    """Noise (n,) of one reading, rad, free of its trend: the middle of three against the outer two.

    Angles are (k, n) rad, at times (k,) s that increase, or evenly spaced ones; k at least 3.
    """
    share = np.full(len(angles) - 2, 0.5)
    if times is not None:
        span = times[2:] - times[:-2]
        share = np.where(span > 0, (times[1:-1] - times[:-2]) / np.where(span > 0, span, 1.0), 0.5)
    before, after = wrap(angles[:-2] - angles[1:-1]), wrap(angles[2:] - angles[1:-1])
    off = (1 - share)[:, None] * before + share[:, None] * after
    factor = np.sqrt(1 + share**2 + (1 - share) ** 2)[:, None]
    return spread(off / factor)
