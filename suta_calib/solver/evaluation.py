"""Residuals, robust cost, gradient and Gauss-Newton matrix of a problem, at NumPy speed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.batched import Batched
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.solver.compiled_residual import Kernel, RowPattern, dense
from suta_calib.solver.losses import huber_weight, kept_curvature, radial
from suta_calib.terms.block import Block
from suta_calib.terms.poses import ArmPoses, PoseSource

# Rows whose Jacobian is held at once where it is summed: so few that it stays in the cache.
AT_ONCE: Final = 2048


@dataclass(frozen=True, eq=False)
class BlockView:
    """A block, and where its samples and own parameters lie in the whole problem.

    Attributes:
        block: the rows.
        first_sample: of its term, among those of all terms.
        own_columns: (n, m), counted from the first own parameter; last, those of the clock.
        clocks: how many these are.
        late: poses of the rows one by one, where each has its lag.
        source: number of the term.
        limit: a learned Huber threshold, m or rad, where it is below the one that is given.
    """

    block: Block
    first_sample: int
    own_columns: IntArray
    clocks: int = 0
    late: PoseSource | None = None
    source: int = 0
    limit: float = math.inf

    @property
    def threshold(self) -> float:
        """Residual norm, m or rad, beyond which the cost grows linearly."""
        return min(self.block.noise.huber, self.limit)


class PoseTable:
    """Tool poses of every sample of every term, and how they move with the arm's parameters.

    Args:
        sources: pose source of each term.
        names: of the arm's parameters.
        clocks: of each source the place, in the vector of all parameters, of the unknown that moves
            its poses in time; None where there is none.
        delay: place of the unknown that the lag of the poses is multiplied by; None for no lag.

    Attributes:
        rotation: (n, 9) column by column.
        position: (n, 3), m.
        rate: (6 n,) of the tools, m and rad per second, where a clock moves them in time.
        uncertainty: (6 n,) standard deviation of where the tools are between rows, likewise.
        changes: how often the poses have changed.
        late: poses of rows with a lag, with the number of the source and which of its samples.
    """

    def __init__(
        self,
        sources: Sequence[PoseSource],
        names: Sequence[str],
        clocks: Sequence[int | None] | None = None,
        delay: int | None = None,
    ) -> None:
        sizes = [len(source) for source in sources]
        self.first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp)
        n = int(self.first[-1])
        self.rotation, self.position = np.zeros((n, 9)), np.zeros((n, 3))
        # Velocities are most of the work and of the memory: of many poses they wait for whom asks.
        self._wait = n > AT_ONCE
        self._later = list[tuple[slice, Any, list[FloatArray]]]()
        self._velocities, self._velocity_at = list[Batched](), 0
        self._velocity = np.zeros((0 if self._wait else 6 * n, len(names)))
        self.rate, self.uncertainty = np.zeros(6 * n), np.zeros(6 * n)
        self.changes = 0
        self._clocks = [*clocks] if clocks is not None else [None] * len(sizes)
        self._moved = list[MovedInTime | None]()
        self.late = list[tuple[int, IntArray, PoseTable]]()
        self._delay, self._lags = delay, [source.lag for source in sources]
        places = {c for c in (*self._clocks, delay) if c is not None}
        self._looked_at = [*range(len(names)), *sorted(places)]
        self._theta: FloatArray | None = None
        self._sources: list[tuple[slice, Batched | None]] = []
        for source, first, size in zip(sources, self.first, sizes, strict=False):
            rows = slice(int(first), int(first) + size)
            batch = None
            if isinstance(source, ArmPoses):
                conditions = source.conditions
                function = source.arm.function(names, conditions)
                poses = [self.rotation[rows], self.position[rows]]
                if self._wait:
                    batch = Batched(function, size, [0], poses, (0, 1))
                    self._later.append((rows, function, batch.inputs))
                else:
                    batch = Batched(function, size, [0], [*poses, self._velocity_of(rows)])
                inputs = (source.samples.q, *conditions.values())
                for place, values in zip(batch.inputs[1:], inputs, strict=True):
                    place[:] = values
            else:
                rotation, self.position[rows] = source.at({})
                self.rotation[rows] = np.swapaxes(rotation, 1, 2).reshape(size, 9)
            self._sources.append((rows, batch))
        for source, (rows, batch), clock in zip(sources, self._sources, self._clocks, strict=True):
            moved = None
            if clock is not None and batch is not None and isinstance(source, ArmPoses):
                six = slice(6 * rows.start, 6 * rows.stop)
                moved = MovedInTime(source, names, self.rate[six], self.uncertainty[six])
            self._moved.append(moved)

    @property
    def velocity(self) -> FloatArray:
        """(6 n, parameters) of the tools, m and rad per unit of the arm's parameters."""
        if self._wait and self._velocity_at != self.changes:
            if not len(self._velocity):
                self._velocity = np.zeros((6 * len(self.position), self._velocity.shape[1]))
                self._velocities = [
                    Batched(
                        function,
                        len(inputs[1]),
                        [0],
                        [self._velocity_of(rows)],
                        (2,),
                        inputs=inputs,
                    )
                    for rows, function, inputs in self._later
                ]
            for batch in self._velocities:
                batch()
            self._velocity_at = self.changes
        return self._velocity

    def _velocity_of(self, rows: slice) -> FloatArray:
        """Of some poses: copying what a function writes would take as long as it does."""
        return self._velocity.reshape(len(self.position), -1 if self._velocity.size else 0)[rows]

    def update(self, x: FloatArray) -> None:
        """All poses for parameter values (n,), the arm's first, and how they move with these.

        Of the others, only the clocks' are looked at. They may be there already.
        """
        for _, _, table in self.late:
            table.update(x)
        theta = x[self._looked_at]
        if self._theta is not None and np.array_equal(theta, self._theta):
            return
        self._theta = theta.copy()
        self.changes += 1
        count = self._velocity.shape[1]
        delay = 0.0 if self._delay is None else float(x[self._delay])
        for (_, batch), moved, clock, lag in zip(
            self._sources, self._moved, self._clocks, self._lags, strict=True
        ):
            if batch is not None:
                batch.inputs[0][:] = x[:count]
                if moved is not None and clock is not None:
                    batch.inputs[1][:] = moved(x[:count], x[clock] + lag * delay)
                batch()

    @contextmanager
    def shifted(self, shifts: Sequence[FloatArray]) -> Iterator[None]:
        """Evaluate at other readings for a while, shifted for each source in order.

        By readings of an arm (n, joints), or by displacements of measured poses, m, and turns about
        the base's axes, rad (n, 6).
        """
        readings = [b.inputs[1].copy() if b else None for _, b in self._sources]
        poses, theta = (self.rotation.copy(), self.position.copy()), self._theta
        # Of few samples keeping what is known takes less than to find it again.
        small = not self._wait
        velocity, rate = (self._velocity.copy(), self.rate.copy()) if small else (None, None)
        self._theta = None
        sources = zip(self._sources, self._moved, shifts, strict=True)
        late = ExitStack()
        try:
            for source, rows_of_source, table in self.late:
                late.enter_context(table.shifted([shifts[source][rows_of_source]]))
            for (rows, batch), moved, shift in sources:
                if moved is not None:
                    moved.shift = shift
                elif batch is not None:
                    batch.inputs[1][:] += shift
                else:
                    columns = self.rotation[rows].reshape(-1, 3, 3)  # one row a matrix's column
                    back = rotation_from_vector(-shift[:, 3:])
                    self.rotation[rows] = (columns @ back).reshape(-1, 9)
                    self.position[rows] += shift[:, :3]
            yield
        finally:
            late.close()
            self._theta = None
            for moved in filter(None, self._moved):
                moved.shift = 0.0
            self.rotation[:], self.position[:] = poses
            if velocity is not None and rate is not None:
                self._velocity[:], self.rate[:], self._theta = velocity, rate, theta
                self.changes += 1
            for (_, batch), q in zip(self._sources, readings, strict=True):
                if batch is not None:
                    batch.inputs[1][:] = q


class MovedInTime:
    """Readings at other times than those of the rows, and how fast the tips move then.

    Args:
        source: poses with a clock.
        names: of the arm's parameters.
        rate: (6 n,) of the tips; each call fills it.
        uncertainty: (6 n,) of where the tips are; likewise.

    Attributes:
        shift: (n, joints) that the readings are off for a while.
    """

    def __init__(
        self,
        source: ArmPoses,
        names: Sequence[str],
        rate: FloatArray,
        uncertainty: FloatArray,
    ) -> None:
        samples = source.samples
        assert samples.motion is not None
        self._q, self._motion = samples.q, samples.motion
        self._rate, self._uncertainty = rate.reshape(-1, 6), uncertainty.reshape(-1, 6)
        self.shift: FloatArray | float = 0.0
        swing = source.arm.swing(names, source.conditions)
        self._batch = Batched(swing, len(samples), [0])
        for place, values in zip(self._batch.inputs[3:], source.conditions.values(), strict=True):
            place[:] = values

    def __call__(self, theta: FloatArray, offset: float | FloatArray) -> FloatArray:
        """Readings (n, joints) so many seconds later, for the arm's parameter values."""
        there = self._motion.beyond(offset)
        q = self._q + there[0] + self.shift
        self._batch.inputs[0][:], self._batch.inputs[1][:] = theta, q
        if not self._uncertainty.any():
            # Asked for once: it hardly depends on where the tips are.
            squares = np.zeros_like(self._uncertainty)
            for joint, error in enumerate(self._motion.error.T):
                self._batch.inputs[2][:] = 0.0
                self._batch.inputs[2][:, joint] = error
                squares += self._batch()[0] ** 2
            self._uncertainty[:] = np.sqrt(squares)
        self._batch.inputs[2][:] = there[1]
        self._rate[:] = self._batch()[0]
        return np.asarray(q)


@dataclass(frozen=True, eq=False)
class Linearised:
    """One block at one point, before whitening.

    Attributes:
        residual: (n, d), of rows that state standard deviations relative to what they state;
            where there are `SampleErrors`, whitened, like the derivatives.
        pattern: where derivatives belong in the whole Jacobian.
        of_arm: the same of what moves each row's own pose, and the table of these: of rows with a
            lag others than those of the samples.
        by_pose: (n, d, c) derivative by the pose velocities the rows look at.
        by_own: (n, d, m) derivative by the own parameters.
        sigma: (n,) standard deviation of one component.
        known_sigma: (n,) the part of it that is known beforehand.
        squared: (n,) squared norm of the whitened residual.
        weight: (n,) Huber's weight, one for rows that are believed entirely.
        measured: (n, d) the residual before `SampleErrors` are whitened; None where there are none.
    """

    view: BlockView
    pattern: RowPattern
    of_arm: tuple[RowPattern, PoseTable]
    residual: FloatArray
    by_pose: FloatArray
    by_own: FloatArray
    sigma: FloatArray
    known_sigma: FloatArray
    squared: FloatArray
    weight: FloatArray
    measured: FloatArray | None = None

    @property
    def error(self) -> FloatArray:
        """The residual as it was measured, (n, d) in m or rad: whatever the rows state."""
        residual = self.residual if self.measured is None else self.measured
        return residual * self.view.block.relative


class Evaluation:
    """Evaluates a problem's cost and derivatives at parameter vectors (arm first, then own).

    Args:
        sources: pose source of each term.
        views: blocks with the position of their samples and own parameters.
        arm_names: the arm's parameters, in the order of the vector's first entries.
        own_count: how many own parameters follow them.
        clocks: as of `PoseTable`.
    """

    def __init__(
        self,
        sources: Sequence[PoseSource],
        views: Sequence[BlockView],
        arm_names: Sequence[str],
        own_count: int,
        clocks: Sequence[int | None] | None = None,
    ) -> None:
        self.table = PoseTable(sources, arm_names, clocks)
        self.views = tuple(views)
        self.arm_count, self.own_count = len(arm_names), own_count
        width = 6 * len(self.table.position)
        self._at: tuple[int, bytes] | None = None
        self._found: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]] = []
        self._kernels = [
            Kernel(v.block, v.first_sample, v.own_columns, width, own_count, clocks=v.clocks)
            for v in views
        ]
        self._tables = [self._table_of(view, arm_names) for view in views]

    def _table_of(self, view: BlockView, arm_names: Sequence[str]) -> PoseTable:
        """The poses that a block looks at: all, or those of its rows with their lag."""
        if view.late is None:
            return self.table
        offset, delay = (self.arm_count + view.own_columns[0, -2:]).tolist()
        table = PoseTable([view.late], arm_names, [offset], delay)
        self.table.late.append((view.source, view.block.samples[:, 0], table))
        return table

    def limited(self, limits: Sequence[float]) -> Evaluation:
        """The same with Huber thresholds of at most so much, m or rad, for each block."""
        other = copy(self)
        views = zip(self.views, limits, strict=True)
        other.views = tuple(replace(view, limit=limit) for view, limit in views)
        return other

    def linearise(self, x: FloatArray, sigmas: Sequence[float]) -> list[Linearised]:
        """Every block at x, with the noise level of each block."""
        self.table.update(x)
        own_values = x[self.arm_count :]
        # The latest point is asked for again with other noise, and by whoever judges it.
        here = self.table.changes, own_values.tobytes()
        if here != self._at:
            self._found = [
                _whitened(
                    view.block, kernel(table.rotation, table.position, own_values, table.rate)
                )
                for view, kernel, table in zip(self.views, self._kernels, self._tables, strict=True)
            ]
            if self._at is None:
                # What is known of the noise stays, so that the cost is one function.
                every = zip(self._kernels, self._tables, self._found, strict=True)
                for kernel, table, (_, by_pose, *_) in every:
                    kernel.add_uncertainty(by_pose, table.uncertainty)
            self._at = here
        lines = []
        blocks = zip(self.views, self._kernels, self._tables, sigmas, self._found, strict=True)
        for view, kernel, table, sigma, (residual, by_pose, by_own, measured) in blocks:
            spread = kernel.spread(sigma)
            squared = np.einsum("nd,nd->n", residual, residual) / spread**2
            weight = huber_weight(squared, view.threshold / spread)
            lines.append(
                Linearised(
                    *(view, kernel.pattern, (kernel.of_arm, table)),
                    *(residual, by_pose, by_own),
                    *(spread, kernel.known_sigma, squared, weight),
                    measured,
                )
            )
        return lines

    @property
    def known_sigmas(self) -> list[FloatArray]:
        """Of each block (n,) the standard deviations of rows that are known beforehand."""
        return [kernel.known_sigma for kernel in self._kernels]

    def cost(self, x: FloatArray, sigmas: Sequence[float]) -> float:
        """½ Σ ρ over all rows of all blocks (priors not included)."""
        return sum(self._cost(line) for line in self.linearise(x, sigmas))

    def cost_gradient_hessian(
        self, x: FloatArray, sigmas: Sequence[float], *, arm_moves: bool = True
    ) -> tuple[float, FloatArray, FloatArray]:
        """½ Σ ρ, its gradient, and the Gauss-Newton matrix of the robust cost.

        Unless ``arm_moves``, what concerns the arm's parameters is left out: zeros.
        """
        a, n = self.arm_count, self.arm_count + self.own_count
        cost, gradient, hessian = 0.0, np.zeros(n), np.zeros((n, n))
        for line in self.linearise(x, sigmas):
            cost += self._cost(line)
            slope, curvature = self._normal_equations(line, arm_moves)
            first = 0 if arm_moves else a
            part = slice(first, first + len(slope))
            gradient[part] += slope
            hessian[part, part] += curvature
        return cost, gradient, hessian

    def least_squares(
        self, x: FloatArray, sigmas: Sequence[float]
    ) -> tuple[FloatArray, FloatArray]:
        """Whitened residuals (m,) whose squares are the ρ of all rows, and derivatives (m, n).

        A row beyond Huber's threshold is shortened to √ρ, in its own direction.
        """
        rows, columns = list[FloatArray](), list[FloatArray]()
        for line in self.linearise(x, sigmas):
            arm, by_own = self.columns(line, line.by_pose, line.by_own)
            none = np.zeros((line.residual.size, self.own_count))
            both = np.hstack([arm, none if by_own is None else dense(by_own)])
            jacobian = both.reshape(*line.residual.shape, -1) / line.sigma[:, None, None]
            residual, weight = line.residual / line.sigma[:, None], line.weight
            shorter = np.sqrt(weight * (2.0 - weight))
            outer = np.flatnonzero(weight < 1.0)
            if len(outer):
                unit, along = radial(residual[outer], jacobian[outer])
                change = (weight / shorter - shorter)[outer, None, None]
                jacobian *= shorter[:, None, None]
                jacobian[outer] += change * unit[:, :, None] * along[:, None, :]
                residual = residual * shorter[:, None]
            rows.append(residual.reshape(-1))
            columns.append(jacobian.reshape(len(rows[-1]), -1))
        return np.concatenate(rows), np.vstack(columns)

    def _normal_equations(self, line: Linearised, arm_moves: bool) -> tuple[FloatArray, FloatArray]:
        """Gradient and Gauss-Newton matrix of one block, by the arm's parameters, then own ones.

        The arm's are left out unless it moves, and own ones where the block looks at none.

        Rows in the linear part of Huber's loss have less curvature along their residual than
        weights alone would give (Triggs et al. 2000, doi:10.1007/3-540-44480-7_21, section 4.3).
        """
        root = np.sqrt(line.weight) / line.sigma
        by_own = line.pattern.by_own(line.by_own)
        if by_own is not None and not isinstance(by_own, np.ndarray):
            return self._sparse_normal_equations(line, root, arm_moves)
        width = (self.arm_count if arm_moves else 0) + (0 if by_own is None else self.own_count)
        gradient, hessian = np.zeros(width), np.zeros((width, width))
        outer = line.weight < 1.0
        lost = 1.0 - kept_curvature(np.count_nonzero(outer) / max(len(outer), 1))
        for part_rows, jacobian in self.parts(line, arm=arm_moves):
            jacobian = jacobian * root[part_rows, None, None]
            residual, beyond = root[part_rows, None] * line.residual[part_rows], outer[part_rows]
            rows = jacobian.reshape(-1, width)
            gradient += rows.T @ residual.reshape(-1)
            hessian += rows.T @ rows
            if beyond.any():
                _, along = radial(residual[beyond], jacobian[beyond])
                hessian -= lost * along.T @ along
        return gradient, hessian

    def parts(self, line: Linearised, *, arm: bool = True) -> Iterator[tuple[slice, FloatArray]]:
        """Some rows of a block after the other, with their derivatives (k, d, parameters).

        By the arm's parameters, unless these are to be left out, then by own ones, unless the block
        looks at none. They may be what the block keeps: not to be written to.
        """
        by_own, size = line.pattern.by_own(line.by_own), line.residual.shape[1]
        arm = arm and self.arm_count > 0
        for first in range(0, len(line.residual), AT_ONCE):
            rows = slice(first, min(first + AT_ONCE, len(line.residual)))
            both = list[FloatArray]()
            if arm:
                pattern, table = line.of_arm
                both.append(pattern.by_parameters(line.by_pose, table.velocity, rows))
            if by_own is not None:
                both.append(dense(by_own[size * rows.start : size * rows.stop]))
            if both:
                jacobian = both[0] if len(both) == 1 else np.concatenate(both, axis=1)
                yield rows, jacobian.reshape(rows.stop - first, size, jacobian.shape[1])

    def _sparse_normal_equations(
        self, line: Linearised, root: FloatArray, arm_moves: bool
    ) -> tuple[FloatArray, FloatArray]:
        """`_normal_equations` where each row looks at a few of many own parameters."""
        residual, by_pose, by_own = _corrected(line, root)
        white, by_own_white = residual.reshape(-1), line.pattern.by_own(by_own)
        if not arm_moves:
            return by_own_white.T @ white, dense(by_own_white.T @ by_own_white)
        arm = self._arm_columns(line, by_pose)
        cross = by_own_white.T @ arm
        gradient = np.concatenate([arm.T @ white, by_own_white.T @ white])
        return gradient, np.block(
            [[arm.T @ arm, cross.T], [cross, dense(by_own_white.T @ by_own_white)]]
        )

    def columns(self, line: Linearised, by_pose: FloatArray, by_own: FloatArray) -> tuple[Any, Any]:
        """Jacobian of a block's rows: dense by the arm's parameters, by own ones as they come."""
        return self._arm_columns(line, by_pose), line.pattern.by_own(by_own)

    def _arm_columns(self, line: Linearised, by_pose: FloatArray) -> Any:
        if not self.arm_count:
            return np.zeros((line.residual.size, 0))
        pattern, table = line.of_arm
        return pattern.by_parameters(by_pose, table.velocity)

    @staticmethod
    def _cost(line: Linearised) -> float:
        # ρ(s) with ρ's derivative w, which is known: s within the threshold, where w is one.
        with np.errstate(invalid="ignore"):  # Of what is infinitely far off, w is zero.
            return 0.5 * float(line.squared @ (line.weight * (2.0 - line.weight)))


def _whitened(
    block: Block, found: tuple[FloatArray, FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """Residuals and derivatives, whitened where there are `SampleErrors`; then those measured."""
    if block.sample_errors is None:
        return *found, None
    residual, by_pose, by_own = map(block.sample_errors.whitened, found)
    # The next evaluation overwrites what was found; what is whitened is new.
    return residual, by_pose, by_own, found[0].copy()


def _corrected(line: Linearised, root: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals and derivatives such that JᵀR and JᵀJ are the robust gradient and matrix.

    ``root`` (n,) is the factor that makes rows white.
    """
    residual = root[:, None] * line.residual
    by_pose = root[:, None, None] * line.by_pose
    by_own = root[:, None, None] * line.by_own
    outer = np.flatnonzero(line.weight < 1.0)
    if len(outer):
        keep = np.sqrt(kept_curvature(len(outer) / len(root)))
        for derivative in (by_pose, by_own):
            unit, along = radial(line.residual[outer], derivative[outer])
            derivative[outer] -= (1 - keep) * unit[:, :, None] * along[:, None, :]
        residual[outer] /= keep
    return residual, by_pose, by_own
