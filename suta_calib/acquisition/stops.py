"""Stops: the times an arm rests, each recorded for as long as a sample needs.

A window in which the arm moved, crept or an encoder raised its error flag is no sample, nor is one
in which a sensor beside the encoders was shaken. A stop that the stream leaves out for a moment (a
stall, a cable pulled out) goes on where it was if the arm is found where it was.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from suta_calib.acquisition.averaging import (
    Average,
    average,
    mean_number,
    spread,
    unwrapped_about_median,
)
from suta_calib.acquisition.extra_columns import ExtraColumns
from suta_calib.acquisition.rest import DEFAULT_REST, Look, RestDetector, RestSettings
from suta_calib.arrays import FloatArray
from suta_calib.device.reading import Reading
from suta_calib.geometry.numbers import wrap


@dataclass(frozen=True)
class Began:
    """The arm has come to rest."""


@dataclass(frozen=True, eq=False)
class Complete:
    """It has rested for as long as was asked for."""

    average: Average


@dataclass(frozen=True, eq=False)
class Ended:
    """It moved on before that.

    Attributes:
        average: of the time it did rest.
        joints: names of those that moved; empty where the stream left out the motion.
        interrupted: whether the stream left out part of the rest, or began during it: it was longer
            than it seems.
        refusal: why what the device sent beside the joints cannot be used; empty where it can.
    """

    average: Average
    joints: tuple[str, ...] = ()
    interrupted: bool = False
    refusal: str = ""

    @property
    def what(self) -> str:
        """Which joints moved, in words."""
        return ", ".join(self.joints) or "the motion itself was not received"

    def __str__(self) -> str:
        return f"rejected: moved after {self.average.seconds:.1f} s ({self.what})"


@dataclass(frozen=True)
class Rejected:
    """What was recorded so far is no sample; recording begins again while the arm rests."""

    reason: str
    joints: tuple[str, ...] = ()

    def __str__(self) -> str:
        joints = f" of {', '.join(self.joints)}" if self.joints else ""
        return f"rejected: {self.reason}{joints}"


@dataclass(frozen=True)
class Interrupted:
    """Nothing came for so long, by the device's clock; what the arm did is not known."""

    seconds: float

    def __str__(self) -> str:
        return f"no data for {self.seconds:.1f} s"


Event = Began | Complete | Ended | Rejected | Interrupted


class StopFinder:
    """Finds stops in a stream of readings.

    Args:
        joints: names of the device's joints, in the order of the readings' angles.
        seconds: how long a stop is recorded.
        settings, even: see `RestDetector`.
        extra: looks at what the device sends beside the joints; None where that is not read.

    Attributes:
        excursion: how far any joint has been from `reference` since that was set, rad.
        restless: names of the joints that last kept the arm from resting.
    """

    def __init__(
        self,
        joints: Sequence[str],
        seconds: float,
        settings: RestSettings = DEFAULT_REST,
        *,
        even: bool = False,
        extra: ExtraColumns | None = None,
    ) -> None:
        self._extra = extra
        self._joints, self._seconds, self.settings = tuple(joints), seconds, settings
        self._detector = RestDetector(settings, even=even)
        self._window: StopWindow | None = None
        self._flagged: set[int] = set()
        self._reference: FloatArray | None = None
        # Where the arm was at the latest looks, and when, s: what it did before it rested.
        self._way: deque[tuple[float, FloatArray]] = deque()
        self.excursion = 0.0
        self.restless: tuple[str, ...] = ()
        # Whether the arm has not been seen to move since the stream began, or paused.
        self._unseen = True

    @property
    def resting(self) -> bool:
        """Whether the arm rests."""
        return self._window is not None and not self._window.suspended

    @property
    def recorded(self) -> float:
        """How much of the present stop is recorded, s."""
        return self._window.seconds if self._window else 0.0

    def measure_excursion_from(self, angles: FloatArray) -> None:
        """From now on `excursion` is how far the arm has been from here, (n,) rad."""
        self._reference, self.excursion = angles, 0.0

    def restart(self) -> None:
        """Record the present stop again from now on."""
        if self._window is not None:
            self._window.clear()

    def interrupt(self) -> None:
        """What comes next does not follow what came before: the stream was cut."""
        self._detector.interrupt()

    def feed(self, readings: Iterable[Reading]) -> list[Event]:
        """What new readings tell."""
        events: list[Event] = []
        for reading in readings:
            if not reading.error.any():
                for look in self._detector.feed([reading]):
                    events += self._take(look)
                continue
            # An encoder says its position is invalid: told once for each stop and joint.
            if self._window is not None and not self._window.complete:
                self._window.clear()
            new = set(np.flatnonzero(reading.error).tolist()) - self._flagged
            self._flagged |= new
            events += [Rejected("error flag", self._names(sorted(new)))] if new else []
        return events

    def _take(self, look: Look) -> list[Event]:
        events: list[Event] = [Interrupted(look.gap)] if look.gap else []
        if look.gap:
            self._unseen = True
            self._way.clear()
            if self._window is not None:
                self._window.suspended = self._window.interrupted = True
        if look.readings:
            self._way.append((look.readings[-1].time, look.angles))
            # How far back the way to a rest is looked at, s: seating a plug and turning it takes no
            # longer.
            while look.readings[-1].time - self._way[0][0] > 3.0:
                self._way.popleft()
        if self._reference is not None:
            away = float(np.max(np.abs(wrap(look.angles - self._reference))))
            self.excursion = max(self.excursion, away)
        if look.resting is None:
            return events
        if not look.resting:
            self._unseen, self.restless = False, self._names(look.moving)
            return events + self._end(self._names(look.moving))
        if self._window is not None and self._window.suspended:
            events += self._resume(look)
        if self._window is None:
            way = None if self._unseen else np.array([where for _, where in self._way])
            self._window = StopWindow(interrupted=self._unseen, way=way)
            self._flagged.clear()
            events.append(Began())
        return events + self._record(self._window, look)

    def _resume(self, look: Look) -> list[Event]:
        """After a pause: the same stop, or another one that began unseen."""
        assert self._window is not None
        self._window.suspended = False
        if self._window.angles:
            away = np.abs(wrap(look.angles - self._average(self._window).angles))
            # Where it is now is one moment of its tremor.
            if np.all(away <= self.settings.tremble + self._limit()):
                return []
        return self._end(())

    def _end(self, joints: tuple[str, ...]) -> list[Event]:
        window, self._window = self._window, None
        if window is None or window.complete or not window.angles:
            return []
        average = self._average(window, window.seconds - self.settings.onset)
        return [Ended(average, joints, window.interrupted, self._refusal(average))]

    def _record(self, window: StopWindow, look: Look) -> list[Event]:
        if window.complete:
            return []
        for reading in look.readings:
            window.add(reading, self.settings.gap)
        if window.seconds < self._seconds:
            return []
        # Joints that move too slowly for the short window: begin against end of the long one.
        _, deviation = unwrapped_about_median(np.array(window.angles))
        quarter = max(1, len(deviation) // 4)
        drift = np.median(deviation[-quarter:], axis=0) - np.median(deviation[:quarter], axis=0)
        tremor = 2 * spread(deviation) * min(1.0, 4 * self.settings.tremor / self._seconds)
        crept = np.flatnonzero(np.abs(drift) > self._limit() + tremor).tolist()
        if crept:
            window.clear()
            return [Rejected("crept", self._names(crept))]
        average = self._average(window)
        if refusal := self._refusal(average):
            already, window.refused = window.refused, True
            window.clear()
            return [] if already else [Rejected(refusal)]
        window.complete = True
        return [Complete(average)]

    def _average(self, window: StopWindow, until: float = np.inf) -> Average:
        return window.average(until, () if self._extra is None else self._extra.names)

    def _refusal(self, average: Average) -> str:
        return "" if self._extra is None else self._extra.refusal(average)

    def _limit(self) -> FloatArray:
        """(n,) by how much two looks at an arm that stands still may differ, rad."""
        s = self.settings
        return 2.0 * np.maximum(s.drift, s.noises * self._detector.noise)

    def _names(self, indices: Sequence[int]) -> tuple[str, ...]:
        return tuple(self._joints[i] for i in indices)


@dataclass(eq=False)
class StopWindow:
    """What has been recorded of a stop.

    Attributes:
        angles, ends: each reading's angles, (n,) rad, and the time recorded up to it, s.
        extra: what was sent beside them, (m,).
        last: time of the last reading, s, the device's clock.
        suspended: whether the stream paused and it is not yet known where the arm is.
        interrupted: whether it has paused during this rest, or paused or began just before.
        complete: whether it was long enough.
        refused: whether it was long enough once, and what came beside the joints was of no use.
        way: (k, n) where the arm was before it rested, rad; None where that was not seen.
    """

    angles: list[FloatArray] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    extra: list[FloatArray] = field(default_factory=list)
    last: float | None = None
    suspended: bool = False
    interrupted: bool = False
    complete: bool = False
    refused: bool = False
    way: FloatArray | None = None

    @property
    def seconds(self) -> float:
        """How long has been recorded, s."""
        return self.ends[-1] if self.ends else 0.0

    def add(self, reading: Reading, gap: float) -> None:
        """Take a reading; after a pause of more than ``gap`` s none of it counts."""
        step = 0.0 if self.last is None else reading.time - self.last
        self.angles.append(reading.angles)
        self.extra.append(reading.extra)
        self.ends.append(self.seconds + (step if 0 <= step <= gap else 0.0))
        self.last = reading.time

    def average(self, until: float = np.inf, extra: Sequence[str] = ()) -> Average:
        """Of the first ``until`` s; of columns with these names too."""
        count = max(1, int(np.searchsorted(self.ends, until, side="right")))
        result = average(self.angles[:count], min(self.seconds, max(until, 0.0)))
        numbers = {
            n: mean_number(v) for n, v in zip(extra, np.array(self.extra[:count]).T, strict=True)
        }
        return replace(result, way=self.way, extra=numbers)

    def clear(self) -> None:
        """Begin again."""
        self.angles, self.ends, self.extra, self.last, self.complete = [], [], [], None, False
