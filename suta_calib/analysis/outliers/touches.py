"""What every single touch is off, once the arm has been given every chance to explain it.

The residual of a touch is a vector of three components. A robust linear fit splits it into what the
arm's whole geometry explains (with the poses of the artefact, the instrument, …), a displacement
common to all touches of one landmark, and the rest: noise, and gross single touches. Landmarks are
given a displacement one at a time, the most significant first, so that none hides behind another.

Whether an instrument, an artefact or a point was moved while its rows were taken is asked beside
the same fit: the rows of one pose are given another pose from some row on, as an `Effect` in
stretches of rows that Huber's rule weighs (`trust.evidence`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.special import chdtri, fdtrc

from suta_calib.analysis.outliers.reference import Grouping, ReferenceFit
from suta_calib.analysis.outliers.result import Displacement, Move, Thresholds
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.information import whitened_rows
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.trust.evidence import Effect, Stretches, weigh_effects
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.trust.repeats import about_mean

# Noise of an arm that nobody has (m): in finer errors a solver's last steps show, and nothing else.
SMALLEST: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Touches:
    """The touches of one term."""

    rest: FloatArray  # (n, d) what is left of each residual, m
    # Standard deviation of one component of one touch, m; the part of it that touches of one
    # cluster have in common.
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
    one cell err together (`Term.clusters`).
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
    freed = about_mean(rest, index, count) / np.sqrt(1.0 - 1.0 / np.maximum(count, 2))[index, None]
    alone = scatter(freed[count[index] > 1])
    return float(np.sqrt(max(sigma**2 - alone**2, 0.0)))


@dataclass(eq=False)
class RobustLinearFit:
    """Robust linear least squares of residual vectors, with priors."""

    jacobian: FloatArray  # (n d, p)
    residual: FloatArray  # (n, d), m
    precision: FloatArray  # (p,) of the priors
    deviation: FloatArray  # (p,) from their centres
    readings: float = 1.0  # how many rows there are to a rest, which say what one says
    saturated: bool = False  # whether the last fit took up so much that what it leaves is no noise

    def solve(self, shift: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """Rest (n, d), scatter of one of its components, and the coefficients of ``shift``.

        That is (n d, s) further columns, without priors.
        """
        # Residual, in standard deviations of a component, from which on a touch loses weight:
        # Huber's while the fit settles, then Tukey's, which ignores gross touches altogether.
        tukey = 6.0
        settling = 8
        rounds = 30
        same = 1e-3
        (n, size), extra = self.residual.shape, np.zeros(shift.shape[1])
        a = np.hstack([self.jacobian, shift])
        precision, deviation = (np.append(v, extra) for v in (self.precision, self.deviation))
        weight, sigma = np.ones(n), scatter(self.residual)
        for k in range(rounds):
            weights = np.repeat(weight / sigma**2, size)
            fit = LinearFit(a, self.residual.reshape(-1), precision, deviation, weights)
            rest, used = fit.settled.reshape(n, size), fit.spent * self.readings
            freedom = max(n * size - used, 0.1 * n * size)
            # Lengths, m, that are rounding.
            scatter_now = max(scatter(rest) * np.sqrt(n * size / freedom), 1e-9)
            length = np.linalg.norm(rest, axis=1) / scatter_now
            if k < settling:
                weight = huber_weights(length, size)
            else:
                weight = np.maximum(1.0 - (length / tukey) ** 2, 0.0) ** 2
            if k > settling and abs(scatter_now - sigma) < same * sigma:
                break
            sigma = scatter_now
        # Share of the data that a fit must leave for its scatter to be noise.
        least_left = 0.3
        self.saturated = used > (1.0 - least_left) * n * size
        return rest, sigma, fit.step[self.jacobian.shape[1] :]


def huber_weights(length: FloatArray, size: int) -> FloatArray:
    """(n,) of residuals of ``size`` components by their length in standard deviations of one."""
    huber = huber_threshold(size)
    return np.minimum(1.0, huber / np.maximum(length, huber))


def scatter(vectors: FloatArray) -> float:
    """Standard deviation of one component, from the median length."""
    length = float(np.median(np.linalg.norm(vectors, axis=1)))
    return length / float(np.sqrt(chdtri(vectors.shape[1], 0.5)))


def find_moves(
    term: Term, names: Sequence[str], fit: RobustLinearFit, thresholds: Thresholds
) -> tuple[Move, ...]:
    """The most significant change of every pose that changed.

    ``names`` are of the columns of the linear fit of single touches, with nothing moved; the
    thresholds say how far a move must take its rows, and how unlikely it must be by chance.
    """
    n, size = fit.residual.shape
    rest, sigma, _ = fit.solve(np.zeros((n * size, 0)))
    linear = LinearFit(
        fit.jacobian / sigma,
        fit.residual.reshape(-1) / sigma,
        fit.precision,
        fit.deviation,
        np.repeat(huber_weights(np.linalg.norm(rest, axis=1) / sigma, size), size),
    )
    moves, shifts = [], np.zeros((n * size, 0))
    for what, rows, columns in _poses(term, names):
        # Rows on either side of a change, beside those that its pose needs.
        least = -(-len(columns) // size) + 3
        starts = range(least, len(rows) - least + 1)
        if len(rows) < 2 * least:
            continue
        order = np.full(n, -1, dtype=np.intp)
        order[rows] = np.arange(len(rows))
        places = np.array([(start, len(rows)) for start in starts], dtype=np.intp)
        windows = Stretches(np.repeat(order, size), places)
        by_pose = fit.jacobian[:, columns]
        for evidence in weigh_effects(linear, [Effect(what, by_pose / sigma, windows=windows)]):
            if evidence.window is None or evidence.p_value > thresholds.significance:
                continue
            shift = by_pose * windows[evidence.window][:, None]
            first = starts[evidence.window]
            moved = (shift @ fit.solve(shift)[2]).reshape(n, size)[rows[first:]]
            distance = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
            if distance > thresholds.bias:
                shifts = np.hstack([shifts, shift])
                # Probabilities below are as good as zero, and no more exact.
                p, left = max(evidence.p_value, 1e-12), fit.solve(shifts)[1]
                moves.append(Move(what, term.poses.samples.origin[rows[first]], distance, p, left))
    return tuple(moves)


def _poses(term: Term, names: Sequence[str]) -> Iterator[tuple[str, IntArray, list[int]]]:
    """What may have been moved, its rows in their order, and the columns of where it stands."""
    noun, unknown = (term.place, term.place_unknown) if term.place else (term.mark, term.mark)
    if term.medium != "touch":
        unknowns = [
            p.name for p in term.own_parameters if not (noun and p.owner.startswith(f"{noun}["))
        ]
        yield f"the {term.medium}", np.arange(len(term.poses)), [names.index(n) for n in unknowns]
    labels = term.poses.samples.labels.get(noun)
    for label in () if labels is None else dict.fromkeys(labels.tolist()):
        start = f"{unknown}[{label}]"
        columns = [k for k, name in enumerate(names) if name.startswith(start)]
        if columns:
            yield f"{noun} {label}", np.flatnonzero(labels == label), columns
