"""Time offsets that a calibration found, and what they would do at the tip."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from suta_calib.solver.solution import Estimate, Solution

if TYPE_CHECKING:
    from suta_calib.trust.examination import Examination


@dataclass(frozen=True)
class ClockOffset:
    """How much an instrument's clock is off that of the readings.

    Attributes:
        name: of the unknown.
        offset: what is added to the instrument's time, s.
        std: its standard deviation, s; None where the data do not tell it.
        speed: of the tip in the rows that it sees, root mean square, m/s.
        rows: how many these are.
        left_out: how many more there were, nearer to a gap in time than the clock may be off.
        state: as of the unknown.
    """

    name: str
    offset: float
    std: float | None
    speed: float
    rows: int
    left_out: int
    state: str

    @property
    def tip(self) -> float:
        """How far the tip moves in this time, root mean square, m."""
        return abs(self.offset) * self.speed

    @property
    def tip_std(self) -> float | None:
        """What of it is uncertain, m."""
        return None if self.std is None else self.std * self.speed


def clock_offsets(examined: Examination) -> tuple[ClockOffset, ...]:
    """Of every clock that is an unknown, once; none without convergence."""
    solution, squares = examined.solution, dict[str, list[float]]()
    left_out = Counter[str]()
    # Without a clock nobody asks for the velocities, which take as much memory as all else.
    if not solution.converged or not any(term.of_clock for term in examined.problem.terms):
        return ()
    velocity = examined.table.rate.reshape(-1, 6)[:, :3]
    for term, (first, end) in zip(
        examined.problem.terms, pairwise(examined.boundaries.tolist()), strict=True
    ):
        for p in term.of_clock[:1]:
            motion = term.poses.samples.motion
            left_out[p.name] += 0 if motion is None else motion.rows - len(term.poses)
            squares.setdefault(p.name, []).extend(np.sum(velocity[first:end] ** 2, axis=1).tolist())
    clocks = ((solution.estimates[name], of_rows) for name, of_rows in squares.items())
    return tuple(
        ClockOffset(
            *(e.name, e.value, e.std, float(np.sqrt(np.mean(s)))),
            *(len(s), left_out[e.name], e.state),
        )
        for e, s in clocks
    )


def line_delays(solution: Solution) -> tuple[Estimate, ...]:
    """How long a row of a picture takes, of each camera with a rolling shutter."""
    names = dict.fromkeys(p.name for term in solution.problem.terms for p in term.of_clock[1:])
    return tuple(solution.estimates[name] for name in names) if solution.converged else ()
