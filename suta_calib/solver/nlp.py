"""The problem of a solver: a robust cost over the scaled free unknowns, within bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.symbols import Symbol
from suta_calib.solver.compiled_residual import residual_value
from suta_calib.solver.descent import Basin, Descent, descend
from suta_calib.solver.evaluation import BlockView
from suta_calib.solver.losses import symbolic_huber
from suta_calib.solver.problem import Problem
from suta_calib.terms.block import Pose
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term

# Whitened costs that differ by less are the same minimum.
SAME_COST = 1e-3


class RobustNlp:
    """min ½ Σ ρ + ½ Σ ((x - nominal)/prior)² over the free entries of x, within bounds.

    A solver works on z (k,): the free entries, each divided by its parameter's scale.

    Args:
        problem: what to minimise.
        free: (k,) which entries of x may move; the others keep their value in the start.
        sigmas: noise level of each block.

    Attributes:
        lower, upper: (k,) bounds of z; infinite where there are none.
        compiled: what a solver has made of the cost; it lives as long as this.
    """

    def __init__(self, problem: Problem, free: IntArray, sigmas: Sequence[float]) -> None:
        self.problem, self.free, self.sigmas = problem, free, list(sigmas)
        self._scale = problem.parameters.array("scale")[free]
        self._bounds = [problem.parameters.array(key)[free] for key in ("lower", "upper")]
        self.lower, self.upper = (bound / self._scale for bound in self._bounds)
        self.compiled: dict[bytes, Any] = {}
        self._precision = problem.prior_precision()
        self._of_free, self._units = np.ix_(free, free), np.outer(self._scale, self._scale)
        self._nominal = problem.parameters.array("nominal")
        self._arm_moves = bool(np.any(free < problem.arm_count))
        self._held = np.delete(np.arange(len(self._nominal)), free)
        self._base = self._nominal.copy()
        self._minima: list[tuple[FloatArray, Basin]] = []

    def begin(self, start: FloatArray) -> FloatArray:
        """The scaled variables of a start (n,), clipped into the bounds; it sets what is held."""
        self._base = start.copy()
        return np.clip(start[self.free] / self._scale, self.lower, self.upper)

    @property
    def held(self) -> FloatArray:
        """Values of what is held."""
        return self._base[self._held]

    def unscaled(self, z: FloatArray) -> FloatArray:
        """(n,) the whole vector with these scaled variables."""
        x = self._base.copy()
        # A bound in its scale and back again may be off by the last digit.
        x[self.free] = np.clip(z * self._scale, *self._bounds)
        return x

    def cost(self, z: FloatArray) -> float:
        """The cost alone."""
        x = self._at(z)
        return self.problem.evaluation.cost(x, self.sigmas) + self._prior_cost(x)

    def cost_gradient_hessian(self, z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Cost, gradient (k,) and Gauss-Newton matrix (k, k) by the scaled variables."""
        x = self._at(z)
        cost, gradient, hessian = self.problem.evaluation.cost_gradient_hessian(
            x, self.sigmas, arm_moves=self._arm_moves
        )
        cost += self._prior_cost(x)
        gradient = (gradient + self._precision * (x - self._nominal))[self.free] * self._scale
        hessian = hessian[self._of_free]
        hessian.flat[:: len(hessian) + 1] += self._precision[self.free]
        return cost, gradient, hessian * self._units

    def residuals(self, z: FloatArray) -> FloatArray:
        """(m,) numbers whose squares, halved and summed, are the cost."""
        return self._least_squares(z)[0]

    def jacobian(self, z: FloatArray) -> FloatArray:
        """(m, k) derivatives of `residuals` by the scaled variables."""
        return self._least_squares(z)[1]

    def descend(self, z: FloatArray, *, settled: float, steps: int, join: bool = False) -> Descent:
        """Gauss-Newton steps from z, as of `descent.descend`.

        It may ``join`` a minimum that an earlier call found, over the same held values, and end
        there early.
        """
        basins = [basin for held, basin in self._minima if np.array_equal(held, self.held)]
        # Of that, what a start may lack that leads to a minimum which another one has found.
        joins = 0.1
        there = descend(
            self.cost_gradient_hessian,
            z,
            (self.lower, self.upper),
            settled=settled,
            steps=steps,
            basins=basins if join else (),
            joins=joins * SAME_COST,
        )
        if join and there.basin is not None:
            self._minima.append((self.held, there.basin))
        return there

    def by_part(self, z: FloatArray) -> FloatArray:
        """Where part of very many samples leads from z (k,); z where there are few, or no way."""
        part = self.problem.part
        if part is None:
            return z
        nlp = RobustNlp(part.problem, self.free, self.sigmas)
        there = descend(nlp.cost_gradient_hessian, nlp.begin(self._at(z)), (self.lower, self.upper))
        return there.z if there.settled else z

    @property
    def in_time(self) -> bool:
        """Whether a clock is among the unknowns."""
        return any(term.of_clock for term in self.problem.terms)

    def symbolic_cost(self, z: Symbol, near: FloatArray) -> Symbol:
        """The cost as a CasADi expression of z; as of `symbolic_cost`, near some (k,)."""
        select = ca.DM(len(self._base), len(self.free))
        for column, row in enumerate(self.free):
            select[int(row), column] = self._scale[column]
        rest = self._base.copy()
        rest[self.free] = 0.0
        x = ca.mtimes(select, z) + ca.DM(rest)
        deviation = x - ca.DM(self._nominal)
        prior = ca.dot(ca.DM(self._precision), deviation**2) / 2
        return symbolic_cost(self.problem, x, self.sigmas, self.unscaled(near)) + prior

    def _at(self, z: FloatArray) -> FloatArray:
        x = self._base.copy()
        x[self.free] = z * self._scale
        return x

    def _prior_cost(self, x: FloatArray) -> float:
        return 0.5 * float(np.sum(self._precision * (x - self._nominal) ** 2))

    def _least_squares(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        x = self._at(z)
        rows, columns = self.problem.evaluation.least_squares(x, self.sigmas)
        with_prior = np.flatnonzero(self._precision[self.free])
        root = np.sqrt(self._precision[self.free[with_prior]])
        prior = np.zeros((len(with_prior), len(self.free)))
        prior[np.arange(len(with_prior)), with_prior] = root * self._scale[with_prior]
        away = root * (x - self._nominal)[self.free[with_prior]]
        jacobian = np.vstack([columns[:, self.free] * self._scale, prior])
        return np.concatenate([rows, away]), jacobian


def symbolic_cost(
    problem: Problem, x: Symbol, sigmas: Sequence[float], near: FloatArray | None = None
) -> Symbol:
    """½ Σ ρ of all rows as an MX expression of the problem's parameter vector (priors excluded).

    Of a moving arm with another clock it is the cost near (n,) parameters: as long as no row moves
    past another one in time.
    """
    near = problem.parameters.array("nominal") if near is None else near
    rotation, position = _poses(problem, x, near)
    own_symbols = x[problem.arm_count :]
    cost: Symbol = ca.MX(0)
    evaluation = problem.evaluation
    for view, known_sigma, sigma in zip(
        evaluation.views, evaluation.known_sigmas, sigmas, strict=True
    ):
        poses = rotation, position
        if isinstance(view.late, ArmPoses):
            poses = _tips(problem, x, view.late, problem.terms[view.source], near)
        cost += _block_cost(view, np.hypot(sigma, known_sigma), *poses, own_symbols)
    return cost / 2


def _poses(problem: Problem, x: Symbol, near: FloatArray) -> tuple[Symbol, Symbol]:
    """All tool poses, (9, n) and (3, n)."""
    rotations, positions = [], []
    for term in problem.terms:
        source = term.poses
        if isinstance(source, ArmPoses):
            rotation, position = _tips(problem, x, source, term, near)
            rotations.append(rotation)
            positions.append(position)
        else:
            rotation, position = source.at({})
            flat = np.swapaxes(rotation, 1, 2).reshape(len(source), 9)
            rotations.append(ca.MX(ca.DM(flat.T)))
            positions.append(ca.MX(ca.DM(position.T)))
    return ca.horzcat(*rotations), ca.horzcat(*positions)


def _tips(
    problem: Problem, x: Symbol, source: ArmPoses, term: Term, near: FloatArray
) -> tuple[Symbol, Symbol]:
    """Poses of one source, (9, n) and (3, n)."""
    conditions = source.conditions
    mapped = source.arm.function(problem.names[: problem.arm_count], conditions).map(len(source))
    inputs = [ca.DM(array.T) for array in (source.samples.q, *conditions.values())]
    if motion := source.samples.motion if term.of_clock else None:
        places = [problem.names.index(p.name) for p in term.of_clock]
        lags = [np.ones(len(source)), np.broadcast_to(source.lag, len(source))]
        pairs = [*zip(places, lags, strict=False)]
        # Exactly, as long as no row passes another one.
        there = motion.beyond(sum(near[place] * lag for place, lag in pairs))
        there[0] += source.samples.q
        after = sum((x[place] - near[place]) * ca.DM(lag).T for place, lag in pairs)
        every = ca.repmat(after, source.samples.q.shape[1], 1)
        inputs[0] = sum(ca.DM(part.T) * every**k for k, part in enumerate(there))
    rotation, position, *_ = mapped(x[: problem.arm_count], *inputs)
    return rotation, position


def _block_cost(
    view: BlockView, spread: FloatArray, rotation: Symbol, position: Symbol, own_symbols: Symbol
) -> Symbol:
    block = view.block
    n, k = block.samples.shape
    row = _row_residual(view, k)
    arguments = []
    for which in range(k):
        of_row = block.samples[:, which] + view.first_sample
        samples = (of_row if view.late is None else np.arange(n)).tolist()
        arguments += [rotation[:, samples], position[:, samples]]
    m = block.own_columns.shape[1]
    columns = view.own_columns[:, :m].reshape(-1).tolist()
    own_rows = ca.reshape(own_symbols[columns], m, n) if m else ca.MX(0, n)
    threshold = np.minimum(view.threshold / spread, 1e150)
    data = [ca.DM(block.data.T) if block.data.shape[1] else ca.DM(0, n)]
    residual = row.map(n)(*arguments, own_rows, *data)
    if block.sample_errors is not None:
        basis, flat = ca.DM(block.sample_errors.basis.tocsc()), ca.vec(residual)
        along = ca.DM(block.sample_errors.excess) * ca.mtimes(basis.T, flat)
        residual = ca.reshape(flat - ca.mtimes(basis, along), block.size, n)
    squared = ca.sum1(residual**2) * ca.DM(1 / spread**2).T
    if np.isinf(view.threshold):
        return ca.sum2(squared)
    return ca.sum2(symbolic_huber(squared, ca.DM(threshold).T))


def _row_residual(view: BlockView, poses: int) -> Symbol:
    block = view.block
    rotations = [ca.SX.sym(f"R{i}", 9) for i in range(poses)]
    positions = [ca.SX.sym(f"p{i}", 3) for i in range(poses)]
    own_symbol = ca.SX.sym("own", block.own_columns.shape[1])
    data = ca.SX.sym("data", block.data.shape[1])
    pairs = list(zip(rotations, positions, strict=True))
    tools = [Pose(ca.reshape(R, 3, 3), p) for R, p in pairs]
    r = residual_value(block.residual, tools, own_symbol, data, block.size)
    inputs = [s for pair in pairs for s in pair]
    return ca.Function("row", [*inputs, own_symbol, data], [r])
