"""The same cost as one CasADi expression: exact Hessians, and a check on the fast evaluation."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from suta_calib.geometry.symbols import Symbol
from suta_calib.solver.evaluation import BlockView
from suta_calib.solver.kernel import residual_value
from suta_calib.solver.losses import symbolic_huber
from suta_calib.solver.problem import Problem
from suta_calib.terms.block import Pose
from suta_calib.terms.poses import ArmPoses


def symbolic_cost(problem: Problem, x: Symbol, sigmas: Sequence[float]) -> Symbol:
    """½ Σ ρ of all rows as an MX expression of the problem's parameter vector (priors excluded)."""
    rotation, position = _poses(problem, x)
    own_symbols = x[problem.arm_count :]
    cost: Symbol = ca.MX(0)
    for view, sigma in zip(problem.evaluation.views, sigmas, strict=True):
        cost += _block_cost(view, sigma, rotation, position, own_symbols)
    return cost / 2


def _poses(problem: Problem, x: Symbol) -> tuple[Symbol, Symbol]:
    """All tool poses, (9, n) and (3, n)."""
    rotations, positions = [], []
    names = problem.names[: problem.arm_count]
    for term in problem.terms:
        source = term.poses
        if isinstance(source, ArmPoses):
            conditions = source.samples.conditions
            mapped = source.arm.function(names, conditions).map(len(source))
            inputs = [ca.DM(array.T) for array in (source.samples.q, *conditions.values())]
            pose = mapped(x[: problem.arm_count], *inputs)
            rotations.append(pose[0])
            positions.append(pose[1])
        else:
            rotation, position = source.at({})
            flat = np.swapaxes(rotation, 1, 2).reshape(len(source), 9)
            rotations.append(ca.MX(ca.DM(flat.T)))
            positions.append(ca.MX(ca.DM(position.T)))
    return ca.horzcat(*rotations), ca.horzcat(*positions)


def _block_cost(
    view: BlockView, sigma: float, rotation: Symbol, position: Symbol, own_symbols: Symbol
) -> Symbol:
    block = view.block
    n, k = block.samples.shape
    spread = np.hypot(sigma, block.known_sigma)
    row = _row_cost(view, k)
    arguments = []
    for which in range(k):
        columns = (block.samples[:, which] + view.first_sample).tolist()
        arguments += [rotation[:, columns], position[:, columns]]
    m = block.own_columns.shape[1]
    own_rows = (
        ca.reshape(own_symbols[view.own_columns.reshape(-1).tolist()], m, n) if m else ca.MX(0, n)
    )
    threshold = np.minimum(view.threshold / spread, 1e150)
    data = [ca.DM(block.data.T) if block.data.shape[1] else ca.DM(0, n)]
    return ca.sum2(
        row.map(n)(*arguments, own_rows, *data, ca.DM(1 / spread**2).T, ca.DM(threshold).T)
    )


def _row_cost(view: BlockView, poses: int) -> Symbol:
    block = view.block
    rotations = [ca.SX.sym(f"R{i}", 9) for i in range(poses)]
    positions = [ca.SX.sym(f"p{i}", 3) for i in range(poses)]
    own_symbol = ca.SX.sym("own", block.own_columns.shape[1])
    data = ca.SX.sym("data", block.data.shape[1])
    precision, threshold = ca.SX.sym("precision"), ca.SX.sym("threshold")
    pairs = list(zip(rotations, positions, strict=True))
    tools = [Pose(ca.reshape(R, 3, 3), p) for R, p in pairs]
    r = residual_value(block.residual, tools, own_symbol, data, block.size)
    squared = ca.dot(r, r) * precision
    robust = squared if np.isinf(view.threshold) else symbolic_huber(squared, threshold)
    inputs = [s for pair in pairs for s in pair]
    return ca.Function("row_cost", [*inputs, own_symbol, data, precision, threshold], [robust])
