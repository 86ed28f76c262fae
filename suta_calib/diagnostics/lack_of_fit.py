"""Do the residuals scatter as repeats of the same touch do, or is the model missing something?

Repeats of one touch see the same posture, so they agree but for noise, whatever is wrong with the
model. Residuals much larger than repeats explain are the model's own (the lack-of-fit comparison
of regression; Draper and Smith, Applied Regression Analysis, chapter 2). Values and standard
deviations then hold only within that model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.diagnostics.repeats import ENOUGH_GROUPS, repeat_groups
from suta_calib.solver.solution import Solution
from suta_calib.terms.block import Block
from suta_calib.units import Unit

# Of a normal distribution: median absolute value over standard deviation.
NORMAL_MEDIAN: Final = 0.6745


@dataclass(frozen=True)
class LackOfFit:
    """One block's residuals against its repeats.

    Attributes:
        kind: of the term.
        unit: m or rad.
        residual: robust standard deviation of one residual component.
        repeat: the same from differences between repeats of the same touch.
    """

    kind: str
    unit: Unit
    residual: float
    repeat: float

    @property
    def ratio(self) -> float:
        """Residual over repeat scatter: one for a model that lacks nothing."""
        return self.residual / self.repeat


def lack_of_fit(solution: Solution) -> tuple[LackOfFit, ...]:
    """Compare every block that has repeated touches; the others cannot be judged this way."""
    problem = solution.problem
    lines = iter(problem.linearise(solution.x, solution.sigmas))
    found = []
    for term in problem.terms:
        touch = term.repeats()
        for block in term.blocks:
            residual = next(lines).residual
            repeat = _repeat_scatter(block, residual, touch)
            if repeat is not None:
                level = float(np.median(np.abs(residual))) / NORMAL_MEDIAN
                found.append(LackOfFit(term.kind, block.unit, level, repeat))
    return tuple(found)


def _repeat_scatter(block: Block, residual: FloatArray, touch: IntArray) -> float | None:
    """Robust standard deviation of one component within groups of repeats, or None."""
    group, count = repeat_groups(block, touch)
    if np.sum(count > 1) < ENOUGH_GROUPS:
        return None
    mean = np.zeros((len(count), block.size))
    np.add.at(mean, group, residual)
    inside = residual - (mean / count[:, None])[group]
    freed = inside / np.sqrt(1.0 - 1.0 / np.maximum(count, 2))[group, None]
    scatter = float(np.median(np.abs(freed[count[group] > 1]))) / NORMAL_MEDIAN
    return scatter if scatter > 0 else None
