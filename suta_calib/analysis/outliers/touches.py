"""What every single touch is off, once the arm has been given every chance to explain it.

The residual of a touch is a vector of three components. A robust linear fit splits it into what the
arm's whole geometry explains (with the poses of the artefact, the instrument, …), a displacement
common to all touches of one landmark, and the rest: noise, and gross single touches. Landmarks are
given a displacement one at a time, the most significant first, so that none hides behind another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.special import chdtri, fdtrc

from suta_calib.analysis.outliers.answer import Displacement
from suta_calib.analysis.outliers.groups import Grouping
from suta_calib.analysis.outliers.reference import ReferenceFit
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.information import whitened_rows
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term

# Noise of an arm that nobody has (m): in finer errors a solver's last steps show, and nothing else.
SMALLEST: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Touches:
    """The touches of one term."""

    rest: FloatArray  # (n, d) what is left of each residual, m
    # Standard deviation of one component of one touch, m; the part of it that touches of one
    # witness have in common.
    sigma: float
    shared: float
    gross: BoolArray  # (n,) touches far beyond that
    displaced: Mapping[int, Displacement] = field(default_factory=dict)  # landmarks by number


def linearised(
    reference: ReferenceFit, arm: ParameterSet
) -> tuple[Term, tuple[str, ...], RobustLinearFit]:
    """A term of single touches at the job's fit, its unknowns and the arm's, and their fit."""
    vehicle = reference.term.single_touches()
    problem = Problem([vehicle], arm)
    values_of_job = {n: v for n, v in reference.values.items() if n in problem.parameters}
    values = {p.name: p.nominal for p in arm.values()} | values_of_job
    start = problem.start(values)
    x = np.array([values.get(n, float(s)) for n, s in zip(problem.names, start, strict=True)])
    rows = whitened_rows(problem, x, problem.assumed_sigmas())[0]
    jacobian = rows.jacobian * np.repeat(rows.line.sigma, vehicle.blocks[0].size)[:, None]
    deviation = x - problem.parameters.array("nominal")
    residual, precision = rows.line.residual.copy(), problem.prior_precision()
    readings = len(vehicle.poses) / (int(vehicle.poses.rests.max()) + 1)
    fit = RobustLinearFit(jacobian, residual, precision, deviation, readings)
    return vehicle, problem.names, fit


def explained_touches(fit: RobustLinearFit, cells: IntArray, landmarks: Grouping | None) -> Touches:
    """Split every touch into explained, displaced and gross.

    What may explain are the arm's unknowns with their priors, and displaced landmarks. Touches of
    one cell err together (`Term.witnesses`).
    """
    # Probability that data without gross touches lose one, and without displaced landmarks gain
    # one.
    false_alarm = 0.01
    # One landmark after the other is freed for as long as one is significantly displaced.
    member = np.zeros(0, dtype=np.intp) if landmarks is None else landmarks.member
    chosen: list[int] = []
    while True:
        # (n, d, 3 s) derivative of the residuals by the places of the chosen landmarks.
        columns = np.zeros((*fit.residual.shape, 3 * len(chosen)))
        for k, mark in enumerate(chosen):
            columns[member == mark, :, 3 * k : 3 * k + 3] = np.eye(3)
        rest, sigma, shift = fit.solve(columns.reshape(fit.residual.size, -1))
        if landmarks is None:
            break
        # The median residual over the repeats of each touch, and the landmark of each touch.
        _, first, index = np.unique(cells, return_index=True, return_inverse=True)
        means = np.array([np.median(rest[index == k], axis=0) for k in range(len(first))])
        of = member[first]
        spread = max(scatter(means), SMALLEST)
        worst, p = _most_displaced(means, of, spread, len(landmarks), chosen)
        if p * len(landmarks) > false_alarm or len(chosen) >= len(landmarks) // 3:
            break
        chosen.append(worst)
    displaced = {
        mark: Displacement(
            -shift[3 * k : 3 * k + 3], np.full(3, spread / np.sqrt(np.sum(of == mark)))
        )
        for k, mark in enumerate(chosen)
    }
    limit = max(sigma, SMALLEST) * np.sqrt(chdtri(rest.shape[1], false_alarm / len(rest)))
    gross = (np.linalg.norm(rest, axis=1) > limit) & (not fit.saturated)
    return Touches(rest, sigma, _shared(rest, cells, sigma), gross, displaced)


def _most_displaced(
    means: FloatArray, of: IntArray, spread: float, count: int, chosen: list[int]
) -> tuple[int, float]:
    """The landmark whose touches agree best on being elsewhere, and how likely by chance."""
    p = np.ones(count)
    # Variance of a median over that of a mean, for normal numbers.
    median_cost = np.pi / 2
    for landmark in set(range(count)) - set(chosen):
        mine = means[of == landmark]
        squared = float(np.sum(np.median(mine, axis=0) ** 2))
        variance = spread**2 * median_cost / len(mine)
        p[landmark] = fdtrc(3, 1.5 * len(means), squared / variance / 3)
    worst = int(np.argmin(p))
    return worst, float(p[worst])


def _shared(rest: FloatArray, cells: IntArray, sigma: float) -> float:
    """Scatter of one component that the touches of one cell have in common, m."""
    _, index, count = np.unique(cells, return_inverse=True, return_counts=True)
    if not np.any(count > 1):
        return 0.0
    mean = np.zeros((len(count), rest.shape[1]))
    np.add.at(mean, index, rest)
    inside = rest - (mean / count[:, None])[index]
    freed = inside / np.sqrt(1.0 - 1.0 / np.maximum(count, 2))[index, None]
    alone = scatter(freed[count[index] > 1])
    return float(np.sqrt(max(sigma**2 - alone**2, 0.0)))


class RobustLinearFit:
    """Robust linear least squares of residual vectors (n, d), m, with priors.

    The Jacobian is (n d, p); precision of the priors and deviation from their centres are (p,);
    ``readings`` is how many rows there are to a rest, which say what one says.
    """

    def __init__(
        self,
        jacobian: FloatArray,
        residual: FloatArray,
        precision: FloatArray,
        deviation: FloatArray,
        readings: float = 1.0,
    ) -> None:
        self.jacobian, self.residual, self.readings = jacobian, residual, readings
        self.precision, self.deviation = precision, deviation
        # Whether the last fit took up so much that what it leaves is no noise.
        self.saturated = False

    def solve(self, shift: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """Rest (n, d), scatter of one of its components, and the coefficients of ``shift``.

        Args:
            shift: (n d, s) further columns, without priors.
        """
        # Residual, in standard deviations of a component, from which on a touch loses weight:
        # Huber's while the fit settles, then Tukey's, which ignores gross touches altogether.
        tukey = 6.0
        settling = 8
        rounds = 30
        same = 1e-3
        (n, size), extra = self.residual.shape, shift.shape[1]
        a = np.hstack([self.jacobian, shift])
        precision, deviation = (
            np.concatenate([v, np.zeros(extra)]) for v in (self.precision, self.deviation)
        )
        weight, sigma, rest = np.ones(n), scatter(self.residual), self.residual
        step = np.zeros(a.shape[1])
        for k in range(rounds):
            step, used = _weighted_step(a, self.residual, weight / sigma**2, precision, deviation)
            rest = (self.residual.reshape(-1) + a @ step).reshape(n, size)
            used *= self.readings
            freedom = max(n * size - used, 0.1 * n * size)
            # Lengths, m, that are rounding.
            scatter_now = max(scatter(rest) * np.sqrt(n * size / freedom), 1e-9)
            length = np.linalg.norm(rest, axis=1) / scatter_now
            huber = huber_threshold(size)
            if k < settling:
                weight = np.minimum(1.0, huber / np.maximum(length, huber))
            else:
                weight = np.maximum(1.0 - (length / tukey) ** 2, 0.0) ** 2
            if k > settling and abs(scatter_now - sigma) < same * sigma:
                break
            sigma = scatter_now
        # Share of the data that a fit must leave for its scatter to be noise.
        least_left = 0.3
        self.saturated = used > (1.0 - least_left) * n * size
        return rest, sigma, step[a.shape[1] - extra :]


def _weighted_step(
    a: FloatArray,
    rest: FloatArray,
    weight: FloatArray,
    precision: FloatArray,
    deviation: FloatArray,
) -> tuple[FloatArray, float]:
    """Least-squares step, and how many parameters the data have determined by it."""
    weighed = a * np.repeat(weight, rest.shape[1])[:, None]
    data = weighed.T @ a
    scale = np.sqrt(np.maximum(np.diag(data) + precision, 1e-12))
    outer = np.outer(scale, scale)
    inverse = np.linalg.pinv((data + np.diag(precision)) / outer, 1e-12, True) / outer
    gradient = weighed.T @ rest.reshape(-1) + precision * deviation
    return -inverse @ gradient, float(np.sum(inverse * data))


def scatter(vectors: FloatArray) -> float:
    """Standard deviation of one component, from the median length."""
    length = float(np.median(np.linalg.norm(vectors, axis=1)))
    return length / float(np.sqrt(chdtri(vectors.shape[1], 0.5)))
