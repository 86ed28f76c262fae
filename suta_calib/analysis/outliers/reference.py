"""Which samples belong together, and a fit again without some of them: exact, quick, and judged.

Leaving out keeps the parameters, what is held and the assumed noise as they were, and starts where
the whole fit's equations without the rows lead, so that one or two Gauss-Newton steps suffice.
Compiled functions are shared (`Term.take`). Nothing is approximated: the refit is carried to the
minimum. What leaving them out would do on data that were not fitted, `Judge` says.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import PurePath
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import orth

from suta_calib.analysis.outliers.result import HeldOut
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import register_points
from suta_calib.measurements.samples import joined
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.compiled_residual import term_residuals
from suta_calib.solver.gauss_newton import GaussNewton
from suta_calib.solver.information import (
    noise_levels,
    robust_jacobian,
    scaled_inverse,
    whitened_rows,
)
from suta_calib.solver.nlp import RobustNlp
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.block import grouped
from suta_calib.terms.landmark import certified_positions
from suta_calib.terms.term import Term
from suta_calib.trust.accuracy import fit_own


@dataclass(frozen=True, eq=False)
class Grouping:
    """A partition of a term's samples into ``landmarks``, ``rows`` and so on.

    ``member`` (samples,) is the number of the group, in the order of ``labels``, of each sample.
    """

    name: str
    labels: tuple[str, ...]
    member: IntArray

    def __len__(self) -> int:
        return len(self.labels)

    def rows(self, group: int) -> NDArray[np.bool_]:
        """(samples,) which samples are in a group."""
        return np.asarray(self.member == group)


def groupings(term: Term) -> tuple[Grouping, ...]:
    """Every partition that the term's kind knows, at least three groups each.

    Sets, where every placement was gone through once, are placements.
    """
    labels, by_columns = term.poses.samples.labels, dict[tuple[str, ...], Grouping]()
    for noun, columns in term.groupings.items():
        if not set(columns) <= set(labels):
            continue
        names, member = grouped(joined(labels, columns) if columns else row_names(term))
        grouping = Grouping(f"{noun}s", tuple(names), member)
        coarser = by_columns.get(columns[:-1])
        if coarser is None or len(coarser) < len(grouping):
            by_columns[columns] = grouping
    # With fewer, "unlike the others" means nothing.
    return tuple(g for g in by_columns.values() if len(g) >= 3)


def row_names(term: Term) -> NDArray[np.str_]:
    """``file.csv:12`` for every sample; with its folder where file names repeat."""
    origin = term.poses.samples.origin
    short = [PurePath(place).name for place in origin]
    if len(set(short)) == len(short):
        return np.array(short)
    counts = Counter(origin)
    return np.array([f"{o} ({k})" if counts[o] > 1 else o for k, o in enumerate(origin)])


def touch_name(term: Term, row: int) -> str:
    """What was touched, for a sentence."""
    labels = term.poses.samples.labels
    if term.touched is not None:
        return "{} at {}/{}".format(*(labels[k][row] for k in ("landmark", "placement", "repeat")))
    return str(labels[term.place][row]) if term.place else f"row {row}"


@dataclass(frozen=True, eq=False)
class Registered:
    """The touches of a term that knows an artefact, by placement."""

    term: Term  # the touches
    certified: FloatArray  # (n, 3) positions of the touched landmarks in the artefact, m
    # (n,) number of each touch's placement; of placement and landmark.
    placement: IntArray
    cell: IntArray
    used: BoolArray  # (n,) touches that decide the registration

    @classmethod
    def of(cls, term: Term, used: BoolArray) -> Registered | None:
        """None where the term knows no artefact."""
        if term.touched is None:
            return None
        certified, labels = certified_positions(term.poses, term.touched), term.poses.samples.labels
        placement = grouped(labels["placement"])[1]
        names, landmark = grouped(labels["landmark"])
        return cls(term, certified, placement, placement * len(names) + landmark, used)

    def residuals(self, values: Mapping[str, float]) -> FloatArray:
        """(n, 3) touched minus certified positions in the artefact's frame, m."""
        _, position = self.term.poses.at(values)
        residuals = np.zeros((len(position), 3))
        for rows, used in self._by_placement():
            r, p = register_points(position[used], self.certified[used])
            residuals[rows] = position[rows] @ r.T + p - self.certified[rows]
        return residuals

    def registered(self, displacements: FloatArray) -> FloatArray:
        """The same for small displacements (k, n, 3) of the touches, m, to first order."""
        registered = np.zeros_like(displacements)
        for rows, used in self._by_placement():
            centre = self.certified[used].mean(axis=0)
            motion = np.linalg.pinv(rigid_columns(self.certified[used] - centre))
            there = displacements[:, used].reshape(len(registered), -1)
            back = rigid_columns(self.certified[rows] - centre) @ (motion @ there.T)
            registered[:, rows] = displacements[:, rows] - back.T.reshape(len(registered), -1, 3)
        return registered

    def _by_placement(self) -> list[tuple[IntArray, IntArray]]:
        rows_and_used = []
        for k in range(int(self.placement.max()) + 1):
            rows = np.flatnonzero(self.placement == k)
            used = rows[self.used[rows]]
            rows_and_used.append((rows, used if len(used) >= 3 else rows))
        return rows_and_used


def rigid_columns(points: FloatArray) -> FloatArray:
    """(3 n, 6) displacements of points (n, 3) by unit translations and turns."""
    columns = np.zeros((len(points), 3, 6))
    columns[:, :, :3] = np.eye(3)
    for k, axis in enumerate(np.eye(3)):
        columns[:, :, 3 + k] = np.cross(axis, points)
    return columns.reshape(-1, 6)


def systematic(
    residual: FloatArray, rows: BoolArray, level: str, registered: Registered
) -> FloatArray:
    """(k,) the part of the residuals (k, n, 3), m, that repeating would not average away.

    Of a landmark: the length of its mean residual. Of a placement: the RMS over its landmarks of
    the mean over their repeats. Of a set: the RMS displacement of its touches by the rigid motion
    that fits them best, which is what a slip of the artefact between repeats looks like.
    """
    mine = residual[:, rows]
    if level == "landmarks":
        return np.asarray(np.linalg.norm(mine.mean(axis=1), axis=1))
    if level == "placements":
        cell = registered.cell[rows]
        means = [mine[:, cell == c].mean(axis=1) for c in np.unique(cell)]
        return np.asarray(np.sqrt(np.mean(np.sum(np.array(means) ** 2, axis=2), axis=0)))
    points = registered.certified[rows]
    basis = orth(rigid_columns(points - points.mean(axis=0)))
    along = mine.reshape(len(mine), -1) @ basis
    return np.asarray(np.sqrt(np.sum(along**2, axis=1) / rows.sum()))


# Information, relative to the whole, that is a difference of equal numbers.
ROUNDING: Final = 1e-9
# Errors before and after an exclusion, and which of them count.
_Compared = tuple[FloatArray, FloatArray, BoolArray]


@dataclass(frozen=True, eq=False)
class _RowParts:
    """What each of a block's rows, which look at ``samples`` (n, k), adds to a step's equations.

    The matrix is the square of ``curved`` (n, d, p), the gradient the sum of ``gradient`` (n, p).
    """

    samples: IntArray
    curved: FloatArray
    gradient: FloatArray


# Names, those free (p,), matrix (p, p) and gradient (p,), and what rows of the term are in them.
_Linear = tuple[tuple[str, ...], IntArray, FloatArray, FloatArray, list[_RowParts]]


@dataclass(frozen=True, eq=False)
class Refit:
    """A fit over some of a term's samples."""

    used: BoolArray  # (samples,) which were fitted
    # Parameters by name; what was solved, and where.
    values: Mapping[str, float]
    problem: Problem
    x: FloatArray
    residual: FloatArray  # (n, d) of the term's first block, m
    sigma: FloatArray  # (n,) assumed standard deviation of a component
    samples: IntArray  # (n, k) which samples each residual looks at, numbered as in the whole term
    converged: bool  # whether the solver says so

    @property
    def squared(self) -> FloatArray:
        """(n,) squared errors, m²."""
        return np.asarray(np.einsum("nd,nd->n", self.residual, self.residual))

    @property
    def rms(self) -> float:
        """Root mean square error, m."""
        return float(np.sqrt(np.mean(self.squared)))


@dataclass(eq=False)
class ReferenceFit:
    """Terms, of which one is looked at, and the fit of all of them."""

    terms: tuple[Term, ...]  # of the job, or of the job over some samples
    index: int  # the term that is looked at
    parameters: ParameterSet  # the arm's
    estimated: frozenset[str]  # names of the parameters that may move
    values: Mapping[str, float]  # where every refit starts
    sigmas: Mapping[tuple[int, str], float]  # assumed noise by term and block
    _fits: dict[bytes, Refit | None] = field(default_factory=dict)

    @classmethod
    def of(cls, solution: Solution, parameters: ParameterSet, index: int) -> ReferenceFit:
        """The fit as it is."""
        fixed = {solution.problem.names[k] for k in solution.identification.fixed}
        free_names = {n for n, p in solution.problem.parameters.items() if p.free}
        return cls(
            solution.problem.terms,
            index,
            parameters,
            frozenset(free_names - fixed),
            solution.values,
            _by_block(solution.problem.terms, solution.sigmas),
        )

    def freed(self, arm: ParameterSet, used: BoolArray) -> ReferenceFit:
        """The same with further parameters, and with the noise (of ``used``) that is left then."""
        more = {n for n, p in arm.items() if p.free and n not in self.parameters}
        values = {n: p.nominal for n, p in arm.items()} | dict(self.values)
        estimated = self.estimated | more
        freed = replace(self, parameters=arm, estimated=estimated, values=values, _fits={})
        fit = freed.over(used)
        if fit is None:
            return freed
        sigmas = freed.block_sigmas(fit.problem.terms)
        noise = noise_levels(fit.problem, fit.x, sigmas)
        sigmas_of_fit = dict(self.sigmas) | _by_block(fit.problem.terms, noise)
        return replace(freed, values=values | dict(fit.values), sigmas=sigmas_of_fit, _fits={})

    @property
    def term(self) -> Term:
        """The term that is looked at."""
        return self.terms[self.index]

    def over(self, used: BoolArray) -> Refit | None:
        """The fit over ``used`` (samples,) of the term; None if nothing left can be fitted."""
        key = used.tobytes()
        if key not in self._fits:
            self._fits[key] = self._fit(used)
        return self._fits[key]

    def block_sigmas(self, terms: Sequence[Term]) -> list[float]:
        """Assumed noise of every block of these terms, which stand for the reference's."""
        return [self.sigmas[k, b.name] for k, t in enumerate(terms) for b in t.blocks]

    def _foreseen(self, used: BoolArray) -> Mapping[str, float]:
        """The parameters, one Gauss-Newton step from the reference's over ``used``."""
        if used.all():
            return self.values
        names, free, full_hessian, gradient, mine = self._linear
        hessian = full_hessian
        for row in mine:
            gone = ~used[row.samples].all(axis=1)
            curved = row.curved[gone].reshape(-1, len(free))
            hessian = hessian - curved.T @ curved
            gradient = gradient - row.gradient[gone].sum(axis=0)
        # What only the left-out rows determined goes with them: their place, their point.
        left = np.flatnonzero(np.diag(hessian) > ROUNDING * np.diag(full_hessian))
        # Eigenvalue of the equations of a step, of the largest, that is rounding.
        step = -scaled_inverse(hessian[np.ix_(left, left)], 1e-10) @ gradient[left]
        moved = [names[k] for k in free[left]]
        return dict(self.values) | {
            name: self.values[name] + float(d) for name, d in zip(moved, step, strict=True)
        }

    @cached_property
    def _linear(self) -> _Linear:
        """The equations of a step at the reference's values over all samples, and the term's."""
        problem = Problem(self.terms, self.parameters)
        names = problem.names
        x = np.array([self.values[n] for n in names])
        free = np.array([k for k, n in enumerate(names) if n in self.estimated], dtype=np.intp)
        precision = problem.prior_precision()[free]
        hessian = np.diag(precision)
        gradient = precision * (x - problem.parameters.array("nominal"))[free]
        blocks, mine = self.term.blocks, []
        for rows in whitened_rows(problem, x, self.block_sigmas(self.terms)):
            line = rows.line
            n, size = line.residual.shape
            curved = robust_jacobian(rows)[:, free].reshape(n, size, -1)
            by_row = rows.jacobian[:, free].reshape(n, size, -1)
            scores = np.einsum("ndp,nd,n->np", by_row, line.residual, line.weight / line.sigma)
            hessian = hessian + np.tensordot(curved, curved, ((0, 1), (0, 1)))
            gradient = gradient + scores.sum(axis=0)
            if any(line.view.block is b for b in blocks):
                mine.append(_RowParts(line.view.block.samples, curved, scores))
        return names, free, hessian, gradient, mine

    def _fit(self, used: BoolArray) -> Refit | None:
        try:
            mine = self.term.take(np.flatnonzero(used))
            mine.check_enough()
        except (InputError, ValueError):
            return None
        terms = [mine if k == self.index else t for k, t in enumerate(self.terms)]
        problem = Problem(terms, self.parameters)
        names = problem.names
        values = self._foreseen(used)
        start = problem.start(values)
        start = np.array([values.get(n, float(s)) for n, s in zip(names, start, strict=True)])
        free = np.array([k for k, n in enumerate(names) if n in self.estimated], dtype=np.intp)
        sigmas = self.block_sigmas(terms)
        # Share of the cost that a refit may promise to lose where its next step is the last: of
        # 1,000 rows 0.03 standard deviations, of which that step leaves a hundredth.
        solver = GaussNewton(confirm=False, settled=1e-6)
        minimum = solver.minimise(RobustNlp(problem, free, sigmas), start)
        fitted_values, block = problem.values(minimum.x), mine.blocks[0]
        return Refit(
            used,
            fitted_values,
            problem,
            minimum.x,
            term_residuals(mine, fitted_values)[0],
            np.hypot(self.sigmas[self.index, block.name], block.known_sigma),
            np.flatnonzero(used)[block.samples],
            minimum.converged,
        )


def _by_block(terms: Sequence[Term], sigmas: Sequence[float]) -> dict[tuple[int, str], float]:
    blocks = [(k, b.name) for k, t in enumerate(terms) for b in t.blocks]
    return dict(zip(blocks, sigmas, strict=True))


@dataclass(frozen=True, eq=False)
class Judge:
    """Held-out errors of the job's own fit with a group and without it.

    Without ``validation`` terms, which are never fitted, the samples are held out in turn.
    """

    reference: ReferenceFit
    validation: tuple[Term, ...]

    @property
    def method(self) -> str:
        """How data were held out."""
        if self.validation:
            return "validation"
        return f"leave one of the {self._folds()[0]} out"

    def of(self, grouping: Grouping, group: int) -> HeldOut | None:
        """The effect of excluding one group; None where nothing would be left to fit or judge."""
        rows, parts = grouping.rows(group), []
        nothing = np.zeros(len(rows), dtype=bool)
        for fold in [nothing] if self.validation else self._folds()[1]:
            before, after = self.reference.over(~fold), self.reference.over(~fold & ~rows)
            if before is None or after is None:
                continue
            for term in self.validation:
                out = np.zeros(len(term.poses), dtype=bool)
                if grouping.name == "landmarks" and "landmark" in term.poses.samples.labels:
                    out = term.poses.samples.labels["landmark"] == grouping.labels[group]
                parts.append(self._compared(term, before, after, out))
            if fold.any():
                with suppress(InputError):
                    left_out = self.reference.term.take(np.flatnonzero(fold))
                    parts.append(self._compared(left_out, before, after, rows[fold]))
        return _summary(parts)

    def _folds(self) -> tuple[str, list[BoolArray]]:
        """Placements, as their repeats are no independent clusters; else points, else rows."""
        # Folds that rows without placements or points are dealt into.
        folds = 10
        by_name = {g.name: g for g in groupings(self.reference.term)}
        for name in ("placements", "sets", "points"):
            if name in by_name:
                return name, [by_name[name].rows(k) for k in range(len(by_name[name]))]
        n = len(self.reference.term.poses)
        dealt = np.random.default_rng(0).permutation(n) % min(folds, n)
        return f"{min(folds, n)} parts", [dealt == k for k in range(min(folds, n))]

    def _compared(self, term: Term, before: Refit, after: Refit, out: BoolArray) -> _Compared:
        """Errors of a held-out term before and after, and which of them touch no excluded row."""
        arm = self.reference.parameters
        first, samples = held_out_errors(term, arm, before.values)
        second, _ = held_out_errors(term, arm, after.values)
        return first, second, ~out[samples].any(axis=1)


def held_out_errors(
    term: Term, parameters: ParameterSet, values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Error norms (n,) of a held-out term's first block, m, and the samples of each (n, k).

    The arm is held; the term's own unknowns keep their value where it is known and are fitted
    where it is not.
    """
    arm = {p.name: values.get(p.name, p.nominal) for p in parameters.values()}
    own_values = {p.name: values[p.name] for p in term.own_parameters if p.name in values}
    fitted = arm | own_values
    if len(own_values) < len(term.own_parameters):
        fitted = fit_own([term], parameters, fitted)
    error = term_residuals(term, fitted)[0] * term.blocks[0].relative
    return np.linalg.norm(error, axis=1), np.asarray(term.blocks[0].samples)


def _summary(parts: Sequence[_Compared]) -> HeldOut | None:
    if not parts:
        return None
    before, after, counted = (np.concatenate(part) for part in zip(*parts, strict=True))
    if not counted.any():
        return None
    first, second, everything = (
        float(np.sqrt(np.mean(errors**2))) for errors in (before[counted], after[counted], after)
    )
    return HeldOut(first, second, everything, int(counted.sum()))
