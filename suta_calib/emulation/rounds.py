"""When an arm goes on to the next placement: as a hand does, once nobody is measuring any more."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.emulation.motion import Motion, Stops


class RoundClock:
    """Time of the motion: the stream's, but it waits at the end of each round.

    A round is one placement gone through once. Its last rest lasts until the port is closed after
    at least half of it; then the arm is on the first place of the next round, and goes on when
    the port is opened again. So one emulated arm serves one ``measure`` after the other, however
    long they take to start.

    Args:
        motion: what the arm does; motions without rounds are never held.
        heard: whether anybody has the port open.
    """

    def __init__(self, motion: Motion, heard: Callable[[], bool]) -> None:
        self._heard = heard
        self._origin = 0.0
        self._gates: list[tuple[float, float]] = []
        self._between = False
        if isinstance(motion, Stops):
            # After the last round the arm rests for good: no gate there.
            self._gates = [
                (motion.arrival(stop) + motion.rest / 2, motion.arrival(stop + 1))
                for stop in motion.rounds[:-1]
            ]
            self._half = motion.rest / 2

    def __call__(self, time: FloatArray) -> FloatArray:
        """(n,) time of the motion at (n,) times of the stream, increasing from call to call."""
        if not self._gates:
            return time - self._origin
        leave, resume = self._gates[0]
        if self._between:
            return self._waiting(time, resume)
        at = np.asarray(time - self._origin, dtype=float)
        if at[-1] >= leave and not self._heard():
            self._between = True
            return np.full_like(time, resume)
        held: FloatArray = np.minimum(at, leave + self._half)
        return held

    def _waiting(self, time: FloatArray, resume: float) -> FloatArray:
        """Resting on the first place of the next round."""
        if not self._heard():
            return np.full_like(time, resume)
        self._between = False
        self._gates.pop(0)
        self._origin = float(time[0]) - resume
        return time - self._origin
