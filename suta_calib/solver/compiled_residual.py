"""The residual of one kind of row and its derivatives, compiled once and evaluated on all rows.

The derivative of a residual with respect to the unknown geometry is the product of two parts: how
it changes when a tool pose moves (here, from the author's residual), and how the tool pose moves
with each parameter (the forward kinematics). Only the first depends on the kind of term.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy import sparse

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.batched import MANY, Batched
from suta_calib.errors import SamplesError
from suta_calib.geometry.symbols import Symbol
from suta_calib.terms.block import Block, Pose, Residual, flat
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.terms.term import Term


class RowPattern:
    """Where the derivatives of a block's rows belong: built once, filled at every evaluation.

    Attributes:
        angular: (c,) which of the pose velocities are turns.
    """

    def __init__(
        self,
        block: Block,
        pose_columns: IntArray,
        own_columns: IntArray,
        velocity_rows: int,
        own_count: int,
    ) -> None:
        self.angular = pose_columns[:1].reshape(-1) % 6 >= 3
        self._poses = _sparse(pose_columns, block.size, velocity_rows)
        self._own: Any = None
        self._places: IntArray | None = None
        rows, looked_at = len(block) * block.size, own_columns.shape[1]
        # Rows that all look at all parameters, in their order, are the matrix as they are.
        self._whole = looked_at == own_count and bool(np.all(own_columns == np.arange(own_count)))
        if self._whole:
            return
        # A row that looks at one parameter twice needs the sum that a sparse matrix makes.
        once = bool(np.all(np.diff(np.sort(own_columns, axis=1), axis=1)))
        # Multiplications of a normal matrix up to which an array makes it faster.
        if looked_at and once and rows * own_count**2 <= 6_000_000:
            self._own = np.zeros((rows, own_count))
            columns = np.repeat(own_columns, block.size, axis=0)
            self._places = (np.arange(rows)[:, None] * own_count + columns).reshape(-1)
        elif looked_at:
            self._own = _sparse(own_columns, block.size, own_count)

    def by_velocity(self, by_pose: FloatArray) -> Any:
        """Derivatives (n, d, c) as a sparse matrix (n·d, 6·samples), reused by every call."""
        self._poses.data[:] = by_pose.reshape(-1)
        return self._poses

    def by_parameters(
        self, by_pose: FloatArray, velocity: FloatArray, rows: slice | None = None
    ) -> FloatArray:
        """Derivatives (k·d, p) by what moves the poses, of some rows, or of all.

        From derivatives (n, d, c) and velocities (6·samples, p).
        """
        chosen = by_pose if rows is None else by_pose[rows]
        if rows is None or len(chosen) == len(by_pose):
            return np.asarray(self.by_velocity(by_pose) @ velocity)
        first = rows.start * by_pose[0].size
        flat = slice(first, first + chosen.size)
        count, pattern = len(chosen) * by_pose.shape[1], self._poses
        # All rows have as many entries, so that each part's pointers are those of the first.
        parts = chosen.reshape(-1), pattern.indices[flat], pattern.indptr[: count + 1]
        matrix = sparse.csr_array(parts, shape=(count, pattern.shape[1]))
        return np.asarray(matrix @ velocity)

    def summed(self, by_pose: FloatArray, rows: FloatArray) -> FloatArray:
        """For each velocity the sum (6·samples, p) of rows (n·d, p), times their change with it."""
        return np.asarray(self.by_velocity(by_pose).T @ rows)

    def by_own(self, by_own: FloatArray) -> Any:
        """Derivatives (n, d, m) as a matrix (n·d, own), or None; reused likewise.

        An array where that is faster, and else a sparse matrix: `dense` makes both an array.
        """
        if self._whole and by_own.size:
            return by_own.reshape(-1, by_own.shape[2])
        if self._places is not None:
            self._own.reshape(-1)[self._places] = by_own.reshape(-1)
        elif self._own is not None:
            self._own.data[:] = by_own.reshape(-1)
        return self._own


def dense(matrix: Any) -> FloatArray:
    """An array, of a sparse matrix or of an array."""
    return matrix if isinstance(matrix, np.ndarray) else np.asarray(matrix.toarray())


class Kernel:
    """All rows of one block.

    Args:
        block: the rows.
        first_sample: where the block's samples begin among all samples.
        own_columns: (n, m) which of all own parameters each row looks at.
        velocity_rows: six times the number of all samples.
        own_count: number of all own parameters.
        clocks: how many of the last own columns are not the residual's but move poses in time: the
            time offset, and what is multiplied by the rows' lag.

    Attributes:
        pattern: where the rows' derivatives belong in the whole Jacobian.
        of_arm: where the derivatives by what moves each row's pose belong: of rows with a lag, each
            has a pose of its own.
        known_sigma: (n,) standard deviation of rows that is known beforehand.
    """

    def __init__(
        self,
        block: Block,
        first_sample: int,
        own_columns: IntArray,
        velocity_rows: int,
        own_count: int,
        *,
        clocks: int = 0,
    ) -> None:
        n, poses = block.samples.shape
        all_columns = own_columns
        own_columns = own_columns[:, : own_columns.shape[1] - clocks]
        # What every row looks at alike is computed once for all of them.
        same_own = bool(n) and bool(np.all(own_columns == own_columns[0]))
        self._own = own_columns[0] if same_own else own_columns
        function, columns, used, ahead = _compiled(
            block.residual,
            poses,
            block.own_columns.shape[1],
            block.data.shape[1],
            block.size,
            n >= MANY,
            same_own and n < MANY,
        )
        of_samples = block.samples + first_sample
        self._lag = block.lag
        samples = of_samples if block.lag is None else np.arange(n)[:, None]
        # Of each input the array it comes from, and which of its rows.
        self._taken = [(place % 2, _rows(samples[:, place // 2])) for place in used]
        # The last inputs are what is made of own parameters, if anything is, they, and the data.
        last = function.n_in()
        shared = ([last - 2] if same_own else []) + ([last - 3] if ahead is not None else [])
        self._batch = Batched(function, n, shared)
        self._ahead = None if ahead is None else Batched(ahead, 1, [0])
        self._batch.inputs[-1][:] = block.data
        self._shape = (n, block.size, len(columns))
        self.known_sigma, self._spread = block.known_sigma, (math.nan, block.known_sigma)
        which, component = np.divmod(columns, 6)
        pose_columns = 6 * of_samples[:, which] + component
        self.pattern = RowPattern(block, pose_columns, all_columns, velocity_rows, own_count)
        self.of_arm, moved = self.pattern, pose_columns
        if block.lag is not None:
            moved = 6 * samples[:, which] + component
            self.of_arm = RowPattern(block, moved, all_columns, 6 * n, own_count)
        self._in_time = moved if clocks else None

    def add_uncertainty(self, by_pose: FloatArray, uncertainty: FloatArray) -> None:
        """Add to what is known of the rows' noise that of their poses (6·samples,), m and rad."""
        if self._in_time is not None:
            of_poses = (by_pose * uncertainty[self._in_time][:, None]) ** 2
            of_rows = np.sqrt(of_poses.sum(axis=2).mean(axis=1))
            self.known_sigma = np.hypot(self.known_sigma, of_rows)
            self._spread = math.nan, self.known_sigma

    def spread(self, sigma: float) -> FloatArray:
        """(n,) standard deviation of one component of each row, for a noise level; read only."""
        # A descent asks for the same one at every step.
        if self._spread[0] != sigma:
            self._spread = sigma, np.hypot(sigma, self.known_sigma)
        return self._spread[1]

    def __call__(
        self,
        rotation: FloatArray,
        position: FloatArray,
        own_values: FloatArray,
        rate: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residuals (n, d), derivatives by pose velocities (n, d, c) and own parameters (n, d, m).

        Of rotations (samples, 9), column by column, positions (samples, 3), m, all own parameters,
        and how the poses move in time (6·samples,), m/s and rad/s. They are views of arrays that
        the next call overwrites.
        """
        residual, by_pose, by_own = self._at(rotation, position, own_values)
        if self._in_time is None:
            return residual, by_pose, by_own
        by_time = np.einsum("ndc,nc->nd", by_pose, rate[self._in_time])
        by_clock = [by_time] if self._lag is None else [by_time, by_time * self._lag[:, None]]
        return residual, by_pose, np.concatenate([by_own, np.stack(by_clock, axis=2)], axis=2)

    def _at(
        self, rotation: FloatArray, position: FloatArray, own_values: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        n, size, width = self._shape
        for slot, (part, rows) in zip(self._batch.inputs, self._taken, strict=False):
            _take(position if part else rotation, rows, slot)
        self._batch.inputs[-2][:] = own_values[self._own]
        looked_at = self._own.shape[-1]
        if self._ahead is None:
            residual, by_pose, by_own = self._batch()
            return residual, by_pose.reshape(n, size, width), by_own.reshape(n, size, looked_at)
        self._ahead.inputs[0][:] = own_values[self._own]
        made, change = self._ahead()
        self._batch.inputs[-3][:] = made[0]
        residual, by_pose, by_own, by_made = self._batch()
        chained = by_made.reshape(n * size, -1) @ change.reshape(-1, looked_at)
        chained += by_own.reshape(n * size, looked_at)
        return residual, by_pose.reshape(n, size, width), chained.reshape(n, size, looked_at)


def _rows(numbers: IntArray) -> slice | IntArray:
    """Index that selects rows of these numbers (n,); a slice where they are contiguous."""
    first = int(numbers[0]) if len(numbers) else 0
    follow = np.array_equal(numbers, np.arange(first, first + len(numbers)))
    return slice(first, first + len(numbers)) if follow else numbers


def _take(source: FloatArray, rows: slice | IntArray, out: FloatArray) -> None:
    """Rows of ``source``, by `_rows`; every number is one of its rows."""
    if isinstance(rows, slice):
        out[:] = source[rows]
    else:
        # To raise an error NumPy would have to write elsewhere first, which takes as long again.
        np.take(source, rows, axis=0, out=out, mode="clip")


class _BlockResiduals:
    """Residuals (n, d) of a block's rows, m or rad, without derivatives: a tenth of the work."""

    def __init__(self, block: Block) -> None:
        function, used = _residual(
            block.residual,
            block.samples.shape[1],
            block.own_columns.shape[1],
            block.data.shape[1],
            block.size,
            len(block) >= MANY,
        )
        samples = block.samples if block.lag is None else np.arange(len(block))[:, None]
        self._taken = [(place % 2, _rows(samples[:, place // 2])) for place in used]
        self._own, self._batch = block.own_columns, Batched(function, len(block))
        self._batch.inputs[-1][:] = block.data

    def __call__(
        self, rotation: FloatArray, position: FloatArray, own_values: FloatArray
    ) -> FloatArray:
        """At poses and own parameters as `Kernel` takes them; the next call overwrites it."""
        *poses, of_own, _ = self._batch.inputs
        for slot, (part, rows) in zip(poses, self._taken, strict=True):
            _take(position if part else rotation, rows, slot)
        of_own[:] = own_values[self._own]
        return self._batch()[0]


def term_residuals(term: Term, values: Mapping[str, float]) -> tuple[FloatArray, ...]:
    """Residuals (n, d) of every block of a term, m or rad, without derivatives.

    Parameters are by name, m or rad; the arm's are nominal where none is given.
    """
    own_values = np.array([values[p.name] for p in term.own_parameters])
    residuals = []
    for block in term.blocks:
        rotation, position = term.poses_of(block).at(values)
        residuals.append(_BlockResiduals(block)(flat(rotation), position, own_values))
    return tuple(residuals)


class TermErrors:
    """Residuals of every row of a term, evaluated repeatedly, without derivatives.

    Args:
        term: what is looked at.
        names: of the arm's parameters that change; the others are nominal.
    """

    def __init__(self, term: Term, names: Sequence[str]) -> None:
        self._own = tuple(p.name for p in term.own_parameters)
        common = _Tips(term.poses, names)
        self._blocks = [
            (
                *(block.relative, _BlockResiduals(block), block.samples[:, 0]),
                common if block.lag is None else _Tips(term.poses_of(block), names),
            )
            for block in term.blocks
        ]

    def __call__(
        self, values: Mapping[str, float], shifts: FloatArray | float = 0.0
    ) -> list[FloatArray]:
        """Residuals (n, d) of every block as they were measured, m or rad.

        Args:
            values: by name, m or rad.
            shifts: (samples, joints) of the arm's readings, rad or m.
        """
        own_values = np.array([values[name] for name in self._own])
        by_tips = dict[_Tips, tuple[FloatArray, FloatArray]]()
        residuals = list[FloatArray]()
        for relative, residual, rows, tips in self._blocks:
            if tips not in by_tips:
                moved = np.asarray(shifts)
                by_tips[tips] = tips(values, moved[rows] if tips.late and moved.ndim else moved)
            residuals.append(relative * residual(*by_tips[tips], own_values))
        return residuals


class _Tips:
    """Poses of a source, evaluated repeatedly, without derivatives."""

    def __init__(self, source: PoseSource, names: Sequence[str]) -> None:
        self._names, self._batch, self._source = tuple(names), None, source
        self.late = bool(source.delay)
        if isinstance(source, ArmPoses):
            conditions = source.conditions
            self._batch = Batched(source.arm.function(names, conditions, 0), len(source), [0])
            for place, numbers in zip(self._batch.inputs[2:], conditions.values(), strict=True):
                place[:] = numbers
        else:
            rotation, position = source.at({})
            self._poses = flat(rotation), position

    def __call__(
        self, values: Mapping[str, float], shifts: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Rotations (n, 9), column by column, and positions (n, 3); the next call overwrites it."""
        if self._batch is not None and isinstance(self._source, ArmPoses):
            self._batch.inputs[0][:] = [values[name] for name in self._names]
            np.add(self._source.readings(values), shifts, out=self._batch.inputs[1])
            rotation, position, _ = self._batch()
            self._poses = rotation, position
        return self._poses


@lru_cache(maxsize=64)
def _compiled(
    residual: Residual, poses: int, own_count: int, data: int, size: int, many: bool, separate: bool
) -> tuple[Any, IntArray, tuple[int, ...], Any]:
    """CasADi function (R₁, p₁, …, own, data) → residual, pose derivative, own derivative.

    Common parts are sought for ``many`` rows only: that takes long. Where it is taken ``separate``,
    what is made of own parameters alone, such as a rotation matrix, is an input before them, the
    last output is the derivative by that, and the last answer the function that makes it. The third
    answer says which of R₁, p₁, R₂, … are looked at, and are inputs. Derivatives are transposed:
    CasADi's column order is row order per component.
    """
    rotations = [ca.SX.sym(f"R{k}", 3, 3) for k in range(poses)]
    positions = [ca.SX.sym(f"p{k}", 3) for k in range(poses)]
    own_symbol, data_symbol = ca.SX.sym("own", own_count), ca.SX.sym("data", data)
    velocity = ca.SX.sym("velocity", 6 * poses)
    moved = [
        Pose(R + ca.skew(velocity[6 * k + 3 : 6 * k + 6]) @ R, p + velocity[6 * k : 6 * k + 3])
        for k, (R, p) in enumerate(zip(rotations, positions, strict=True))
    ]
    value = residual_value(residual, moved, own_symbol, data_symbol, size)
    first, ahead = list[Symbol](), None
    # Of no parameters nothing is made.
    made, of_own, rest = _made_of(value, own_symbol if separate else ca.SX.sym("none", 0))
    if made is None:
        derivatives = [ca.jacobian(value, velocity), _by_own(value, own_symbol)]
    else:
        value, first = rest, [made]
        derivatives = [ca.jacobian(value, part) for part in (velocity, own_symbol, made)]
        both = [of_own, ca.densify(ca.jacobian(of_own, own_symbol).T)]
        ahead = ca.Function("made", [own_symbol], both)
    at_rest = [ca.substitute(e, velocity, ca.SX.zeros(6 * poses, 1)) for e in (value, *derivatives)]
    columns = np.flatnonzero(np.diff(at_rest[1].sparsity().colind())).astype(np.intp)
    symbols = [s for pair in zip(rotations, positions, strict=True) for s in pair]
    by_pose = at_rest[1][:, columns.tolist()]
    outputs = [at_rest[0], by_pose.T, *(part.T for part in at_rest[2:])]
    used = _looked_at(symbols, ca.veccat(*outputs))
    function = ca.Function(
        "residual",
        [*(symbols[k] for k in used), *first, own_symbol, data_symbol],
        [ca.densify(o) for o in outputs],
        {"cse": many},
    )
    return function, columns, used, ahead


def residual_value(
    residual: Residual, poses: Sequence[Pose], own: Symbol, data: Symbol, size: int
) -> Symbol:
    """A residual in symbols (size, 1).

    Raises:
        SamplesError: its author's function raises, or gives something else than ``size`` numbers.
    """
    name = getattr(residual, "__qualname__", repr(residual))
    try:
        value = residual(poses, own, data)
        value = ca.vertcat(*value) if isinstance(value, (list, tuple)) else ca.SX(value)
    except Exception as problem:  # whatever a function of other people raises
        reason = str(problem).strip().partition("\n")[0]
        raise SamplesError(
            f"a residual that cannot be evaluated on CasADi symbols ({type(problem).__name__}: "
            f"{reason})",
            "sums, products and functions of casadi, such as casadi.sin, without if",
            where=name,
        ) from problem
    if value.shape != (size, 1):
        raise SamplesError(
            f"a residual of shape {value.shape}", f"({size}, 1), as its block says", where=name
        )
    given = ca.veccat(*(part for pose in poses for part in (pose.R, pose.p)), own, data)
    inputs = {symbol.element_hash() for symbol in ca.symvar(given)}
    if free := [s.name() for s in ca.symvar(value) if s.element_hash() not in inputs]:
        raise SamplesError(
            f"a residual with unknown symbols: {', '.join(free)}",
            "only symbols of the poses, the term's unknowns and the data that it is given",
            where=name,
        )
    return value


def _made_of(value: Symbol, own_symbol: Symbol) -> tuple[Symbol, Symbol, Symbol]:
    """Symbols of what a value makes of own parameters alone, as one vector; these; the value of it.

    None, None and the value itself where it makes nothing of them.
    """
    rest, names, expressions = ca.extract_parametric(value, own_symbol, {})
    if not names:
        return None, None, value
    return ca.vertcat(*names), ca.vertcat(*expressions), rest


def _by_own(value: Symbol, own_symbol: Symbol) -> Symbol:
    """Jacobian by own parameters, by way of what is made of these alone, such as a rotation matrix.

    How that changes with them is computed once where all rows look at the same ones; and in any
    case no row's derivative is taken back through the formula of a rotation vector.
    """
    made, of_own, rest = _made_of(value, own_symbol)
    if made is None:
        return ca.jacobian(value, own_symbol)
    chained = ca.jacobian(rest, made) @ ca.jacobian(of_own, own_symbol)
    return ca.substitute(ca.jacobian(rest, own_symbol) + chained, made, of_own)


def _looked_at(symbols: Sequence[Symbol], values: Symbol) -> tuple[int, ...]:
    return tuple(k for k, s in enumerate(symbols) if ca.depends_on(values, ca.vec(s)))


@lru_cache(maxsize=64)
def _residual(
    residual: Residual, poses: int, own_count: int, data: int, size: int, many: bool
) -> tuple[Any, tuple[int, ...]]:
    """CasADi function (R₁, p₁, …, own, data) → residual, and which poses it has, as `_compiled`."""
    tools = [Pose(ca.SX.sym(f"R{k}", 3, 3), ca.SX.sym(f"p{k}", 3)) for k in range(poses)]
    own_symbol, data_symbol = ca.SX.sym("own", own_count), ca.SX.sym("data", data)
    value = ca.densify(residual_value(residual, tools, own_symbol, data_symbol, size))
    symbols = [symbol for tool in tools for symbol in (tool.R, tool.p)]
    used = _looked_at(symbols, value)
    inputs = [*(symbols[k] for k in used), own_symbol, data_symbol]
    return ca.Function("residual", inputs, [value], {"cse": many}), used


def _sparse(columns: IntArray, size: int, width: int) -> Any:
    """Rows that repeat (n, c) column indices for each of ``size`` residual components."""
    n, count = columns.shape
    indices = np.repeat(columns, size, axis=0).reshape(-1)
    pointer = np.arange(0, n * size * count + 1, count)
    values = np.zeros(len(indices))
    return sparse.csr_array((values, indices, pointer), shape=(n * size, width))
