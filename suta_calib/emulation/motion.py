"""What an emulated arm does: true joint readings as a function of time.

Motions are plain data that another process can be handed. Before zero and after its end a motion
stands still.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import InputError

_TURN: Final = 2 * np.pi


class Motion(ABC):
    """True readings of every joint at any time."""

    @property
    def end(self) -> float:
        """When the motion is over, s; infinite for one that is not."""
        return np.inf

    @abstractmethod
    def readings(self, time: FloatArray) -> FloatArray:
        """(n, joints) readings at times (n,), s: rad, continuous, not wrapped (prismatic: m)."""


@dataclass(frozen=True, eq=False)
class Still(Displayable, Motion):
    """An arm that nobody moves.

    Attributes:
        posture: (joints,) readings, rad (m for prismatic joints).
    """

    posture: FloatArray

    def readings(self, time: FloatArray) -> FloatArray:
        """(n, joints) the same at all times."""
        return np.tile(self.posture, (len(time), 1))


@dataclass(frozen=True, eq=False)
class Stops(Displayable, Motion):
    """Rests on one place after the other, with minimum-jerk motions between them.

    The motions are those of Flash, Hogan (1985), doi:10.1523/JNEUROSCI.05-07-01688.1985, in joint
    space: velocity and acceleration are zero at either end.

    Attributes:
        posture: (n, joints) readings at the rests, continuous: joints move by the differences.
        labels: of each rest, as in the columns of a samples file.
        rest: how long each rest lasts, s.
        move: how long each motion between two rests lasts, s; positive.
        rounds: numbers of the rests that end a round: a placement gone through once.
    """

    posture: FloatArray
    labels: tuple[Mapping[str, str], ...]
    rest: float = 4.0
    move: float = 1.5
    rounds: tuple[int, ...] = ()

    @property
    def end(self) -> float:
        """When the last rest begins: it lasts for good."""
        return self.arrival(len(self.posture) - 1)

    def arrival(self, stop: int) -> float:
        """When a rest begins, s."""
        return stop * (self.rest + self.move)

    def resting_on(self, time: FloatArray) -> FloatArray:
        """(n,) number of the rest at each time, NaN while the arm moves."""
        stop, share = self._phase(time)
        return np.where(share > 0, np.nan, stop)

    def readings(self, time: FloatArray) -> FloatArray:
        """(n, joints) readings at times (n,)."""
        stop, share = self._phase(time)
        here = self.posture[stop]
        there = self.posture[np.minimum(stop + 1, len(self.posture) - 1)]
        return np.asarray(here + minimum_jerk(share)[:, None] * (there - here), dtype=float)

    def _phase(self, time: FloatArray) -> tuple[np.ndarray, FloatArray]:
        """Number of the last rest begun, and the share of the motion after it that is done."""
        cycle = self.rest + self.move
        stop = np.clip(np.floor(time / cycle), 0, len(self.posture) - 1).astype(int)
        share = np.clip((time - stop * cycle - self.rest) / self.move, 0.0, 1.0)
        return stop, np.where(stop == len(self.posture) - 1, 0.0, share)


@dataclass(frozen=True, eq=False)
class Sweep(Displayable, Motion):
    """Every joint swings about a posture, faster and faster, and reverses its direction each swing.

    ``q = posture + amplitude · fade(t) · sin(2π pace ∫f + lag)``: ``f`` rises linearly in time, the
    swings grow in the first second and die down in the last, and every joint has a lag and a pace
    of its own, so that no two reverse together.

    Attributes:
        posture: (joints,) readings in the middle, and at either end.
        amplitude: (joints,) farthest from the posture, rad (m).
        slowest, fastest: frequency at the start and at the end, Hz.
        duration: s.
    """

    posture: FloatArray
    amplitude: FloatArray
    slowest: float = 0.05
    fastest: float = 0.5
    duration: float = 60.0

    @property
    def end(self) -> float:
        """When the swings end, s."""
        return self.duration

    def readings(self, time: FloatArray) -> FloatArray:
        """(n, joints) readings at times (n,)."""
        t = np.clip(time, 0.0, self.duration)
        swings = self.slowest * t + (self.fastest - self.slowest) * t**2 / (2 * self.duration)
        number = np.arange(len(self.posture))
        phase = _TURN * np.outer(swings, 1 + 0.07 * number) + _TURN * number / len(number)
        fading = min(1.0, self.duration / 2)
        fade = minimum_jerk(np.clip(np.minimum(t, self.duration - t) / fading, 0.0, 1.0))
        swing: FloatArray = self.amplitude * fade[:, None] * np.sin(phase)
        return np.asarray(self.posture + swing, dtype=float)


@dataclass(frozen=True, eq=False)
class Curve(Displayable, Motion):
    """A smooth curve through given readings.

    Attributes:
        time: (n,) s, increasing; the first is when the motion begins.
        posture: (n, joints) readings, continuous.
    """

    time: FloatArray
    posture: FloatArray
    _spline: Callable[[FloatArray], FloatArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if len(self.time) < 2 or not (np.diff(self.time) > 0).all():
            raise InputError("times that do not increase", "two or more times in increasing order")
        # Imported where a curve is: most arms that are emulated follow none, and start three times
        # faster without.

        object.__setattr__(self, "_spline", CubicSpline(self.time, self.posture))

    @property
    def end(self) -> float:
        """The last time given, s."""
        return float(self.time[-1])

    def readings(self, time: FloatArray) -> FloatArray:
        """(n, joints) readings at times (n,)."""
        return np.asarray(self._spline(np.clip(time, self.time[0], self.time[-1])), dtype=float)


@dataclass(frozen=True, eq=False)
class ThereAndBack(Displayable, Motion):
    """A path gone along to its end and back again, for as long as it is asked for.

    Attributes:
        path: the way there.
        period: of going there and back, s.
    """

    path: Curve
    period: float

    def readings(self, time: FloatArray) -> FloatArray:
        """(n, joints) readings at times (n,)."""
        share = (1 - np.cos(_TURN * np.maximum(time, 0.0) / self.period)) / 2
        first, last = self.path.time[0], self.path.time[-1]
        return self.path.readings(first + share * (last - first))


@dataclass(frozen=True, eq=False)
class ExtraNumbers(Displayable):
    """Numbers that an emulated arm sends beside its joints.

    Attributes:
        columns: their names.
        time: (k,) s of the motion, increasing.
        values: (k, m) at these times; in between they change evenly.
        noise: standard deviation of a reading.
    """

    columns: tuple[str, ...]
    time: FloatArray
    values: FloatArray
    noise: float = 0.0

    def readings(self, time: FloatArray) -> FloatArray:
        """(n, m) at times (n,), without noise."""
        return np.stack([np.interp(time, self.time, column) for column in self.values.T], axis=1)


def minimum_jerk(share: FloatArray) -> FloatArray:
    """Share of the way gone after a share of the time, both from 0 to 1."""
    return share**3 * (10 - 15 * share + 6 * share**2)


def continuous(posture: FloatArray, turns: np.ndarray) -> FloatArray:
    """Readings (n, joints) without jumps at ±π: joints that turn fully go the shorter way."""
    step = np.diff(posture, axis=0)
    step -= np.where(turns, _TURN * np.round(step / _TURN), 0.0)
    return np.concatenate([posture[:1], posture[0] + np.cumsum(step, axis=0)])
