"""What changed is estimated again; all else keeps what is known of it, and learns a little.

Let the calibration say x ~ N(x₀, C). What changed has no prior any more: its rows and columns are
taken out of C, which leaves what is known of the rest. With C = L Lᵀ of that, x = x₀ + L z and
z ~ N(0, 1), the new rows are fitted in z, in what changed and in what they alone must tell:

    minimise |V^-½ r(x)|² + |z|²

by steps of Gauss and Newton, with the covariance V that a check has of the rows' errors. The
curvature there is the inverse of the new covariance. This is the calibration of old and new rows
together, in which what changed has one value before and another one after, to first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from suta_calib.arrays import FloatArray
from suta_calib.check.checking import Check, Checking
from suta_calib.display import Displayable
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.trust.linear_fit import LinearFit


@dataclass(frozen=True, eq=False, repr=False)
class RepairedSolution(Solution):
    """A solution in which some parameters were estimated again, by other rows.

    Attributes:
        known: (n, n) covariance of all parameters; beside_scale: without the scale's part.
        again: names of what was estimated again.
    """

    known: FloatArray | None = None
    beside_scale: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    again: tuple[str, ...] = ()

    @property
    def covariance(self) -> FloatArray:
        """(n, n), m and rad."""
        assert self.known is not None
        return self.known

    @property
    def covariance_within_scale(self) -> FloatArray:
        """The same: the scale is what it was."""
        return self.covariance

    @property
    def told(self) -> tuple[tuple[str, ...], FloatArray]:
        """Names of all estimates (n,), and their covariance (n, n) but for the scale's part."""
        names = tuple(self.problem.names[k] for k in self.free)
        return names, self.beside_scale[np.ix_(self.free, self.free)]


@dataclass(frozen=True, eq=False)
class Repair(Displayable):
    """What changed, estimated again.

    Attributes:
        check: that found it.
        solution: the calibration now.
        before: the calibration as it was.
        rows: how many new rows it rests on.
    """

    check: Check
    solution: RepairedSolution
    before: Solution
    rows: int

    @property
    def names(self) -> tuple[str, ...]:
        """Of what was estimated again."""
        return self.solution.again


def can_repair(check: Check) -> bool:
    """Whether all that changed is described by parameters."""
    return bool(check.changed) and all(change.names for change in check.changed)


def repaired(checking: Checking, check: Check) -> Repair:
    """Estimate again what a check found changed.

    Args:
        checking: the check.
        check: its answer, of which `can_repair` is true.
    """
    if check.first:
        checking = checking.split(check.first)[1]
    bad = [k - check.first for k in check.bad_samples if k >= check.first]
    before = checking.checker.solution
    again = tuple(dict.fromkeys(name for change in check.changed for name in change.names))
    names, covariance = checking.checker.estimated
    kept = [k for k, name in enumerate(names) if name not in again]
    values, vectors = np.linalg.eigh(covariance[np.ix_(kept, kept)])
    factor = vectors * np.sqrt(np.maximum(values, 0.0))
    directions = np.zeros((len(again), 0))
    for change in check.changed:
        mine = np.zeros((len(again), change.directions.shape[1]))
        mine[[again.index(name) for name in change.names]] = change.directions
        directions = np.hstack([directions, mine])
    fit = _Update(checking, tuple(names[k] for k in kept), factor, again, directions, bad)
    known, spread = fit.run()
    was = {**checking.start.values, **checking.checker.values}
    problem, x = _with_added(before, again, {n: v - was[n] for n, v in known.items()})
    index = {name: k for k, name in enumerate(problem.names)}
    every = np.zeros((len(x), len(x)))
    at = np.array([index[name] for name in fit.order if name in index], dtype=np.intp)
    of = np.array([k for k, name in enumerate(fit.order) if name in index], dtype=np.intp)
    every[np.ix_(at, at)] = spread[np.ix_(of, of)]
    scale, old = before.spread.of_scale, before.problem.names
    there = np.array([index[name] for name in old], dtype=np.intp)
    beside = every.copy()
    every[np.ix_(there, there)] += scale
    free = np.flatnonzero(np.diag(beside) > 0)
    state = {name: getattr(before, name) for name in before.__dataclass_fields__}
    state |= {
        "problem": problem,
        "minimum": replace(before.minimum, x=x),
        "free": free,
        "identification": replace(
            before.identification, fixed=np.setdiff1d(np.arange(len(x)), free)
        ),
    }
    solution = RepairedSolution(**state, known=every, beside_scale=beside, again=again)
    return Repair(check, solution, before, check.rows - check.first)


def _with_added(
    solution: Solution, again: Sequence[str], moved: dict[str, float]
) -> tuple[Problem, FloatArray]:
    """The calibrated problem with what it held and what changed as an unknown; values, moved."""
    fitted = solution.problem
    arm = fitted.arm
    more = [] if arm is None else [arm.offered[n] for n in again if n in arm.offered]
    parameters = [*fitted.arm_parameters.values()]
    more = [p for p in more if p.name not in fitted.arm_parameters]
    problem = Problem(fitted.terms, ParameterSet([*parameters, *more]))
    start = solution.values | {p.name: p.nominal for p in more}
    return problem, np.array([start[name] + moved.get(name, 0.0) for name in problem.names])


@dataclass(frozen=True, eq=False)
class _Update:
    """A fit of the new rows beside what is known.

    Attributes:
        checking: the rows, and what their errors are.
        kept: names of the estimates that did not change (k,).
        factor: (k, k) L.
        again: names of what changed (a,).
        directions: (a, r) in which rows tell something of it.
        bad: samples that are left out.
    """

    checking: Checking
    kept: tuple[str, ...]
    factor: FloatArray
    again: tuple[str, ...]
    directions: FloatArray
    bad: Sequence[int]

    @property
    def order(self) -> tuple[str, ...]:
        """Names of the estimates (n,): what is known, what changed, what is the rows' own."""
        names = self.checking.start.problem.names
        return (*self.kept, *self.again, *(names[k] for k in self.checking.own))

    def run(self) -> tuple[dict[str, float], FloatArray]:
        """Values by name, and their covariance (n, n) in `order`."""
        checking, rows = self.checking, self.checking.start
        problem = rows.problem
        index = {name: k for k, name in enumerate(problem.names)}
        seen = np.array([k for k, name in enumerate(self.kept) if name in index], dtype=np.intp)
        at_kept = np.array([index[self.kept[k]] for k in seen], dtype=np.intp)
        moved = np.array([*(index[n] for n in self.again), *checking.own], dtype=np.intp)
        along = np.asarray(block_diag(self.directions, np.eye(len(checking.own))))
        kinds = checking.checker.errors.kinds
        noise = sum(k.weight * v for k, v in zip(kinds, checking.by_noise, strict=True))
        root = np.asarray(np.linalg.cholesky(np.asarray(noise)), dtype=float)
        start, z = rows.x.copy(), np.zeros(self.factor.shape[1])
        left_out = [rows.shared.of_sample(k) for k in self.bad]
        extra = np.hstack([np.zeros((len(rows.residual), 0)), *left_out])
        nothing = np.zeros(along.shape[1] + extra.shape[1])
        precision = np.concatenate([np.ones(len(z)), nothing])
        fit = LinearFit(np.zeros((0, 0)), np.zeros(0))
        # Steps that any repair takes: a change is found by the check already.
        for _ in range(8):
            jacobian = [rows.jacobian[:, at_kept] @ self.factor[seen]]
            jacobian.append(rows.jacobian[:, moved] @ along)
            both = np.hstack([*jacobian, extra, rows.residual[:, None]])
            white = solve_triangular(root, both, lower=True, check_finite=False)
            away = np.concatenate([z, nothing])
            fit = LinearFit(white[:, :-1], white[:, -1], precision, away)
            z = z + fit.step[: len(z)]
            at = rows.x.copy()
            at[moved] += along @ fit.step[len(z) : len(z) + along.shape[1]]
            at[at_kept] = start[at_kept] + self.factor[seen] @ z
            rows = rows.moved_to(at)
            # Of a step, in whitened units, that changes nothing.
            if float(np.linalg.norm(fit.jacobian @ fit.step)) < 1e-4:
                break
        told = len(z) + along.shape[1]
        inverse = fit.inverse[:told, :told]
        mapped = np.asarray(block_diag(self.factor, along))
        shift = self.factor @ z
        old = checking.checker.values
        known = {n: old[n] + float(d) for n, d in zip(self.kept, shift, strict=True)}
        known |= {problem.names[k]: float(rows.x[k]) for k in moved}
        return known, np.asarray(mapped @ inverse @ mapped.T)
