"""Effect of geometry that a job holds at nominal on an estimate.

Where residuals show it, it goes into how plugs sit (`seating_covariance`); here, where none does.
Points, planes and lines that are touched know no length: the arm's lengths are then as good as the
one that is held. With h the held parameters, known to T by the drawing, and x what is estimated,

    dx̂/dh = -A_xx⁻¹ A_xh
    I = A_hh - A_hx A_xx⁻¹ A_xh                information of the data on h, x following

A direction of h about which the data say less than the drawing (an eigenvalue of I in units of T
below a tenth) leaves no residual. Its error δ is in the estimate, as -A_xx⁻¹ A_xh δ, and in what
is held, as δ. Where these two cancel at the tip it is a convention, and adds nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry.numbers import skew
from suta_calib.measurements.scale import GRADES
from suta_calib.model.parameters import OFFSET, POSITION, ROTATION
from suta_calib.solver.fitted import Fitted
from suta_calib.solver.information import curvature_at, noise_levels, scaled_inverse
from suta_calib.terms.seating import is_seating
from suta_calib.units import from_deg, from_mm

# Of one dimension, beside the common factor of the grade, as a standard deviation: a length in m
# and an angle in rad. Machined: ISO 2768-f has limits of 0.05 mm for short lengths and of 0.1 mm
# over 100 mm for angles. Printed: a layer, and a few tenths of a degree of warp.
TOLERANCES: Final = {
    "certified": (from_mm(0.005), from_deg(0.005)),
    "machined": (from_mm(0.05), from_deg(0.03)),
    "printed": (from_mm(0.2), from_deg(0.2)),
}


@dataclass(frozen=True, eq=False)
class HeldGeometry:
    """Errors, by one standard deviation, of held geometry that neither data nor tip are blind to.

    Attributes:
        names: (m,) the held parameters.
        nominal: (m,) their values, m and rad.
        tolerance: (m,) standard deviation of each by the drawing.
        of_estimate: (n, k) error of the estimate by each of k silent directions.
        of_held: (m, k) error of the held values by them.
        tip: (k,) motion of the tip by each, beside one of the whole arm: m, root mean square over
            the samples.
        tip_beside: the same, (), by what is estimated, if all that is held is right.
    """

    names: tuple[str, ...]
    nominal: FloatArray
    tolerance: FloatArray
    of_estimate: FloatArray
    of_held: FloatArray
    tip: FloatArray
    tip_beside: float

    @property
    def carriers(self) -> tuple[str, ...]:
        """Held parameters with the largest effect on the tip, for the worst direction."""
        share = np.abs(self.of_held[:, int(np.argmax(self.tip))]) / self.tolerance
        # Part of the largest from which on a held parameter is named.
        return tuple(self.names[k] for k in np.argsort(-share) if share[k] > 0.5 * share.max())

    @property
    def is_scale(self) -> bool:
        """Whether a direction that moves the tip makes all held lengths longer by one factor."""
        lengths = np.array([n.rpartition(".")[2] in POSITION for n in self.names])
        length = np.where(lengths, self.nominal, 0.0) / self.tolerance
        along = np.abs(length @ (self.of_held / self.tolerance[:, None]))
        sizes = np.linalg.norm(self.of_held / self.tolerance[:, None], axis=0)
        # Cosine, in units of the tolerances, from which on a direction is a factor on all lengths:
        # two that do the same, such as a slide of a joint along its axis, share it and have 0.7.
        return bool(np.any(along > 0.5 * sizes * max(float(np.linalg.norm(length)), 1e-300)))

    @property
    def matters(self) -> bool:
        """Whether its effect on the tip is larger than that of noise."""
        # Of the tip's standard deviation by noise: then the whole is larger by a twentieth.
        return float(np.linalg.norm(self.tip)) > 0.3 * self.tip_beside


def held_geometry(fit: Fitted, within: FloatArray, *, robust: bool = True) -> HeldGeometry | None:
    """The held geometry of an arm, and what it does where no residual shows it; None if nothing.

    ``within`` (n, n) is the covariance of the estimate if all that is held is right. Before the fit
    no row is believed less than others (``robust``), as in `predicted_information`.
    """
    arm, free, given = fit.problem.arm, fit.free, fit.problem.arm_parameters
    if arm is None or not len(free):
        return None
    names = [
        name
        for name in arm.parameters.names
        if (name in arm.geometric or name in arm.offsets)
        and (name not in given or not given[name].free)
    ]
    if not names:
        return None
    wider, held = fit.wider([arm.offered[name] for name in names])
    at, estimated = wider.x, wider.free
    curvature = curvature_at(wider.problem, at, fit.sigmas, robust=robust)
    precision = fit.problem.stated_precision()[free]
    inverse = scaled_inverse(curvature[np.ix_(estimated, estimated)] + np.diag(precision))
    follow = -inverse @ curvature[np.ix_(estimated, held)]
    # What the data tell hangs on the noise that they have, not on the one that weighs them.
    if robust:
        levels = noise_levels(wider.problem, at, fit.sigmas)
        curvature = curvature_at(wider.problem, at, levels, robust=True)
    both = np.concatenate([estimated, held])
    moves = np.vstack([follow, np.eye(len(held))])
    information = moves.T @ curvature[np.ix_(both, both)] @ moves
    nominal = at[held]
    spread = drawing_covariance(fit, within, names, nominal)
    root = np.linalg.cholesky(spread)
    values_of, directions = np.linalg.eigh(root.T @ information @ root)
    silent = root @ directions[:, values_of < 0.1]
    if not silent.shape[1]:
        return None
    followed = follow @ silent
    variances, axes = np.linalg.eigh(within[np.ix_(free, free)])
    noise = axes * np.sqrt(np.maximum(variances, 0.0))
    beside = registered_motion(wider, held, noise, np.zeros((len(held), len(free))))
    motion = registered_motion(wider, held, followed, silent)
    _, sizes, mixed = np.linalg.svd(motion, full_matrices=False)
    tip = sizes / math.sqrt(len(motion) / 3)
    # Motion of the tip, m, that no arm shows.
    moving = tip > 1e-6
    if not moving.any():
        return None
    mix = mixed[moving].T
    of_estimate = np.zeros((len(fit.x), int(moving.sum())))
    of_estimate[free] = -followed @ mix
    of_held = -silent @ mix
    # Part of a held parameter in a direction, m or rad, that is rounding.
    part = np.abs(of_held).max(axis=1) > 1e-9
    return HeldGeometry(
        tuple(name for name, taken in zip(names, part, strict=True) if taken),
        nominal[part],
        np.sqrt(np.diag(spread))[part],
        of_estimate,
        of_held[part],
        tip[moving],
        math.sqrt(3.0) * float(np.linalg.norm(beside)) / math.sqrt(len(beside)),
    )


def drawing_covariance(
    fit: Fitted, within: FloatArray, names: list[str], nominal: FloatArray
) -> FloatArray:
    """(m, m) covariance of the held parameters by the drawing, with a common factor on lengths.

    The arm's grade says it. Where nobody states one, held dimensions are as far off as the
    estimated ones of their sort turned out to be, for they stand in the same drawing, but no better
    than machined ones.
    """
    arm = fit.problem.arm
    assert arm is not None
    covariance = np.zeros((len(names), len(names)))
    held = [(arm.maker(p.owner), p.key) for name in names for p in [arm.offered[name]]]
    # Each robot of a cell has a drawing of its own.
    for robot, stated in arm.grades.items():
        # Of an arm of which nobody says it, at least: what is estimated may show that it is worse.
        grade = stated or "machined"
        length, angle = TOLERANCES[grade]
        for keys, least in ((POSITION, length), (ROTATION, angle), ((OFFSET,), angle)):
            std = least if stated else max(least, _departures(fit, within, keys, robot))
            for k, (maker, key) in enumerate(held):
                if maker == robot and key in keys:
                    covariance[k, k] = std**2
        of_robot = [maker == robot and key in POSITION for maker, key in held]
        common = GRADES[grade] * np.where(of_robot, nominal, 0.0)
        covariance += np.outer(common, common)
    return covariance


def _departures(fit: Fitted, within: FloatArray, keys: tuple[str, ...], robot: str) -> float:
    """Root mean square by which estimated parameters of a sort are off nominal beyond noise."""
    variance, squares, arm = np.diag(within), list[float](), fit.problem.arm
    assert arm is not None
    for k, p in enumerate(fit.problem.arm_parameters.values()):
        if p.free and p.key in keys and arm.maker(p.owner) == robot and variance[k] > 0:
            squares.append((float(fit.x[k]) - p.nominal) ** 2 - float(variance[k]))
    return math.sqrt(max(float(np.mean(squares)), 0.0)) if squares else 0.0


def registered_motion(
    fit: Fitted, held: IntArray, followed: FloatArray, silent: FloatArray
) -> FloatArray:
    """(3 s, k) motion of the tip at some samples by each direction, less that of the whole arm."""
    table, estimated = fit.problem.evaluation.table, fit.free
    n = len(table.position)
    # Samples at which it is looked at.
    rows: IntArray = np.unique(np.linspace(0, n - 1, min(n, 500)).astype(np.intp))
    velocity = table.velocity.reshape(n, 6, -1)[rows, :3]
    of_arm: BoolArray = estimated < fit.problem.arm_count
    moved = velocity[:, :, estimated[of_arm]] @ followed[of_arm] + velocity[:, :, held] @ silent
    position = table.position[rows]
    centred = position - position.mean(axis=0)
    rigid = np.concatenate([np.tile(np.eye(3), (len(rows), 1, 1)), -skew(centred)], axis=2)
    design, flat = rigid.reshape(-1, 6), moved.reshape(3 * len(rows), -1)
    return np.asarray(flat - design @ np.linalg.lstsq(design, flat, rcond=1e-9)[0])


def seating_covariance(fit: Fitted) -> FloatArray:
    """(n, n) what the held geometry adds to how plugs sit, as far as residuals show it.

    A plug that always sits x off its socket's axis shifts every touch as a tip, or a last link,
    that is off its drawing does: its error goes into the seating, whose scatter from touch to touch
    says nothing of it. How large these errors are the residuals tell: with G the derivatives by
    what is held, in units of typical errors, the whitened residuals have the covariance

        σ² M (I + λ G Gᵀ) M,   M what is left of them once the unknowns are fitted

    and σ² and λ are where its restricted likelihood is largest (Patterson and Thompson 1971, REML).
    The seating then has the covariance λσ² B Bᵀ more, with B = A⁻¹ Jᵀ G.
    """
    nothing, problem, free = np.zeros((len(fit.x),) * 2), fit.problem, fit.free
    seating = [k for k in free if is_seating(problem.parameters[problem.names[k]])]
    if not seating or problem.arm is None:
        return nothing
    estimated = {problem.names[k] for k in free}
    held = [p for p in problem.arm.select("geometric").values() if p.name not in estimated]
    wider, column = fit.wider(held)
    rows = wider.rows()
    # Of a robust fit as its last step of reweighted least squares has them.
    weight = np.concatenate(
        [np.repeat(np.sqrt(r.line.weight), r.line.residual.shape[1]) for r in rows]
    )
    jacobian = np.concatenate([r.jacobian for r in rows]) * weight[:, None]
    residual = weight * np.concatenate(
        [(r.line.residual / r.line.sigma[:, None]).ravel() for r in rows]
    )
    fitted = jacobian[:, wider.free]
    # Errors of machined arms beside each other, lengths and angles: what docs and shipped jobs give
    # as prior. Only their ratio counts.
    typical = {"m": 1e-3, "rad": from_deg(0.1)}
    effect = jacobian[:, column] * np.array([typical[p.unit] for p in held])
    prior = np.diag(problem.stated_precision())[np.ix_(free, free)]
    # (free, held): what a typical error of each does to the unknowns.
    shift = scaled_inverse(fitted.T @ fitted + prior) @ (fitted.T @ effect)
    size = held_size(residual, effect - fitted @ shift, len(free))
    places = [int(np.flatnonzero(free == k)[0]) for k in seating]
    nothing[np.ix_(seating, seating)] = size * shift[places] @ shift[places].T
    return nothing


def held_size(residual: FloatArray, left: FloatArray, fitted: int) -> float:
    """λσ², the variance of the held geometry's errors in units of typical ones; 0 for none.

    The residual (m,) is whitened; ``left`` (m, k) is what the held geometry leaves in it once the
    unknowns, so many, are ``fitted``.
    """
    # Candidates for λ, from what no data show to errors a thousand times as large as typical ones.
    ratios = np.geomspace(1e-8, 1e6, 141)
    basis, singular, _ = np.linalg.svd(left, full_matrices=False)
    # A direction of what is held that the unknowns take up wholly leaves nothing in the residuals.
    shown = singular > 1e-9 * max(float(singular.max(initial=0.0)), 1e-300)
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

    costs = np.array([twice_cost(ratio) for ratio in ratios])
    best = int(np.argmin(costs))
    # Twice the gain in likelihood that chance exceeds once in a hundred where nothing is lacking: λ
    # is at its bound 0, so it is half a chi-squared of one degree of freedom.
    significant = 5.41
    if twice_cost(0.0) - costs[best] < significant:
        return 0.0
    return float(ratios[best] * noise(float(ratios[best])))
