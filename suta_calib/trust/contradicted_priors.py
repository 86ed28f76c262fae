"""Do the data speak against what a term was told to believe, such as a camera's intrinsics?

What is believed is estimated too (`Term.with_assumptions_estimated`), from the same start and with
hardly any prior, and compared with what was believed (Wald 1943,
doi:10.1090/S0002-9947-1943-0012401-3): a score test
at the fit would need more pictures than a calibration has, for each is one cluster.

A sandwich of few clusters scatters: chi-squared holds of many. What a test of several parameters
follows instead is Hotelling's distribution with the degrees of freedom of the Wishart matrix whose
scatter is the sandwich's (Pustejovsky and Tipton 2018, doi:10.1080/07350015.2016.1247004; Bell and
McCaffrey 2002), were residuals all independent.

Its power was simulated (six-axis arm, a board at half a metre, corners to 0.1 px, every reading
off by a random part). At `LEVEL`, right intrinsics were contradicted in 2 of 200 calibrations with
exact readings, and in none of 200 with ones off by 1 mrad (20 pictures). Of 40 with wrong ones
were, by what is wrong:

========  ========  ====  ====  =====  ======  ======
pictures  readings  1 px  3 px  10 px  0.5 %f  1 %f
========  ========  ====  ====  =====  ======  ======
12        exact     13    40    40     40      40
20        exact     40    40    40     40      40
20        0.1 mrad  3     31    40     39      40
40        0.1 mrad  9     40    40     40      40
12        1 mrad    0     0     1      0       0
20        1 mrad    1     1     2      1       4
40        1 mrad    0     2     10     2       12
========  ========  ====  ====  =====  ======  ======

So nothing said against intrinsics is no proof of them: an arm that scatters by what wrong ones move
pictures by hides them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import chdtrc, fdtrc

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SutaCalibError
from suta_calib.model.parameters import Parameter
from suta_calib.solver.covariance import MANY_TOUCHES
from suta_calib.solver.information import robust_jacobian, whitened_rows
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.units import text, with_std

# Chance that right beliefs are contradicted; and below which an answer that follows them must not
# be used, if it is off by more than its ±.
LEVEL: Final = 0.01
SURE: Final = 1e-3
# Rows of a cluster from which on its squares are summed by themselves.
MANY_EACH: Final = 8


@dataclass(frozen=True)
class ContradictedBelief:
    """Fixed values of one thing, such as a camera, and the values that the data give.

    Attributes:
        told: the parameters, nominal as they were believed.
        values: of them, SI and px, as the data have it.
        stds: of these.
        remedy: what to write for them to be estimated.
        misled: the parameter of the result that they mislead most, and by how many of its ±; None
            where none is off by more than that.
        chance: of such data, were the fixed values right.
    """

    told: tuple[Parameter, ...]
    values: tuple[float, ...]
    stds: tuple[float, ...]
    remedy: str
    misled: tuple[str, float] | None
    chance: float

    @property
    def bad(self) -> bool:
        """Whether the result must not be used for it."""
        return self.misled is not None and self.chance < SURE

    @property
    def sentence(self) -> str:
        """The contradiction, and what to do."""
        changes = ", ".join(
            f"{p.key} {text(p.nominal, p.unit)} → {with_std(value, std, p.unit)}"
            for p, value, std in zip(self.told, self.values, self.stds, strict=True)
        )
        misled = ""
        if self.misled is not None:
            name, times = self.misled
            misled = f": {name} is off by about {times:.1f} times its ±"
        return (
            f"The data contradict the fixed values of {self.told[0].owner} ({changes}). The result "
            f"follows the fixed values, and no ± includes this error{misled}. Estimate them "
            f"({self.remedy}); or estimate more of the arm, if the error may be in the arm."
        )


def contradicted_beliefs(solution: Solution) -> Iterator[ContradictedBelief]:
    """What the data speak against, of everything that the terms believe."""
    problem = solution.problem
    estimated = [term.with_assumptions_estimated for term in problem.terms]
    believed = {
        p.name: (p, term.assumptions_key)
        for term in estimated
        if term is not None
        for p in term.own_parameters
        if p.name not in problem.parameters
    }
    if not believed:
        return

    terms = [more or term for more, term in zip(estimated, problem.terms, strict=True)]
    try:
        again = solve(Problem(terms, problem.arm_parameters), SolverOptions(confirm=False))
    except SutaCalibError:  # Too few data for so many unknowns contradict nothing.
        return
    if not again.converged:
        return
    free = {again.problem.names[k] for k in again.free}
    for owner in dict.fromkeys(p.owner for p, _ in believed.values()):
        parameters = [p for p, _ in believed.values() if p.owner == owner and p.name in free]
        at = [again.problem.names.index(p.name) for p in parameters]
        change = again.x[at] - np.array([p.nominal for p in parameters])
        covariance = again.covariance[np.ix_(at, at)]
        prior = np.array([p.prior or np.inf for p in parameters])
        # A prior that is exact stands for a fixed value of the kind.
        # Part of its prior up to which a standard deviation is the data's doing.
        loose = np.sqrt(np.diag(covariance)) < 0.5 * prior
        parameters = [p for p, is_loose in zip(parameters, loose, strict=True) if is_loose]
        if not parameters:
            continue
        change, covariance = change[loose], covariance[np.ix_(loose, loose)]
        squared = float(change @ np.linalg.solve(covariance, change))
        # Fewer degrees of freedom only make a change likelier, and take long to count.
        if chdtrc(len(parameters), squared) >= LEVEL:
            continue
        chance = chance_of(squared, len(parameters), freedom_of(again, np.array(at)[loose]))
        if chance < LEVEL:
            values = [p.nominal + step for p, step in zip(parameters, change.tolist(), strict=True)]
            stds = np.sqrt(np.diag(covariance)).tolist()
            yield ContradictedBelief(
                *(tuple(parameters), tuple(values), tuple(stds), believed[parameters[0].name][1]),
                _misled(solution, again),
                chance,
            )


def _misled(solution: Solution, again: Solution) -> tuple[str, float] | None:
    """The parameter that another answer moves most, in its ±; None if none moves by more."""
    moved = {
        name: abs(other.value - estimate.value) / estimate.std
        for name, estimate in solution.estimates.items()
        if estimate.std and (other := again.estimates.get(name)) is not None and other.std
    }
    worst = max(moved, key=lambda name: moved[name], default="")
    # So many of its standard deviations a parameter of many is off by chance.
    beyond_chance = 2.0
    return (worst, moved[worst]) if worst and moved[worst] > beyond_chance else None


def chance_of(squared: float, count: int, freedom: float) -> float:
    """Chance of a change d of ``count`` parameters, by ``dᵀ C⁻¹ d`` and the freedom of C."""
    left = freedom - count + 1.0
    return float(fdtrc(count, left, squared * left / (freedom * count))) if left > 0.0 else 1.0


def freedom_of(solution: Solution, at: IntArray) -> float:
    """Degrees of freedom of the covariance of free parameters (k,); rows are of one sample each."""
    free, problem = solution.free, solution.problem
    curvature = np.diag(problem.prior_precision()[free])
    gains: list[FloatArray] = []
    for term in problem.terms:
        # Of one term's rows, summed by cluster.
        by_cluster = np.zeros((int(term.clusters.max()) + 1, len(free), len(free)))
        for rows in whitened_rows(problem, solution.x, solution.sigmas):
            block = rows.line.view.block
            if not any(block is member for member in term.blocks):
                continue
            n, size = rows.line.residual.shape
            gain = robust_jacobian(rows)[:, free].reshape(n, size, -1)
            cluster = term.clusters[block.samples[:, 0]]
            if n < MANY_EACH * len(by_cluster):
                np.add.at(by_cluster, cluster, np.einsum("ndp,ndq->npq", gain, gain))
                continue
            # The squares of single rows would take more room than all rows do.
            order = np.argsort(cluster, kind="stable")
            for mine in np.split(order, np.flatnonzero(np.diff(cluster[order])) + 1):
                of_one = gain[mine].reshape(len(mine) * size, -1)
                by_cluster[cluster[mine[0]]] += of_one.T @ of_one
        gains.append(by_cluster)
    return wishart_freedom(np.concatenate(gains), curvature, np.searchsorted(free, at))


def wishart_freedom(gain: FloatArray, prior: FloatArray, at: IntArray) -> float:
    """Degrees of freedom of the sandwich of some parameters (k,).

    By the curvature that each cluster contributes (clusters, n, n), and that of priors (n, n).
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
    # A fit leaves a cluster a tenth at least, as where residuals are freed of their leverage.
    left = np.maximum(1.0 - share, 0.1)
    # Covariance of what clusters s and t do to the parameters: δ_st alone_s - shared_s shared_tᵀ.
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
