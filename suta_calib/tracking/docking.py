"""Rests of a tracked arm on known points: the touches of a re-calibration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from suta_calib.acquisition.stops import Complete, StopFinder
from suta_calib.arrays import FloatArray
from suta_calib.device.reading import Reading
from suta_calib.tracking.publisher import Publisher
from suta_calib.tracking.recalibration import Recalibration
from suta_calib.tracking.tracker import TrackedPose


class Docking(Publisher):
    """Takes poses, and tells a re-calibration when the tip has come to rest on one of its points.

    Args:
        recalibration: of the arm that is tracked.
        say: told of each alarm, in a sentence.
        even: whether the device has no clock of its own.
    """

    name = "recalibrate"

    def __init__(
        self, recalibration: Recalibration, say: Callable[[str], None], *, even: bool = False
    ) -> None:
        super().__init__()
        self.recalibration, self._say = recalibration, say
        # How long the arm rests on a point before that counts as a touch, s.
        self._stops = StopFinder(recalibration.arm.joints, 1.0, even=even)
        self._waiting = list[Reading]()
        self._temperature: float | None = None
        self._said = 0

    def publish(self, pose: TrackedPose) -> None:
        """Note where the arm is."""
        flags = np.array([joint in pose.errors for joint in self.recalibration.arm.joints])
        reading = Reading(
            pose.sequence, pose.time, pose.angles, flags, np.zeros_like(flags), pose.arrival
        )
        self._waiting.append(reading)
        self._temperature = pose.temperature

    def flush(self) -> None:
        """Look whether it has come to rest: after the others have the pose."""
        if not self._waiting:
            return
        readings, self._waiting = self._waiting, []
        for event in self._stops.feed(readings):
            if isinstance(event, Complete):
                self._rested(event.average.angles, readings[-1].time)

    def _rested(self, angles: FloatArray, time: float) -> None:
        point = self.recalibration.nearest(angles)
        if point is None:
            self.dropped += 1
            return
        self.recalibration.touch(point, angles, time, self._temperature)
        self.published += 1
        for alarm in self.recalibration.alarms[self._said :]:
            self._say(f"re-calibration: {alarm}")
        self._said = len(self.recalibration.alarms)

    def close(self) -> None:
        """Nothing is open."""

    def statistics(self) -> dict[str, Any]:
        """Rests on a point, and elsewhere."""
        return {"touches": self.published, "rests elsewhere": self.dropped}
