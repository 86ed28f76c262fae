"""A frame that does not stay where it is: what the hypotheses about a base and a tip share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.solver.problem import Problem
from suta_calib.trust.hypothesis import SpoiltData
from suta_calib.trust.in_time import (
    TWIST,
    ChangeInTime,
    InTime,
    TipShift,
    flat,
    later_half,
    of_base,
    of_tip,
    so_far,
)
from suta_calib.trust.spoiling import displaced


@dataclass(frozen=True)
class Frame:
    """Where a displacement happens, and along whose axes.

    Attributes:
        what: as a sentence names it.
        velocity: (samples, 6, 6) of every tip, by a shift and a turn of the frame.
        in_base: (n, 3) or (3,) a shift (3,) along the frame's axes in the base's, by the tips'
            rotations (n, 3, 3).
    """

    what: str
    velocity: Callable[[Problem], FloatArray]
    in_base: Callable[[FloatArray, FloatArray], FloatArray]


BASE: Final = Frame("base, or what it met,", of_base, lambda _, by: by)
TIP: Final = Frame("tool, or what is on it,", of_tip, lambda rotation, by: rotation @ by)


class FrameInTime(InTime):
    """Every tip is displaced and turned with a frame: from a row on, or ever more."""

    frame: ClassVar[Frame]

    def motions(self, problem: Problem) -> Iterator[TipShift]:
        """One where it happens at once, else one for each term."""
        velocity = self.frame.velocity(problem)
        for share in (1.0,) if self.at_once else so_far(problem):
            yield TipShift("", flat(velocity, share), TWIST)

    def statement(self, change: ChangeInTime) -> str:
        """From where to where, by how much."""
        if not self.at_once:
            return (
                f"The {self.frame.what} crept by {change.amount} while the rows were measured: "
                "let it warm up, fix it."
            )
        if change.until:
            return (
                f"The {self.frame.what} was elsewhere by {change.amount} from {change.since} to "
                f"{change.until}: give these rows another label."
            )
        return (
            f"The {self.frame.what} was moved by {change.amount} at {change.since}: give the rows "
            "after it another label."
        )

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """Two millimetres: from the middle on, or until the last row."""
        del rng
        by = 2e-3 * np.array([0.6, 0.0, 0.8])
        twist = np.zeros((len(data.poses), 6))
        share = later_half(data) if self.at_once else np.arange(len(twist)) / len(twist)
        twist[:, :3] = self.frame.in_base(data.poses.at(values)[0], by) * share[:, None]
        return SpoiltData(displaced(data, values, twist), np.array([*by, 0.0, 0.0, 0.0]))
