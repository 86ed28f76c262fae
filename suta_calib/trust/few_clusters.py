"""How far a covariance that few witnesses have told may be trusted itself.

A sandwich of few witnesses scatters: chi-squared holds of many. What a test of several parameters
follows instead is Hotelling's distribution with the degrees of freedom of the Wishart matrix whose
scatter is the sandwich's (Pustejovsky and Tipton 2018, doi:10.1080/07350015.2016.1247004; Bell and
McCaffrey 2002), were residuals all independent.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.covariance import MANY_TOUCHES
from suta_calib.solver.information import robust_jacobian, whitened_rows
from suta_calib.solver.solution import Solution

# Least part of a witness that a fit leaves it, as where residuals are freed of their leverage.
_LEFT: Final = 0.1
# Rows of a witness from which on its squares are summed by themselves.
MANY_EACH: Final = 8


def chance_of(squared: float, count: int, freedom: float) -> float:
    """Chance of so large a change, by what is right.

    Args:
        squared: ``dᵀ C⁻¹ d`` of the change d of some parameters, C their covariance.
        count: of these parameters.
        freedom: of C: `freedom_of`.
    """
    left = freedom - count + 1.0
    return float(fdtrc(count, left, squared * left / (freedom * count))) if left > 0.0 else 1.0


def freedom_of(solution: Solution, at: IntArray) -> float:
    """Degrees of freedom of the covariance of some parameters, by witness.

    Args:
        solution: of terms whose rows look at one sample each.
        at: (k,) numbers of the parameters, which are free.
    """
    free, problem = solution.free, solution.problem
    curvature = np.diag(problem.prior_precision()[free])
    gains: list[FloatArray] = []
    for term in problem.terms:
        # Of one term's rows, summed by witness.
        by_witness = np.zeros((int(term.witnesses.max()) + 1, len(free), len(free)))
        for rows in whitened_rows(problem, solution.x, solution.sigmas):
            block = rows.line.view.block
            if not any(block is member for member in term.blocks):
                continue
            n, size = rows.line.residual.shape
            gain = robust_jacobian(rows)[:, free].reshape(n, size, -1)
            witness = term.witnesses[block.samples[:, 0]]
            if n < MANY_EACH * len(by_witness):
                np.add.at(by_witness, witness, np.einsum("ndp,ndq->npq", gain, gain))
                continue
            # The squares of single rows would take more room than all rows do.
            order = np.argsort(witness, kind="stable")
            for mine in np.split(order, np.flatnonzero(np.diff(witness[order])) + 1):
                of_one = gain[mine].reshape(len(mine) * size, -1)
                by_witness[witness[mine[0]]] += of_one.T @ of_one
        gains.append(by_witness)
    return wishart_freedom(np.concatenate(gains), curvature, np.searchsorted(free, at))


def wishart_freedom(gain: FloatArray, prior: FloatArray, at: IntArray) -> float:
    """Degrees of freedom of a sandwich, from what every witness tells.

    Args:
        gain: (witnesses, n, n) curvature of the cost that each contributes.
        prior: (n, n) curvature of what is known without them.
        at: (k,) the parameters whose covariance it is.
    """
    if len(gain) > MANY_TOUCHES:
        return float(len(gain))
    total = prior + gain.sum(axis=0)
    unit = 1.0 / np.sqrt(np.diag(total))
    scaled = np.outer(unit, unit)
    values, vectors = np.linalg.eigh(total * scaled)
    root = vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))
    share, axes = np.linalg.eigh(root.T @ (gain * scaled) @ root)
    share = np.clip(share, 0.0, 1.0)
    left = np.maximum(1.0 - share, _LEFT)
    # Covariance of what witnesses s and t do to the parameters: δ_st alone_s - shared_s shared_tᵀ.
    chosen = root[at] @ axes
    alone = (chosen * (share / left)[:, None]) @ np.swapaxes(chosen, 1, 2)
    shared = (chosen * (share / np.sqrt(left))[:, None]) @ np.swapaxes(axes, 1, 2)
    mean = alone.sum(axis=0) - np.einsum("tip,tjp->ij", shared, shared)
    whiten = np.linalg.inv(np.linalg.cholesky(mean))
    alone, shared = whiten @ alone @ whiten.T, whiten @ shared
    scatter = 0.0
    for k, mine in enumerate(shared):
        between = -np.einsum("ip,tjp->tij", mine, shared)
        between[k] += alone[k]
        scatter += float(np.sum(np.trace(between, axis1=1, axis2=2) ** 2))
        scatter += float(np.einsum("tij,tji->", between, between))
    return len(at) * (len(at) + 1) / scatter
