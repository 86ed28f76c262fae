"""What geometry that a job holds as drawn does to how a plug sits, as far as residuals show it.

A plug that always sits x off its socket's axis shifts every touch as a tip, or a last link, that
is off its drawing does. Where such geometry is held, its error goes into the seating, whose scatter
from touch to touch says nothing of it. How large these errors are the residuals tell: with G the
derivatives by what is held, in units of `_TYPICAL` errors, the whitened residuals have the
covariance

    σ² M (I + λ G Gᵀ) M,   M what is left of them once the unknowns are fitted

and σ² and λ are where its restricted likelihood is largest (Patterson and Thompson 1971, REML). The
seating then has the covariance λσ² B Bᵀ more, with B = A⁻¹ Jᵀ G what the held geometry does to it.
What residuals never show of held geometry is `held_geometry`'s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.information import scaled_inverse, whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.terms.seating import is_seating
from suta_calib.units import from_deg

# Errors of machined arms beside each other, lengths and angles: what docs and shipped jobs give as
# prior. Only their ratio counts.
_TYPICAL: Final = {"m": 1e-3, "rad": from_deg(0.1)}
# Candidates for λ, from what no data show to errors a thousand times as large as typical ones.
_RATIOS: Final = np.geomspace(1e-8, 1e6, 141)
# A direction of what is held that the unknowns take up wholly leaves nothing in the residuals.
_LEFT: Final = 1e-9


def seating_covariance(
    problem: Problem, x: FloatArray, sigmas: Sequence[float], free: IntArray
) -> FloatArray:
    """What the held geometry adds to the covariance of how plugs sit; zero for all else.

    Args:
        problem: terms and parameters.
        x: (n,) the estimate.
        sigmas: noise level of each block.
        free: indices that were estimated.

    Returns:
        (n, n), of entries of seatings among ``free``.
    """
    nothing = np.zeros((len(x), len(x)))
    names = problem.names
    seating = [k for k in free if is_seating(problem.parameters[names[k]])]
    if not seating or problem.arm is None:
        return nothing
    estimated = {names[k] for k in free}
    held = [p for p in problem.arm.select("geometric").values() if p.name not in estimated]
    arm = [*problem.arm_parameters.values()]
    beside = [p for p in held if p.name not in problem.arm_parameters]
    wider = Problem(problem.terms, ParameterSet([*arm, *beside]))
    at = dict(zip(names, x, strict=True))
    values = np.array([at.get(n, p.nominal) for n, p in wider.parameters.items()])
    rows = whitened_rows(wider, values, sigmas)
    column = {name: k for k, name in enumerate(wider.names)}
    # Of a robust fit as its last step of reweighted least squares has them.
    weight = np.concatenate(
        [np.repeat(np.sqrt(r.line.weight), r.line.residual.shape[1]) for r in rows]
    )
    jacobian = np.concatenate([r.jacobian for r in rows]) * weight[:, None]
    residual = weight * np.concatenate(
        [(r.line.residual / r.line.sigma[:, None]).ravel() for r in rows]
    )
    fitted = jacobian[:, [column[names[k]] for k in free]]
    typical = np.array([_TYPICAL[p.unit] for p in held])
    effect = jacobian[:, [column[p.name] for p in held]] * typical
    prior = np.diag(problem.stated_precision())[np.ix_(free, free)]
    # (free, held): what a typical error of each does to the unknowns.
    shift = scaled_inverse(fitted.T @ fitted + prior) @ (fitted.T @ effect)
    size = _size(residual, effect - fitted @ shift, len(free))
    places = [int(np.flatnonzero(free == k)[0]) for k in seating]
    nothing[np.ix_(seating, seating)] = size * shift[places] @ shift[places].T
    return nothing


def _size(residual: FloatArray, left: FloatArray, fitted: int) -> float:
    """λσ², the variance of the held geometry's errors in units of typical ones; 0 for none.

    Args:
        residual: (m,) whitened.
        left: (m, k) what the held geometry leaves in the residuals once the unknowns are fitted.
        fitted: how many were.
    """
    basis, singular, _ = np.linalg.svd(left, full_matrices=False)
    shown = singular > _LEFT * max(float(singular.max(initial=0.0)), 1e-300)
    basis, squared = basis[:, shown], singular[shown] ** 2
    components = (basis.T @ residual) ** 2
    rest = max(float(residual @ residual - components.sum()), 0.0)
    freedom = len(residual) - fitted
    if not len(squared) or freedom <= len(squared) or rest == 0.0:
        return 0.0

    def noise(ratio: float) -> float:
        return float((rest + np.sum(components / (1.0 + ratio * squared))) / freedom)

    def twice_cost(ratio: float) -> float:
        return freedom * float(np.log(noise(ratio))) + float(np.log1p(ratio * squared).sum())

    costs = np.array([twice_cost(ratio) for ratio in _RATIOS])
    best = int(np.argmin(costs))
    # Twice the gain in likelihood that chance exceeds once in a hundred where nothing is lacking: λ
    # is at its bound 0, so it is half a chi-squared of one degree of freedom.
    significant = 5.41
    if twice_cost(0.0) - costs[best] < significant:
        return 0.0
    return float(_RATIOS[best] * noise(float(_RATIOS[best])))
