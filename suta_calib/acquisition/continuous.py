"""Sampling while the arm moves: pivoting on a point, or anywhere an instrument looks."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

import numpy as np

from suta_calib.acquisition.averaging import unwrapped_about_median, wrap
from suta_calib.acquisition.run import SamplesFile, Say
from suta_calib.acquisition.session import STALL
from suta_calib.acquisition.stops import Event
from suta_calib.acquisition.touch_sequence import TouchSequence
from suta_calib.arrays import FloatArray
from suta_calib.units import from_deg

if TYPE_CHECKING:
    from suta_calib.device.reading import Reading

# So many readings in a row give one sample: a single wrong one among them does no harm.
_MEDIAN_OF: Final = 5
# Spread over more time than this they are different postures, s.
_SIMULTANEOUS: Final = 0.02
# Samples in one posture tell nothing new, rad.
_NEW_POSTURE: Final = from_deg(0.5)


class Continuous:
    """Takes a sample every so often while the arm moves.

    Args:
        plan: whose stations' labels all samples carry.
        file: where samples go; several at a time, so that the disk is not asked too often.
        say: shows the user a line.
        seconds: for how long.
        every: time between two samples, s.
    """

    def __init__(
        self, plan: TouchSequence, file: SamplesFile, say: Say, seconds: float, every: float
    ) -> None:
        self._plan, self._file, self._say = plan, file, say
        self._seconds, self._every = seconds, every
        self._latest: deque[Reading] = deque(maxlen=_MEDIAN_OF)
        self._waiting: list[FloatArray] = []
        self._last: FloatArray | None = None
        self._elapsed = self._due = self._flush_at = 0.0
        self._flagged: set[str] = set()
        self.count = 0

    @property
    def done(self) -> bool:
        """Whether the time is up."""
        return self._elapsed >= self._seconds

    def handle(self, event: Event) -> None:
        """Rests mean nothing here."""

    def finish(self) -> None:
        """Write what is not written yet."""
        if not self._waiting:
            return
        rows = [(self._plan.stations[0].labels, angles) for angles in self._waiting]
        self._file.put_all(rows)
        self.count += len(rows)
        self._waiting = []
        self._say(f"{self.count} samples, {max(0.0, self._seconds - self._elapsed):.0f} s to go")

    def feed(self, readings: Iterable[Reading]) -> list[Event]:
        """Take the arm's readings as they come; there are no stops to tell of."""
        for reading in readings:
            if reading.error.any():
                self._flag(reading)
                continue
            if self._latest:
                step = reading.time - self._latest[-1].time
                self._elapsed += step if 0 <= step < STALL else 0.0
            self._latest.append(reading)
            if self._elapsed >= self._due and len(self._latest) == _MEDIAN_OF:
                self._sample()
        if self._elapsed >= self._flush_at or self.done:
            self._flush_at = self._elapsed + 1.0
            self.finish()
        return []

    def _flag(self, reading: Reading) -> None:
        self._latest.clear()
        for index in np.flatnonzero(reading.error):
            joint = self._plan.arm.joints[index]
            if joint not in self._flagged:
                self._flagged.add(joint)
                self._say(f"rejected: error flag of {joint}; readings with it are left out")

    def _sample(self) -> None:
        self._due = self._elapsed + self._every
        latest = list(self._latest)
        if latest[-1].time - latest[0].time > _SIMULTANEOUS:
            latest = [latest[len(latest) // 2]]
        angles = unwrapped_about_median(np.array([r.angles for r in latest]))[0]
        if self._last is None or np.max(np.abs(wrap(angles - self._last))) > _NEW_POSTURE:
            self._waiting.append(angles)
            self._last = angles
