"""Did something change while it was measured? An encoder that slipped, a base that crept away.

Small changes hide: the fit spreads them over its unknowns, and every residual stays plausible. Each
of them moves the tip in its own way, though, from some row on or ever more: a column of derivatives
that no unknown of the job has. It is tested like an eccentric encoder (`score_tests`), with all of
the geometry free to follow, so that nothing is fitted anew. The times of a change are a few, of
which the most telling is then looked for row by row (Andrews 1993, doi:10.2307/2951764).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.diagnostics.score_tests import (
    SUPPORTED,
    Scores,
    known_beforehand,
    offered_names,
    problem_beside,
    scores_of,
)
from suta_calib.distributions import f
from suta_calib.geometry.numbers import skew
from suta_calib.solver.information import Rows, scaled_inverse, whitened_rows
from suta_calib.solver.losses import huber, huber_weight
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.threads import single_threaded
from suta_calib.units import Unit, text

# Of the cost, below which a round of re-weighing changes nothing.
SETTLED: Final = 1e-6


@dataclass(frozen=True)
class ChangeOptions:
    """What is looked for, and from when on it is said.

    Attributes:
        times: at so many evenly spaced rows something may have changed, at first.
        most_times: so many rows are tried for the change that was found, and half as many about
            the most telling of them.
        fewest: rows before and after a change.
        level: chance that one of all tests calls sound data changed.
        share: of a term's squares without its gross errors, which a change must explain: where the
            model lacks much, and rows are many, everything is significant and little of it is the
            cause.
        worth_a_look: times that share, from which on the row is looked for at which it happened:
            at the few rows that are tried first, it seems to explain less.
        turn, travel, shift: what is plausible, rad, per unit and m: what the data tell only beyond
            that is not tested.
        tried: so many of what may have changed are told apart by what they leave.
        rounds: of re-weighing rows for that, at most.
    """

    times: int = 5
    most_times: int = 40
    fewest: int = 10
    level: float = 1e-3
    share: float = 0.25
    worth_a_look: float = 0.3
    turn: float = 0.01
    travel: float = 2e-3
    shift: float = 5e-3
    tried: int = 3
    rounds: int = 20


@dataclass(frozen=True)
class Change:
    """Something that was not the same for all rows.

    Attributes:
        kind: ``slip``, ``drift`` or ``travel`` of an encoder; ``base`` or ``tip`` that was moved;
            ``base creep``, ``tip creep``.
        joint: whose encoder it is; empty otherwise.
        since: file and row from which on it is so; empty where it is so all along.
        size, std: by how much, and its standard deviation: rad of a slip, and of a drift until the
            last row; a number of a travel; metres of what was moved or crept until the last row.
        p: chance of residuals so suspicious, allowing for the number of tests.
    """

    kind: str
    joint: str
    since: str
    size: float
    std: float
    p: float

    @property
    def sentence(self) -> str:
        """What it is, and what to look at."""
        if self.kind == "travel":
            return (
                f"{self.joint} reads {100 * self.size:+.3f} ± {100 * self.std:.3f} % of its travel "
                "too much: does its encoder lose or double counts, or is a gear ratio wrong?"
            )
        unit: Unit = "rad" if self.kind in ("slip", "drift") else "m"
        by = f"{text(self.size, unit)} ± {text(self.std, unit, with_unit=True)}"
        if self.kind == "slip":
            return (
                f"{self.joint} reads {by} more from {self.since} on than before: did its encoder "
                "slip, or was its zero set anew?"
            )
        if self.kind == "drift":
            return (
                f"The zero of {self.joint} drifted by {by} while the rows were measured: let it "
                "warm up, and look whether its encoder sits fast."
            )
        what = "tool, or what is on it," if self.kind.startswith("tip") else "base, or what it met,"
        if self.kind.endswith("creep"):
            return f"The {what} crept by {by} while the rows were measured: let it warm up, fix it."
        return (
            f"The {what} was moved by {by} at {self.since}: give the rows after it another label."
        )


@dataclass(frozen=True, eq=False)
class _Suspect:
    """Columns of one change.

    Attributes:
        kind, joint: as of the change; kind ``model`` where a model lacks something instead.
        start: the term's row from which on it is so; -1 where it is so all along.
        velocity: (6·samples, k) of every tip, per unit.
        plausible: (k,) size.
    """

    kind: str
    joint: str
    start: int
    velocity: FloatArray
    plausible: FloatArray


@dataclass(frozen=True, eq=False)
class _Fit:
    """The problem with all of the geometry unknown, where that has followed the data.

    Attributes:
        problem: with what a model may lack among its parameters.
        rows: of it, residuals and weights as all of the geometry leaves them.
        prior: (n,) information that all parameters have beforehand.
        away: (n,) from where that says they are.
        lacking: indices of what a model may lack, by joint and family.
        known: (k,) indices of all that is no geometry: it stays out of the fit.
        spent: how many unknowns the data have told.
    """

    problem: Problem
    rows: Sequence[Rows]
    prior: FloatArray
    away: FloatArray
    lacking: dict[str, IntArray]
    known: IntArray
    spent: float

    @property
    def equations(self) -> int:
        """Independent ones."""
        return sum(term.equations() for term in self.problem.terms)


@lru_cache(maxsize=4)
@single_threaded
def changes(solution: Solution, options: ChangeOptions = ChangeOptions()) -> tuple[Change, ...]:
    """The most telling change in each term, where there is one, the most certain first.

    Args:
        solution: a converged one, of terms over an arm.
        options: what is looked for.
    """
    arm = solution.problem.arm
    if arm is None:
        return ()
    problem, x = problem_beside(solution)
    place = {name: k for k, name in enumerate(problem.names)}
    offered = {
        key: np.array([place[n] for n in names if n not in solution.problem.parameters], np.intp)
        for key, names in offered_names(arm).items()
    }
    # A gain is the travel of an encoder, which is looked for as such.
    lacking = {
        f"{joint} {family}": at
        for (joint, family), at in offered.items()
        if len(at) and family != "gain"
    }
    known = np.concatenate([*offered.values(), np.zeros(0, dtype=np.intp)])
    fit = _beside_geometry(solution, problem, x, lacking, known, options)
    found: dict[tuple[str, str], Change] = {}
    for k, term in enumerate(problem.terms):
        if len(term.poses) > 2 * options.fewest:
            change = _in_term(fit, k, options)
            if change is not None:
                found.setdefault((change.kind, change.joint), change)
    return tuple(sorted(found.values(), key=lambda change: change.p))


def _beside_geometry(
    solution: Solution,
    problem: Problem,
    x: FloatArray,
    lacking: dict[str, IntArray],
    known: IntArray,
    options: ChangeOptions,
) -> _Fit:
    """What is left once all of the geometry has followed, as far as is plausible."""
    prior = known_beforehand(problem)
    # The job's priors pull where the job's fit has ended.
    away = np.where(problem.prior_precision() > 0, x - problem.parameters.array("nominal"), 0.0)
    rows = whitened_rows(problem, x, solution.sigmas)
    fit = _Fit(problem, rows, prior, away, lacking, known, 0.0)
    followed = _followed(fit, None, options)
    away[followed.free] += followed.step
    moved = []
    for r in rows:
        n, size = r.line.residual.shape
        change = (r.jacobian[:, followed.free] @ followed.step).reshape(n, size)
        residual = r.line.residual + change * r.line.sigma[:, None]
        squared = np.einsum("nd,nd->n", residual, residual) / r.line.sigma**2
        weight = huber_weight(squared, r.line.view.threshold / r.line.sigma)
        moved.append(replace(r, line=replace(r.line, residual=residual, weight=weight)))
    return _Fit(problem, moved, prior, away.copy(), lacking, known, followed.spent)


def _in_term(fit: _Fit, term: int, options: ChangeOptions) -> Change | None:
    count = len(fit.problem.terms[term].poses)
    times = np.linspace(0, count, options.times + 2)[1:-1].astype(np.intp)
    # A few gross errors would be nearly all of the squares, and no change explains them.
    mine = [
        r for r in fit.rows if any(r.line.view.block is b for b in fit.problem.terms[term].blocks)
    ]
    needed = options.share * sum(float(np.sum(_sound(r) ** 2)) for r in mine)
    least = options.worth_a_look * needed
    telling = _telling(fit, [*_suspects(fit, term, times, options)], least, options)
    if not telling:
        return None
    # A large change saturates the scores of what is like it too: what it leaves tells them apart,
    # each at the row where it explains most.
    kinds = list(dict.fromkeys((s.kind, s.joint) for s, _ in telling))[: options.tried]
    tried = list[tuple[_Followed, _Suspect]]()
    first, last = options.fewest, count - options.fewest
    for share in (1.0, 0.5):
        most = round(share * options.most_times)
        rows: IntArray = np.unique(np.linspace(first, last, most).astype(np.intp))
        tried += [
            (_followed(fit, suspect, options), suspect)
            for suspect in _suspects(fit, term, rows, options)
            if (suspect.kind, suspect.joint) in kinds and (share == 1.0 or suspect.start >= 0)
        ]
        # Some rows off, some touches are gross: once more between its neighbours.
        best = min(tried, key=lambda each: (each[1].start < 0, each[0].left))[1].start
        near = math.ceil((last - first) / max(most - 1, 1))
        first, last = max(best - near, first), min(best + near, last)
    followed, suspect = min(tried, key=lambda each: each[0].left)
    lowered = _followed(fit, None, options).left - followed.left
    if suspect.kind == "model" or lowered < needed:
        return None
    origin = fit.problem.terms[term].poses.samples.origin
    since = origin[suspect.start] if suspect.start >= 0 else ""
    # Its chance is that of the few times that were tried among all suspects.
    size, std = followed.size(fit)
    return Change(suspect.kind, suspect.joint, since, size, std, telling[0][1])


def _suspects(fit: _Fit, term: int, times: IntArray, options: ChangeOptions) -> Iterator[_Suspect]:
    """What may have changed at those rows of a term, and what is wrong all along."""
    problem = fit.problem
    arm, table = problem.arm, problem.evaluation.table
    assert arm is not None
    row = np.arange(len(table.position)) - int(table.first[term])
    count = len(problem.terms[term].poses)
    mine = (row >= 0) & (row < count)
    based = _rigid(table.position - table.position[mine].mean(axis=0))
    # The same along the tip's own axes, which are the rows here.
    axes = np.swapaxes(table.rotation.reshape(-1, 3, 3), 1, 2)
    held = np.zeros_like(based)
    held[:, :3, :3] = held[:, 3:, 3:] = axes
    moved = {"base": based, "tip": held}
    turn = np.array([options.turn])
    twist = np.repeat([options.shift, options.turn], 3)
    of_movers = table.velocity[:, [problem.names.index(name) for name in arm.offsets]]
    of_readings = (of_movers @ arm.gearing).reshape(-1, 6, len(arm.joints))
    velocity = {joint: of_readings[:, :, [k]] for k, joint in enumerate(arm.joints)}

    def columns(motion: FloatArray, share: FloatArray) -> FloatArray:
        return np.asarray((motion * share[:, None, None]).reshape(-1, motion.shape[2]))

    for start in times.tolist():
        later = (mine & (row >= start)).astype(float)
        for joint, motion in velocity.items():
            # What the encoder reads too much, the arm is turned less.
            yield _Suspect("slip", joint, start, columns(-motion, later), turn)
        for kind, motion in moved.items():
            yield _Suspect(kind, "", start, columns(motion, later), twist)
    so_far = np.where(mine, row / count, 0.0)
    for joint, motion in velocity.items():
        yield _Suspect("drift", joint, -1, columns(-motion, so_far), turn)
    for kind, motion in moved.items():
        creeping = columns(motion, so_far)
        yield _Suspect(f"{kind} creep", "", -1, creeping, twist)
    q = np.vstack([t.poses.samples.q for t in problem.terms])
    for k, (joint, motion) in enumerate(velocity.items()):
        reads = columns(-motion, q[:, k] - q[:, k].mean())
        yield _Suspect("travel", joint, -1, reads, np.array([options.travel]))
    plausible = problem.parameters.array("plausible")
    for name, at in fit.lacking.items():
        yield _Suspect("model", name, -1, table.velocity[:, at], plausible[at])


def _rigid(position: FloatArray) -> FloatArray:
    """(n, 6, 6) velocities of tips at points (n, 3) for a unit of every part of a twist."""
    found = np.zeros((len(position), 6, 6))
    found[:, :3, :3] = found[:, 3:, 3:] = np.eye(3)
    found[:, :3, 3:] = -skew(position)
    return found


def _telling(
    fit: _Fit, suspects: Sequence[_Suspect], least: float, options: ChangeOptions
) -> list[tuple[_Suspect, float]]:
    """The suspects that explain more squares than ``least``, and so many that it is no chance.

    Returns:
        Each with that chance, least first.
    """
    beside = np.concatenate([s.plausible for s in suspects])
    ends = np.cumsum([0, *(len(s.plausible) for s in suspects)])
    scores = _scores(fit, np.hstack([s.velocity for s in suspects]), beside)
    found, told = [], 0
    for suspect, first, last in zip(suspects, ends[:-1], ends[1:], strict=True):
        group = np.arange(first, last, dtype=np.intp)
        group = group[scores.telling[group]]
        freedom = [int(n - fit.spent - len(group)) for n in (scores.touches, fit.equations)]
        if not len(group) or min(freedom) < 1:
            continue
        told += 1
        lowered = float(scores.score[group] @ scores.step(group))
        share = lowered / scores.squares
        # A step of a robust fit may promise more than there is.
        ratio = share / max(1.0 - share, 1e-3) * freedom[1] / len(group)
        p = float(f.sf(max(ratio, 0.0), len(group), freedom[1]))
        if lowered > least and scores.p_by_touch(group, freedom[0]) < SUPPORTED:
            found.append((p, share, suspect))
    found.sort(key=lambda each: (each[0], -each[1]))
    return [(suspect, told * p) for p, _, suspect in found if told * p < options.level]


def _whitened(rows: Rows) -> FloatArray:
    """Residuals (n, d) in units of their noise."""
    return np.asarray(rows.line.residual / rows.line.sigma[:, None])


def _sound(rows: Rows) -> FloatArray:
    """Those (k, d) of them that are no gross errors."""
    return np.asarray(_whitened(rows)[rows.line.weight >= 1.0])


def _widened(fit: _Fit, velocity: FloatArray) -> list[Rows]:
    """The rows with a column for each of the velocities (6·samples, k)."""
    wide = []
    for r in fit.rows:
        by_pose = r.line.by_pose / r.line.sigma[:, None, None]
        columns = r.line.pattern.by_parameters(by_pose, velocity)
        wide.append(replace(r, jacobian=np.hstack([r.jacobian, columns])))
    return wide


def _scores(fit: _Fit, velocity: FloatArray, plausible: FloatArray) -> Scores:
    """Of every column beside the job's unknowns and all of the geometry."""
    count = len(fit.problem.names)
    tested = np.arange(count, count + len(plausible), dtype=np.intp)
    rows = _widened(fit, velocity)
    return scores_of(fit.problem, rows, tested, fit.known, plausible, fit.away)


@dataclass(frozen=True, eq=False)
class _Followed:
    """A fit of everything, linear but robust.

    Attributes:
        free: (p,) columns that follow.
        step: (p,) by how much.
        inverse: (p, p) of the curvature.
        left: cost that is left, of rows and priors.
        scatter: that of the rows.
        spent: how many unknowns the data have told.
    """

    free: IntArray
    step: FloatArray
    inverse: FloatArray
    left: float
    scatter: float
    spent: float

    def size(self, fit: _Fit) -> tuple[float, float]:
        """Of the change, and its standard deviation: a number, or the length of a shift."""
        own = self.free >= len(fit.problem.names)
        # Rows that share touches say less than their number.
        variance = self.scatter / max(fit.equations - self.spent, 1.0)
        found, covariance = self.step[own], variance * self.inverse[np.ix_(own, own)]
        if len(found) == 1:
            return float(found[0]), float(np.sqrt(covariance[0, 0]))
        size = float(np.linalg.norm(found[:3]))
        along = found[:3] / max(size, 1e-300)
        return size, float(np.sqrt(along @ covariance[:3, :3] @ along))


def _followed(fit: _Fit, suspect: _Suspect | None, options: ChangeOptions) -> _Followed:
    """Everything follows, a change with it, rows weighed anew by what is left of them.

    Args:
        fit: where it begins.
        suspect: the change; None for the geometry alone.
        options: how often rows are weighed.
    """
    count = len(fit.problem.names)
    velocity = np.zeros((0, 0)) if suspect is None else suspect.velocity
    wide = fit.rows if suspect is None else _widened(fit, velocity)
    free = np.setdiff1d(np.arange(count + velocity.shape[1]), fit.known)
    own = free >= count
    prior, away = np.zeros(len(free)), np.zeros(len(free))
    prior[~own], away[~own] = fit.prior[free[~own]], fit.away[free[~own]]
    rows = [
        (
            r.jacobian[:, free].reshape(*r.line.residual.shape, len(free)),
            _whitened(r),
            r.line.view.threshold / r.line.sigma,
        )
        for r in wide
    ]
    step, left, spent, inverse = np.zeros(len(free)), np.inf, 0.0, np.zeros((len(free),) * 2)
    scatter = np.inf
    for _ in range(options.rounds):
        told, gradient, cost = np.zeros((len(free),) * 2), prior * away, 0.0
        for jacobian, residual, threshold in rows:
            squared = np.sum((residual + jacobian @ step) ** 2, axis=1)
            cost += float(np.sum(huber(squared, threshold)))
            root = np.sqrt(huber_weight(squared, threshold))
            believed = (jacobian * root[:, None, None]).reshape(-1, len(free))
            told += believed.T @ believed
            gradient += believed.T @ (residual * root[:, None]).reshape(-1)
        pulled = float(prior @ (away + step) ** 2)
        if cost + pulled > (1.0 - SETTLED) * left:
            break
        inverse, left, scatter = scaled_inverse(told + np.diag(prior)), cost + pulled, cost
        spent = float(np.sum(inverse * told))
        step = -inverse @ gradient
    return _Followed(free, step, inverse, left, scatter, spent)
