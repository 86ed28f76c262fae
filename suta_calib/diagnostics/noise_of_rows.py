"""How far rows scatter, without asking the model: by repeats, or by neighbours in posture.

What the model gets wrong is the same in repeats of one touch, and nearly the same in two rows whose
joints read nearly alike. The difference of their residuals is therefore mostly noise, and half of
its variance is that of one row (von Neumann 1941, doi:10.1214/aoms/1177731677; for regression:
Rice 1984, doi:10.1214/aos/1176346788). Neighbours that are far apart share less of the model's
error, so their estimate is too large rather than too small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.held_out import robust_level
from suta_calib.diagnostics.repeats import lack_of_fit
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term
from suta_calib.terms.block import Block
from suta_calib.terms.poses import ArmPoses
from suta_calib.units import Unit

Source = Literal["repeats", "neighbours"]


@dataclass(frozen=True)
class RowNoise:
    """Residuals of one block, and what rows alone say of its noise.

    Attributes:
        kind: of the term.
        name, unit: of the block.
        level: robust standard deviation of one component of the residuals, m or rad.
        noise: the same of the rows' own scatter; NaN where nothing tells it.
        source: what tells it.
    """

    kind: str
    name: str
    unit: Unit
    level: float
    noise: float
    source: Source

    @property
    def ratio(self) -> float:
        """Residuals over noise; NaN where nothing tells the noise."""
        return self.level / self.noise


def noise_of_rows(solution: Solution) -> list[RowNoise]:
    """One for each block of each term, in the problem's order.

    Args:
        solution: a converged one.
    """
    problem = solution.problem
    lines = iter(problem.linearise(solution.x, problem.assumed_sigmas()))
    repeats = {(fit.kind, fit.unit): fit.repeat for fit in lack_of_fit(solution)}
    rows = []
    for term in problem.terms:
        for block in term.blocks:
            residual = next(lines).residual
            noise = repeats.get((term.kind, block.unit))
            source: Source = "repeats" if noise else "neighbours"
            if noise is None:
                noise = _noise_by_neighbours(term, block, residual)
            level = robust_level(residual)
            rows.append(RowNoise(term.kind, block.name, block.unit, level, noise, source))
    return rows


def _noise_by_neighbours(term: Term, block: Block, residual: FloatArray) -> float:
    """Standard deviation of one component by differences of neighbours in posture, or NaN.

    Args:
        term: whose rows these are.
        block: of the term; of one sample a row.
        residual: (n, d).
    """
    if not isinstance(term.poses, ArmPoses) or block.samples.shape[1] != 1:
        return math.nan
    # Readings of one rest share its posture's noise: one of each.
    once = np.unique(term.poses.rests[block.samples[:, 0]], return_index=True)[1]
    # Rows below which neighbours say too little of the noise: a median of twenty is known to a
    # fifth.
    if len(once) < 20:
        return math.nan

    postures = term.poses.samples.q[block.samples[once, 0]]
    spread = np.std(postures, axis=0)
    tree = cKDTree(postures / np.where(spread > 0, spread, 1.0))
    neighbour = tree.query(tree.data, k=2)[1][:, 1]
    return robust_level(residual[once] - residual[once][neighbour]) / math.sqrt(2.0)
