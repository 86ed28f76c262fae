"""An arm that moves smoothly while it is seen, by an instrument with a clock of its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.measurements.fields import Value, keyed, quantity
from suta_calib.measurements.yaml_file import YamlSection
from suta_calib.units import from_deg, from_ms


def _ms(section: YamlSection, name: str) -> float:
    return from_ms(section.number(name))


def _step(section: YamlSection, name: str) -> float:
    return from_ms(section.number(name, "positive"))


@dataclass(frozen=True)
class MotionSpec(Displayable):
    """A moving arm: the key ``motion`` of a set, in SI."""

    step: float = keyed(Value("ms", _step), "Time from row to row.", 0.1, "step_ms")
    speed: float = keyed(
        quantity("rad", "positive", "deg/s"),
        "Largest speed of a joint; of a prismatic joint as of a tip half a metre from the axis.",
        from_deg(40.0),
        "speed_deg_per_s",
    )
    time_offset: float = keyed(
        Value("ms", _ms),
        "What has to be added to the time of a row for the moment at which its observation was "
        "made: -20 for one that is 20 ms old. Default: 0.",
        0.0,
        "time_offset_ms",
    )


@dataclass(frozen=True, eq=False)
class Passage:
    """Rows of a moving arm.

    Attributes:
        time: (n,) of the rows, s.
        q: (n, joints) where the joints were then.
        offset: how much later the observation of the row was made, s.
        path: readings (n, joints) at any times (n,), s.
    """

    time: FloatArray
    q: FloatArray
    offset: float
    path: CubicSpline

    def later(self, after: float) -> FloatArray:
        """(n, joints) where the joints were so many seconds after the observation began."""
        time = np.clip(self.time + self.offset + after, 0.0, self.path.x[-1])
        return np.asarray(self.path(time), dtype=np.float64)

    @property
    def seen_at(self) -> FloatArray:
        """(n, joints) where they were when the observation of the row was made."""
        return self.later(0.0)


def passage(
    motion: MotionSpec,
    rows: int,
    largest: FloatArray,
    postures: Callable[[int], FloatArray],
    in_sight: Callable[[FloatArray], BoolArray] | None,
) -> Passage:
    """So many rows of an arm that passes postures on a smooth path.

    Args:
        motion: how it moves.
        rows: how many are wanted.
        largest: (joints,) speeds, rad/s or m/s.
        postures: so many of them (n, joints), without jumps by whole turns.
        in_sight: of readings (n, joints), in which of them something is seen; None for all.
    """
    # Rows from one posture that the arm passes to the next, before it is known how many are in
    # sight.
    rows_a_leg = 15
    legs = max(math.ceil(rows / rows_a_leg), 4)
    while True:
        through = postures(legs + 1)
        if in_sight is not None:
            through = _nearest_next(through)
        path = _smooth(through, largest)
        # The rows have neighbours at all times.
        time = np.arange(0.0, path.x[-1], motion.step)
        seen_at = path(np.clip(time + motion.time_offset, 0.0, path.x[-1]))
        visible = np.ones(len(time), dtype=bool) if in_sight is None else in_sight(seen_at)
        if visible.sum() >= rows:
            first = np.flatnonzero(visible)[:rows]
            return Passage(time[first], path(time[first]), motion.time_offset, path)
        legs = 1 + math.ceil(1.2 * legs * rows / max(int(visible.sum()), rows / 4))


def _smooth(through: FloatArray, largest: FloatArray) -> CubicSpline:
    """Readings over time, from rest to rest, with joints that move no faster than they may."""
    legs = np.max(np.abs(np.diff(through, axis=0)) / largest, axis=1)
    time = np.concatenate([[0.0], np.cumsum(np.maximum(legs, 1e-3 * legs.max()))])
    path = CubicSpline(time, through, bc_type="clamped")
    fine = np.linspace(0.0, time[-1], 50 * len(through))
    slower = float(np.max(np.abs(path(fine, 1)) / largest))
    return CubicSpline(time * slower, through, bc_type="clamped")


def _nearest_next(through: FloatArray) -> FloatArray:
    """The postures one after the other, each nearest to the one before it."""
    left, order = [*range(1, len(through))], [0]
    while left:
        distance = np.linalg.norm(through[left] - through[order[-1]], axis=1)
        order.append(left.pop(int(np.argmin(distance))))
    return through[order]
