"""What has been recorded of one stop, and for how long."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from suta_calib.acquisition.averaging import Average, average
from suta_calib.arrays import FloatArray

if TYPE_CHECKING:
    from suta_calib.device.reading import Reading


@dataclass(eq=False)
class StopWindow:
    """What has been recorded of a stop.

    Attributes:
        angles, ends: each reading's angles, (n,) rad, and the time recorded up to it, s.
        last: time of the last reading, s, the device's clock.
        suspended: whether the stream paused and it is not yet known where the arm is.
        interrupted: whether it has paused during this rest, or paused or began just before.
        complete: whether it was long enough.
    """

    angles: list[FloatArray] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    last: float | None = None
    suspended: bool = False
    interrupted: bool = False
    complete: bool = False

    @property
    def seconds(self) -> float:
        """How long has been recorded, s."""
        return self.ends[-1] if self.ends else 0.0

    def add(self, reading: Reading, gap: float) -> None:
        """Take a reading; after a pause of more than ``gap`` s none of it counts."""
        step = 0.0 if self.last is None else reading.time - self.last
        self.angles.append(reading.angles)
        self.ends.append(self.seconds + (step if 0 <= step <= gap else 0.0))
        self.last = reading.time

    def average(self, until: float = np.inf) -> Average:
        """Of the first ``until`` s."""
        kept = max(1, int(np.searchsorted(self.ends, until, side="right")))
        return average(self.angles[:kept], min(self.seconds, max(until, 0.0)))

    def clear(self) -> None:
        """Begin again."""
        self.angles, self.ends, self.last, self.complete = [], [], None, False
