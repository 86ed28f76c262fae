"""One joint that reads too much by one step in some of the rows, as if a count had wrapped.

An encoder behind a gear, or one of a few bits, begins anew within the joint's travel; who counts
its turns may miss one, and a count that was lost stays lost. Nobody knows the step beforehand, nor
the rows: on the nominal arm every row says which of many shifts of the joint suits it best, and
where two of them suit all rows, registered anew, their difference is the step. It is a cause only
if its rows are what such a step makes: those beyond some reading, or all from one row to another.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import SutaCalibError
from suta_calib.measurements.sample_files import JointRange, check_readings
from suta_calib.solver.compiled_residual import TermErrors
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.terms.poses import joint_ranges
from suta_calib.trust import Reinterpretation, SpoiltData, Truth
from suta_calib.trust.simulated_faults import arm_of, with_columns
from suta_calib.units import from_deg, text

# Shifts of a joint that are tried first, rad.
COARSE: Final = np.radians(np.arange(-180.0, 180.0, 6.0))


@dataclass(frozen=True, eq=False)
class _Step:
    """Rows of one joint's readings that are to be read otherwise.

    Attributes:
        joint: index of the joint.
        size: what is to be added to them, rad.
        rows: (samples,) which they are.
        left: mean square of what the step leaves, in units of the noise.
    """

    joint: int
    size: float
    rows: BoolArray
    left: float


class MissedCount(Reinterpretation):
    """``q_j → q_j + step`` in some rows, with the step and the rows that mend them."""

    name = "missed count"
    about = "A joint reads too much by a full range of its counter: an overflow was missed."
    precedence = 82
    tried = "fitted"

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """One, where a step of one joint mends the rows."""
        with suppress(SutaCalibError):
            arm = arm_of(data.terms[0])
            touches = _Touches(tuple(term.single_touches() for term in data.terms))
            before = np.mean(touches.squares(touches.none, touches.registered(touches.none)))
            turning = [k for k, j in enumerate(arm.readings) if j.type != "prismatic"]
            # Of an arm with more joints all would take too long.
            if max(len(arm_of(term).own_joints) for term in data.terms) > 16:
                return
            fewer = touches.fewer()
            coarse = sorted((*_coarse(fewer, k), k) for k in turning)
            # The two joints that are coarsely the best; a step leaves a fourth of what there was.
            steps = [s for _, size, k in coarse[:2] for s in _steps(touches, fewer, k, size)]
            steps = [step for step in steps if step.left < 0.25 * before]
            for step in sorted(steps, key=lambda step: step.left)[:1]:
                shifts = touches.shifted(step.joint, np.where(step.rows, step.size, 0.0))
                if where := _where(touches, step):
                    by = text(abs(step.size), "rad", with_unit=True)
                    sign = "little" if step.size > 0 else "much"
                    yield (
                        f"{arm.joints[step.joint]} reads {by} too {sign} {where}: "
                        "a step that its count missed",
                        tuple(_read(data.terms, shifts)),
                    )

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """An inner joint reads a tenth of a turn too little in the rows where it is farthest."""
        q, name = data.poses.samples.q.copy(), arm_of(data).own_joints[-2]
        joint = arm_of(data).joints.index(name)
        q[:, joint] -= from_deg(36.0) * (q[:, joint] > np.quantile(q[:, joint], 0.6))
        return SpoiltData(with_columns(data, q=q), effect=f"{name} reads 36.0000 deg too little")


@dataclass(frozen=True, eq=False)
class _Touches:
    """Terms whose every row is of one sample."""

    terms: tuple[Term, ...]

    @cached_property
    def q(self) -> FloatArray:
        """(samples, joints) readings of all terms, one after the other."""
        return np.vstack([term.poses.samples.q for term in self.terms])

    def own(self, joint: int) -> BoolArray:
        """(samples,) which are of a chain that has this joint."""
        arms = [(arm_of(term), len(term.poses)) for term in self.terms]
        return np.concatenate([np.full(n, a.joints[joint] in a.own_joints) for a, n in arms])

    @cached_property
    def origin(self) -> tuple[str, ...]:
        """(samples,) where each was read."""
        return tuple(row for term in self.terms for row in term.poses.samples.origin)

    @cached_property
    def given(self) -> Problem:
        """The terms as they are."""
        return self.problem(self.none)

    @cached_property
    def _errors(self) -> tuple[TermErrors, ...]:
        return tuple(TermErrors(term, ()) for term in self.terms)

    @cached_property
    def _ranges(self) -> tuple[JointRange, ...]:
        return joint_ranges(arm_of(self.terms[0]))

    @property
    def none(self) -> FloatArray:
        """(samples, joints) no shifts."""
        return np.zeros_like(self.q)

    def shifted(self, joint: int, by: FloatArray | float) -> FloatArray:
        """(samples, joints) shifts of one joint's readings."""
        shifts = self.none
        shifts[:, joint] = by
        return shifts

    def problem(self, shifts: FloatArray) -> Problem:
        """Of the nominal arm and all that is external."""
        return Problem(_read(self.terms, shifts))

    def registered(self, shifts: FloatArray) -> FloatArray:
        """What is external, at its closed-form start."""
        return self.problem(shifts).start()

    def squares(self, shifts: FloatArray, x: FloatArray) -> FloatArray:
        """(samples,) of the residuals of each, in units of the noise; infinite out of range."""
        try:
            check_readings(self.q + shifts, self._ranges, self.origin)
        except SutaCalibError:
            return np.full(len(shifts), np.inf)
        given = self.given
        values, sigmas = given.values(x), given.assumed_sigmas()
        ends = given.evaluation.table.first
        parts = (shifts[a:b] for a, b in pairwise(ends.tolist()))
        errors = chain(*(e(values, part) for e, part in zip(self._errors, parts, strict=True)))
        squares = np.zeros(len(shifts))
        for view, error, sigma in zip(given.evaluation.views, errors, sigmas, strict=True):
            block = view.block
            spread = np.hypot(sigma, block.known_sigma)
            squared = np.sum((error / block.relative) ** 2, axis=1) / spread**2
            np.add.at(squares, block.samples[:, 0] + view.first_sample, squared)
        return squares

    def fewer(self) -> _Touches:
        """Of many touches some, evenly chosen."""
        count = sum(len(term.poses) for term in self.terms)
        # Rows that say which shifts suit them, of many; all say in the end which of two does.
        every = -(-count // 200)
        rows = (np.arange(0, len(term.poses), every) for term in self.terms)
        fewer = _Touches(tuple(term.take(r) for term, r in zip(self.terms, rows, strict=True)))
        # What is external must be the same, place by place.
        return fewer if fewer.given.names == self.given.names else self


def _steps(touches: _Touches, fewer: _Touches, joint: int, size: float) -> Iterator[_Step]:
    """What a joint's step leaves at best, with either part of the rows taken for the wrong one.

    It is coarsely of this size, rad; ``fewer`` touches say how large it is.
    """
    # Rows that a step has at least.
    fewest = 4
    for sign in (1.0, -1.0):
        with suppress(SutaCalibError):
            settled, x = _settled(fewer, joint, sign * size)
            settled = _part_of_a_turn(settled)
            # Where what is external is, some rows tell well enough to sort all.
            wrong = touches.squares(touches.shifted(joint, settled), x)
            rows = wrong < touches.squares(touches.none, x)
            if fewest <= np.sum(rows) <= len(rows) - fewest:
                shifts = touches.shifted(joint, np.where(rows, settled, 0.0))
                left = touches.squares(shifts, touches.registered(shifts))
                yield _Step(joint, settled, rows, float(np.mean(left)))


def _coarse(touches: _Touches, joint: int) -> tuple[float, float]:
    """Squares left by the two shifts that suit all rows best, one or the other each; their step."""
    x = touches.registered(touches.none)
    squares = np.array([touches.squares(touches.shifted(joint, by), x) for by in COARSE])
    best, size = np.inf, 0.0
    # Of either sign the same pairs are tried.
    for k in range(1, len(COARSE) // 2 + 1):
        left = float(np.min(np.sum(np.minimum(squares, np.roll(squares, -k, axis=0)), axis=1)))
        if left < best:
            best, size = left, k * float(COARSE[1] - COARSE[0])
    return best, size


def _settled(touches: _Touches, joint: int, size: float) -> tuple[float, FloatArray]:
    """Rows sorted by what suits them, and the step told by them, until both stay.

    Returns:
        The step, rad, and what is external.
    """
    rows = np.zeros(len(touches.q), dtype=np.bool_)
    x = touches.registered(touches.none)
    for _ in range(10):
        right = touches.squares(touches.none, x)
        # Resolution of the step.
        tried = size + np.radians(np.arange(-6.0, 6.01, 0.5))
        wrong = np.array([touches.squares(touches.shifted(joint, by), x) for by in tried])
        best = int(np.argmin(np.sum(np.minimum(wrong, right), axis=1)))
        again, before, size = wrong[best] < right, size, float(tried[best])
        if np.array_equal(again, rows) and size == before:
            break
        rows = again
        x = touches.registered(touches.shifted(joint, np.where(rows, size, 0.0)))
    return size, x


def _part_of_a_turn(size: float) -> float:
    # A turn in 24 parts at most is what a gear, or an encoder's poles, make of it: the step is such
    # a part if it is nearer than a fourth of the way to the next.
    parts = from_deg(360.0) / np.arange(1, 25)
    nearest = int(np.argmin(np.abs(parts - abs(size))))
    gap = parts[nearest] - parts[min(nearest + 1, len(parts) - 1)]
    if abs(parts[nearest] - abs(size)) < gap / 4.0:
        return float(np.copysign(parts[nearest], size))
    return size


def _where(touches: _Touches, step: _Step) -> str:
    """In which rows it is so, where these are beyond a reading, or follow one another."""
    in_rows = np.flatnonzero(step.rows)
    first, last = int(in_rows[0]), int(in_rows[-1])
    # So many may stand on the wrong side of a threshold.
    doubt = 0.05 * min(len(in_rows), int(touches.own(step.joint).sum()) - len(in_rows))
    if last - first + 1 - len(in_rows) <= doubt:
        return f"from {touches.origin[first]} to {touches.origin[last]}"
    of_joint = touches.own(step.joint)
    q, rows = (
        (touches.q[:, step.joint] + np.where(step.rows, step.size, 0.0))[of_joint],
        step.rows[of_joint],
    )
    files = np.concatenate([term.poses.samples.file_names for term in touches.terms])[of_joint]
    count = f"in {len(in_rows)} of {len(q)} rows, in which its true angle is"
    for sign, side in ((1.0, "above"), (-1.0, "below")):
        if _beyond(sign * q, rows) >= len(in_rows) - doubt:
            edge = sign * np.sort(sign * q[rows])[int(doubt)]
            return f"{count} {side} {text(float(edge), 'rad', with_unit=True)}"
        # Files may have been begun after other turns.
        if sum(_beyond(sign * q[files == f], rows[files == f]) for f in np.unique(files)) >= (
            len(in_rows) - doubt
        ):
            return f"{count} {side} some reading of its file"
    return ""


def _beyond(q: FloatArray, rows: BoolArray) -> int:
    """How many of the rows (n,) are among as many that read most, of readings q (n,)."""
    count = int(np.sum(rows))
    return int(np.sum(rows[np.argsort(q, kind="stable")[len(q) - count :]]))


def _read(terms: Sequence[Term], shifts: FloatArray) -> list[Term]:
    """The terms with their readings shifted, (samples, joints) of all of them."""
    read, first = list[Term](), 0
    for term in terms:
        samples = term.poses.samples
        by = shifts[first : first + len(samples)]
        first += len(samples)
        read.append(
            term.over_poses(term.poses.with_samples(replace(samples, q=samples.q + by)))
            if by.any()
            else term
        )
    return read
