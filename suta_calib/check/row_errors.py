"""How rows err together: by the readings, by the tips, and by what a model lacks.

A row's error is its own (an instrument's noise) or that of a touch, which all rows of the touch
share. What the arm's model lacks, such as backlash or compliance, is taken to be an error of the
joints: at every posture another one, or one that near postures share. Their covariances are the
components of

    V(θ) = V_own + θ_1 V_posture + θ_2 V_near(ℓ)

each with a variance of one in a typical row of the calibration.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.information import Rows
from suta_calib.solver.problem import Problem
from suta_calib.trust.examination import by_motion
from suta_calib.trust.rich_data import LEVER

# Of the largest variance, that of a combination of rows which no error of a touch moves: distances
# between n touches are more rows than coordinates that were measured.
_ROUNDING: Final = 1e-3
# Rows, their combinations (c, k), and the variances of these.
_Combinations = tuple[IntArray, FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class RowErrors:
    """What the components of whitened rows (m,) share.

    Where rows look at several touches, only as many combinations of them (c,) count as were
    measured.

    Attributes:
        sums: what is left of components where a sample has many of them; None where all are.
        combined: (c, m) orthonormal, these combinations; None where each row counts.
        own: (c, c) covariance of what each row or touch has for itself.
        stated: (c,) logarithm of the standard deviation that each row states; zero where none does.
        by_joint: (k, m, joints) derivative by the joint errors of each of up to k samples.
        by_tip: (k, m, 6) derivative by where the tip is at each of them, m, and by its turn, rad.
        sample: (k, m) which samples these are.
        readings: (samples, joints) of turns, rad, and of travels in units alike.
        sliding: (joints,) which of these are travels.
        posture: (samples,) number of the rest.
    """

    sums: SampleSums | None
    combined: FloatArray | None
    own: FloatArray
    stated: FloatArray
    by_joint: FloatArray
    by_tip: FloatArray
    sample: IntArray
    readings: FloatArray
    sliding: FloatArray
    posture: IntArray

    @classmethod
    def of(
        cls, problem: Problem, x: FloatArray, rows: Sequence[Rows], *, summed: bool = False
    ) -> RowErrors:
        """Those of a problem with all offsets of its arm, where it was linearised last.

        Args:
            problem: it.
            x: where.
            rows: whitened, there.
            summed: only what the problem's unknowns and the tips move of samples with many rows.
        """
        velocity = _by_joints(problem, x)
        shift = np.tile(np.eye(6), (len(velocity), 1, 1))
        deep = max(r.line.view.block.samples.shape[1] for r in rows)
        stated, sums, parts = list[FloatArray](), list[SampleSums](), list[_Combinations]()
        by_joint, by_tip, sample = (list[Any]() for _ in range(3))
        first = above = 0
        for r in rows:
            n, size = r.line.residual.shape
            looked_at = r.line.view.block.samples + r.line.view.first_sample
            members = looked_at.shape[1]
            moved = _by_sample(r, velocity, looked_at), _by_sample(r, shift, looked_at)
            looks, states = np.repeat(looked_at, size, axis=0).T, _stated(r)
            if summed and members == 1 and not states.any():
                sums_of_block = SampleSums.of(r, moved[1][0], above)
                sums.append(sums_of_block)
                moved = (
                    sums_of_block.sum(moved[0][0], above)[None],
                    sums_of_block.sum(moved[1][0], above)[None],
                )
                looks, states = (
                    looks[:, sums_of_block.first - above],
                    np.zeros(len(sums_of_block.first)),
                )
            else:
                sums.append(SampleSums.of_each(n * size, above))
            count = len(states)
            here = np.arange(first, first + count)
            if members > 1:
                parts += [*_measured(moved[1][:, :, :3], looks, here)]
            else:
                parts.append((here, np.eye(count), np.ones(count)))
            for every, of_block in zip((by_joint, by_tip, sample), (*moved, looks), strict=True):
                unused = [(0, deep - members), *[(0, 0)] * (of_block.ndim - 1)]
                every.append(np.pad(of_block, unused))
            stated.append(states)
            first, above = first + count, above + n * size
        own = np.diag(np.concatenate([values for *_, values in parts]))
        of_each = np.concatenate(stated)
        combined = None
        if deep > 1:
            combined = np.zeros((len(own), first))
            last = np.cumsum([0, *(len(values) for *_, values in parts)])
            for (some, vectors, _), a, b in zip(parts, last, last[1:], strict=False):
                combined[a:b, some] = vectors
            of_each = combined @ of_each
        starts = problem.evaluation.table.first.tolist()
        posture = np.concatenate(
            [a + t.poses.rests for (a, _), t in zip(pairwise(starts), problem.terms, strict=True)]
        )
        return cls(
            SampleSums.joined(sums) if summed else None,
            combined,
            own,
            of_each,
            np.concatenate(by_joint, axis=1),
            np.concatenate(by_tip, axis=1),
            np.concatenate(sample, axis=1),
            *_readings(problem),
            posture,
        )

    def scatter(self, power: float, middle: float) -> FloatArray:
        """(c, c) what each row has for itself, if that goes with a power of what it states.

        Args:
            power: one where rows scatter as they state, zero where they all scatter alike.
            middle: logarithm of a standard deviation at which both are the same.
        """
        if power == 1.0 or not self.stated.any():
            return self.own
        factor = np.exp((power - 1.0) * np.where(self.stated, self.stated - middle, 0.0))
        return np.asarray(self.own * np.outer(factor, factor))

    def combine(self, columns: FloatArray) -> FloatArray:
        """(c, …) of what all rows have (m, …)."""
        return self._combined(columns if self.sums is None else self.sums.sum(columns))

    def _combined(self, columns: FloatArray) -> FloatArray:
        return columns if self.combined is None else np.asarray(self.combined @ columns)

    def outlying(self, weight: FloatArray) -> FloatArray:
        """(c, c) variance by which rows of robust weights (m,) scatter more."""
        return self._combined(self._combined(np.diag(1.0 / weight - 1.0)).T)

    @property
    def by_posture(self) -> FloatArray:
        """(c, c) covariance where every posture has its own joint errors, of one rad."""
        alike = (self.posture[:, None] == self.posture).astype(float)
        return self.shared(self, alike)

    def near(self, other: RowErrors, reach: float) -> FloatArray:
        """(c, c') covariance with other rows where near postures share joint errors, of one rad.

        Args:
            other: rows.
            reach: chord of turns by which they share a third.
        """
        difference = self.readings[:, None] - other.readings
        turned = 2.0 * np.sin(difference / 2.0)
        chords = np.where(self.sliding, difference, turned)
        return self.shared(other, np.exp(-np.sqrt(np.sum(chords**2, axis=2)) / reach))

    def shared(self, other: RowErrors, alike: FloatArray) -> FloatArray:
        """(c, c') covariance where joint errors of samples correlate so (samples, samples')."""
        every = _shared(self.by_joint, self.sample, other.by_joint, other.sample, alike)
        return other._combined(self._combined(every).T).T

    def of_sample(self, number: int) -> FloatArray:
        """(c, d) what one sample alone may move: its row, where its touch was, or a whole picture.

        What scatters within a picture, or what its light makes of that, is no error of it.
        """
        looks = self.sample == number
        if self.combined is not None:
            return self.combine(np.sum(self.by_tip[:, :, :3] * looks[:, :, None], axis=0))
        at = np.flatnonzero(looks[0])
        if len(at) > self.by_tip.shape[2]:
            return np.asarray(self.by_tip[0] * looks[0][:, None])
        columns = np.zeros((len(self.own), len(at)))
        columns[at, np.arange(len(at))] = 1.0
        return columns

    @property
    def of_samples(self) -> FloatArray | None:
        """(c, k) the same of all samples; None where that is all of their rows."""
        count = len(self.posture)
        if self.combined is not None or len(self.own) <= count * self.by_tip.shape[2]:
            return None
        return np.hstack([self.of_sample(k) for k in range(count)])


@dataclass(frozen=True, eq=False)
class SampleSums:
    """What samples with many rows, such as pictures, say of the problem: a few sums of each.

    The rest of their rows is noise of their own, that nothing in the problem moves.

    Attributes:
        parts: numbers of the components of a sample (n,), and the sums of these (k, n): orthonormal
            once the components are weighed as the fit did. None: these components as they are.
        first: (m,) of each sum, a component of its sample.
    """

    parts: tuple[tuple[IntArray, FloatArray | None], ...]
    first: IntArray

    @classmethod
    def of_each(cls, count: int, above: int) -> SampleSums:
        """Every component for itself; the first is number ``above``."""
        numbers = np.arange(above, above + count)
        return cls(((numbers, None),), numbers)

    @classmethod
    def of(cls, rows: Rows, by_tip: FloatArray, above: int) -> SampleSums:
        """Of a block: the sums that its Jacobian, and the pose of each tip (n·d, 6), move."""
        block, size = rows.line.view.block, rows.line.residual.shape[1]
        look, weight = np.repeat(block.samples[:, 0], size), np.repeat(rows.line.weight, size)
        order = np.argsort(look, kind="stable")
        ends = np.flatnonzero(np.diff(look[order])) + 1
        parts, first = list[tuple[IntArray, FloatArray | None]](), list[IntArray]()
        for mine in np.split(order, ends):
            columns = np.hstack([by_tip[mine], rows.jacobian[mine]])
            columns = columns[:, np.any(columns, axis=0)]
            sums = None
            if columns.shape[1]:
                root = np.sqrt(weight[mine])
                units = np.linalg.norm(columns, axis=0)
                vectors, values, _ = np.linalg.svd(
                    root[:, None] * columns / units, full_matrices=False
                )
                # Of the largest singular value: less is rounding.
                kept = vectors[:, values > 1e-9 * values[0]]
                if kept.shape[1] < len(mine):
                    sums = kept.T * root
            parts.append((mine + above, sums))
            first.append(mine + above if sums is None else np.full(len(sums), mine[0] + above))
        return cls(tuple(parts), np.concatenate(first))

    @classmethod
    def joined(cls, blocks: Sequence[SampleSums]) -> SampleSums:
        """Of all blocks."""
        parts = tuple(part for block in blocks for part in block.parts)
        return cls(parts, np.concatenate([block.first for block in blocks]))

    def sum(self, columns: FloatArray, above: int = 0) -> FloatArray:
        """(m, …) of columns, the first of which is that of component ``above``."""
        return np.concatenate(
            [
                columns[numbers - above] if sums is None else sums @ columns[numbers - above]
                for numbers, sums in self.parts
            ]
        )

    def rest(self, residual: FloatArray, weight: FloatArray) -> tuple[float, int]:
        """Weighted squares of what the sums leave of residuals (n,), and how many numbers it is."""
        squares, count = 0.0, 0
        for numbers, sums in self.parts:
            if sums is not None:
                mine = residual[numbers]
                squares += float(weight[numbers] @ mine**2) - float(np.sum((sums @ mine) ** 2))
                count += len(mine) - len(sums)
        return max(squares, 0.0), count

    def weights(self, weight: FloatArray) -> FloatArray:
        """(m,) robust weights of components; one of sums, which are weighed already."""
        return np.concatenate(
            [weight[n] if sums is None else np.ones(len(sums)) for n, sums in self.parts]
        )


def _shared(
    left: FloatArray, samples: IntArray, right: FloatArray, others: IntArray, alike: FloatArray
) -> FloatArray:
    """(m, m') sum over the samples of both rows."""
    total = np.zeros((left.shape[1], right.shape[1]))
    for a, s in zip(left, samples, strict=True):
        for b, t in zip(right, others, strict=True):
            total += (a @ b.T) * alike[np.ix_(s, t)]
    return total


def _measured(by_tip: FloatArray, sample: IntArray, numbers: IntArray) -> Iterator[_Combinations]:
    """Combinations of rows that look at several touches, as many as were measured.

    Of all rows that hang together by their touches: which they are, their combinations (c, k), and
    the variances (c,) of these if each touch errs alike.
    """
    pairs = coo_array((np.ones(sample.shape[1]), (sample[0], sample[1])), (sample.max() + 1,) * 2)
    _, group = connected_components(pairs, directed=False)
    variance = np.mean(np.sum(by_tip**2, axis=(0, 2)))
    for one in np.unique(group[sample[0]]):
        mine = np.flatnonzero(group[sample[0]] == one)
        tips, at = by_tip[:, mine], sample[:, mine]
        alike = np.eye(int(at.max()) + 1)
        values, vectors = np.linalg.eigh(_shared(tips, at, tips, at, alike) / variance)
        kept = values > _ROUNDING * values[-1]
        yield numbers[mine], vectors[:, kept].T, values[kept]


def _by_joints(problem: Problem, x: FloatArray) -> FloatArray:
    """(samples, 6, joints) velocity of every tip by an error of each joint, as of a turn."""
    table, arm = problem.evaluation.table, problem.arm
    table.update(x)
    count = len(table.position)
    if arm is None:
        # Poses that were measured err as a whole.
        return np.tile(np.diag(np.repeat([LEVER, 1.0], 3)), (count, 1, 1))
    at = [problem.names.index(name) for name in arm.offsets]
    unit = [LEVER if problem.parameters[name].unit == "m" else 1.0 for name in arm.offsets]
    return np.asarray(table.velocity[:, at].reshape(count, 6, len(at)) * np.array(unit))


def _by_sample(rows: Rows, velocity: FloatArray, looked_at: IntArray) -> FloatArray:
    """(k, n·d, joints) derivative of a block's rows by what moves each of their samples."""
    samples, _, joints = velocity.shape
    size = rows.line.residual.shape[1]
    if looked_at.shape[1] == 1:
        return by_motion([rows], velocity.reshape(-1, joints))[None]
    # Each sample has columns of its own.
    alone = np.zeros((samples, 6, samples, joints))
    alone[np.arange(samples), :, np.arange(samples)] = velocity
    every = by_motion([rows], alone.reshape(6 * samples, -1)).reshape(-1, samples, joints)
    place = np.repeat(looked_at, size, axis=0)
    return np.asarray([every[np.arange(len(every)), members] for members in place.T])


def _stated(rows: Rows) -> FloatArray:
    """(n·d,) logarithm of the standard deviations that a block's rows state; zero without them."""
    block, shape = rows.line.view.block, rows.line.residual.shape
    if block.relative.size == 1:
        return np.zeros(rows.line.residual.size)
    return np.asarray(np.log(np.broadcast_to(block.relative * block.typical, shape)).reshape(-1))


def _readings(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Readings (samples, joints) of all samples; and which are travels (joints,)."""
    if problem.arm is None:
        count = sum(len(term.poses) for term in problem.terms)
        return np.zeros((count, 1)), np.zeros(1, dtype=bool)
    sliding = np.array([problem.arm.units[joint] == "m" for joint in problem.arm.joints])
    q = np.vstack([term.poses.samples.q for term in problem.terms])
    return np.where(sliding, q / LEVER, q), sliding
