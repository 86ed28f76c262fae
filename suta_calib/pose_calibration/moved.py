"""Was something moved between the poses? A bumped camera, a target that slid, a tip that bent.

The fit spreads what happened over its unknowns, the scatter grows, and every row stays plausible.
An unknown that is another from some row on has columns of its own, though: those of the unknown,
with zeros before that row; one that drifts has them in proportion to the row. They are tested as
`diagnostics.changes` tests an arm's, without a solve: sums over rows are all that it takes. Where
the change came late, few rows disagree with the rest, and are left out one by one; then it tells
that they follow one another.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.pose_calibration.robust_fit import RobustFit
from suta_calib.pose_calibration.serial_correlation import correlation_length
from suta_calib.solver.information import whitened_rows
from suta_calib.units import deg, text

# Rows before and after, and rows (evenly spaced ones) at which it may have happened.
FEWEST: Final = 4
TIMES: Final = 40
# Chance that one of all tests calls sound data changed.
FALSE_ALARM: Final = 1e-3
# Share of a block's squares that a change must explain where neighbours go on to err alike beside
# it: a hand that errs alike in like poses seems to change on its way. Where so many rows as tell it
# have nothing but white noise left it is no such thing, and so much is worth a word: of many rows
# anything is significant.
SHARE: Final = 0.7
ENOUGH_TO_TELL: Final = 60
WORTH: Final = 0.1
# Information, as a share of the unknown's own, below which nothing tells a change.
TOLD: Final = 1e-6
# What is left of exact poses, in units of the scatter that the change made.
EXACT: Final = 1e-6
# Standard deviations that a shift or a turn must be away from zero to be said.
SEVERAL: Final = 3.0
# Rows that disagree, from which on it is no chance that they follow one another; and how many of a
# run may agree all the same, or of all that disagree be elsewhere, as a share.
RUN: Final = 3
STRAYS: Final = 0.1


@dataclass(frozen=True)
class Moved:
    """What was not the same for all rows.

    Attributes:
        what: the unknown.
        since: row, from 0, from which on it is another; the first one where it drifts.
        by, by_std: how far, and its standard deviation, m; NaN where the rows before or after
            disagree with the rest, so that they are not fitted.
        turn, turn_std: rad; NaN where the unknown is a point.
        drifts: whether it changes little by little; then by so much until the last row.
    """

    what: str
    since: int
    by: float = math.nan
    by_std: float = math.nan
    turn: float = math.nan
    turn_std: float = math.nan
    drifts: bool = False

    def sentence(self, rows: str) -> str:
        """What happened.

        Args:
            rows: what a row is, in the plural.
        """
        if math.isnan(self.by):
            return (
                f"The {rows} that do not agree are nearly all before row {self.since}, or nearly "
                f"all from there on (rows from 0): was {self.what} moved in between?"
            )
        by = f"{text(self.by, 'm')} ± {text(self.by_std, 'm', with_unit=True)}"
        if not math.isnan(self.turn):
            by += f" and {deg(self.turn):.2f} ± {deg(self.turn_std):.2f}°"
        if self.drifts:
            return (
                f"From the first row to the last {self.what} drifts, by {by} in all: something "
                f"creeps, slips or warms up. Fix it, or take {rows} of a shorter time."
            )
        return (
            f"From row {self.since} on (rows from 0) {self.what} stands elsewhere, by {by}: it was "
            f"moved. Use the {rows} before or after that alone."
        )


def moved(
    fit: RobustFit,
    parts: Mapping[str, Sequence[int]],
    si: FloatArray,
    rows: Mapping[str, IntArray] | None = None,
) -> Moved | None:
    """The most telling change of one unknown, or of what leaves a run of rows out.

    Args:
        fit: its rows in the order in which they were measured.
        parts: indices of each unknown's parameters that may have changed, in the solution's order;
            displacement first, turn (if any) after it, in threes.
        si: (p, p) derivative of displacements, m, and small turns, rad, by the parameters.
        rows: of the unknowns that only some rows see, which ones.
    """
    every = np.arange(len(fit.inliers), dtype=np.intp)
    runs = (
        _run(fit.inliers, of, what)
        for what, of in {" or ".join(parts): every, **(rows or {})}.items()
    )
    return _moved_among_fitted(fit, parts, si) or next(filter(None, runs), None)


def _moved_among_fitted(
    fit: RobustFit, parts: Mapping[str, Sequence[int]], si: FloatArray
) -> Moved | None:
    kept = np.flatnonzero(fit.inliers)
    count = len(kept)
    if count < 2 * FEWEST:
        return None
    problem, x = fit.solution.problem, fit.solution.x
    rows = whitened_rows(problem, x, fit.sigmas)
    jacobians = [r.jacobian.reshape(count, -1, len(x)) for r in rows]
    residuals = [r.line.residual / sigma for r, sigma in zip(rows, fit.sigmas, strict=True)]
    ways = _Ways.of(count)
    told, pull = ways.sums(jacobians, residuals)
    best = _best(parts, told.sum(axis=0), pull.sum(axis=0))
    squares = np.array([np.sum(r**2) for r in residuals])
    left = best.left(ways, jacobians, residuals)
    rest = np.array([np.sum(r**2) for r in left])
    if not best.rank or np.all(rest > (1.0 - WORTH) * squares):
        return None
    # What the change made of the noise of places must not hide it, nor of that of turns.
    precision = 1.0 / np.maximum(rest / [r.size for r in residuals], EXACT**2)
    told, pull = (np.tensordot(precision, each, axes=1) for each in (told, pull))
    best = _best(parts, told, pull)
    blocks = zip(best.left(ways, jacobians, residuals), np.sqrt(precision), strict=True)
    white = np.concatenate([r * root for r, root in blocks], axis=1)
    # Neighbours that err alike are fewer than they are, and seem to change somewhere.
    length = correlation_length(white)
    hardly = length > 1.0 or count < ENOUGH_TO_TELL
    if hardly and np.all(rest > (1.0 - SHARE) * squares):
        return None
    freedom = white.size / length - len(x) - best.rank
    if freedom < 1.0:
        return None
    # Data that fit to the last digit leave nothing: then any gain at all is one.
    noise = max(float(np.sum(white**2)) / freedom, float(np.finfo(float).tiny))
    tests = len(parts) * len(ways)
    if fdtrc(best.rank, freedom, best.gain / best.rank / noise) * tests > FALSE_ALARM:
        return None
    at = np.ix_(best.at, best.at)
    step, spread = si[at] @ best.step, noise * si[at] @ best.spread @ si[at].T
    sizes = [
        size
        for axes in (slice(0, 3), slice(3, 6))[: len(step) // 3]
        for size in (float(np.linalg.norm(step[axes])), _std_along(step[axes], spread[axes, axes]))
    ]
    if all(size <= SEVERAL * std for size, std in zip(sizes[::2], sizes[1::2], strict=True)):
        return None
    start = ways.start(best.way)
    since = 0 if start is None else int(kept[start])
    by, by_std, turn, turn_std = [*sizes, math.nan, math.nan][:4]
    return Moved(best.what, since, by, by_std, turn, turn_std, start is None)


@dataclass(frozen=True, eq=False)
class _Ways:
    """How an unknown may have changed: from each of some rows on, or little by little.

    Attributes:
        starts: (k,) rows from which on it may be another.
        count: of all rows.
    """

    starts: IntArray
    count: int

    @classmethod
    def of(cls, count: int) -> _Ways:
        """For so many rows."""
        starts = np.unique(np.linspace(FEWEST, count - FEWEST, TIMES).astype(np.intp))
        return cls(starts, count)

    def __len__(self) -> int:
        return len(self.starts) + 1

    def start(self, way: int) -> int | None:
        """The row that it begins at; None where it drifts."""
        return int(self.starts[way]) if way < len(self.starts) else None

    def weights(self, way: int) -> FloatArray:
        """(n,) how much of the change each row has."""
        start, row = self.start(way), np.arange(self.count)
        return row / (self.count - 1.0) if start is None else np.where(row < start, 0.0, 1.0)

    def sums(
        self, jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Of each block ΣJᵀJ and ΣJᵀr, then ΣwJᵀJ and ΣwJᵀr of each way, and of the last Σw²JᵀJ.

        Args:
            jacobians: (n, 3, p) of each block.
            residuals: (n, 3) of each block.

        Returns:
            (blocks, k + 3, p, p) and (blocks, k + 2, p).
        """
        told, pull = list[FloatArray](), list[FloatArray]()
        drift = self.weights(len(self.starts))[:, None, None]
        for jacobian, residual in zip(jacobians, residuals, strict=True):
            split = np.split(jacobian, self.starts), np.split(residual, self.starts)
            pairs = zip(*split, strict=True)
            flat = [(some.reshape(-1, some.shape[-1]), r.ravel()) for some, r in pairs]
            after = _from_there_on([some.T @ some for some, _ in flat])
            by = _from_there_on([some.T @ r for some, r in flat])
            every, drifting = (a.reshape(-1, a.shape[-1]) for a in (jacobian, drift * jacobian))
            told.append(np.stack([*after, every.T @ drifting, drifting.T @ drifting]))
            pull.append(np.stack([*by, drifting.T @ residual.ravel()]))
        return np.array(told), np.array(pull)


@dataclass(frozen=True, eq=False)
class _Trial:
    """An unknown that changed.

    Attributes:
        what, at: the unknown, and which parameters it is.
        way: how it changed.
        step, spread: (m,) by how much it is another, and (m, m) covariance for unit noise.
        follows: (p,) what all unknowns do where it is.
        gain: squares that it explains.
        rank: directions in which the rows tell it.
    """

    what: str
    at: list[int]
    way: int
    step: FloatArray
    spread: FloatArray
    follows: FloatArray
    gain: float
    rank: int

    def left(
        self, ways: _Ways, jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray]
    ) -> list[FloatArray]:
        """What it leaves of the residuals of each block, (n, 3)."""
        moves = np.zeros_like(self.follows)
        moves[self.at] = self.step
        weights = ways.weights(self.way)[:, None]
        return [
            residual - jacobian @ self.follows - weights * (jacobian @ moves)
            for jacobian, residual in zip(jacobians, residuals, strict=True)
        ]


def _best(parts: Mapping[str, Sequence[int]], told: FloatArray, pull: FloatArray) -> _Trial:
    """The trial that explains most, all unknowns free to follow; by sums of `_Ways`."""
    inverse = np.linalg.pinv(told[0], hermitian=True)
    # The square of a weight that is zero or one is the weight.
    once, twice = told[1:-1], [*told[1:-2], told[-1]]
    trials = []
    for what, at in ((what, list(indices)) for what, indices in parts.items()):
        scale = 1.0 / np.sqrt(np.maximum(np.diag(told[0])[at], 1e-300))
        for way, (after, own, by) in enumerate(zip(once, twice, pull[1:], strict=True)):
            followed = after[at] @ inverse
            free = own[np.ix_(at, at)] - followed @ after[:, at]
            size, axes = np.linalg.eigh(free * np.outer(scale, scale))
            axes = scale[:, None] * axes[:, size > TOLD]
            spread = axes / size[size > TOLD] @ axes.T
            step = spread @ (by[at] - followed @ pull[0])
            follows = inverse @ (pull[0] - after[:, at] @ step)
            gain, rank = float(step @ free @ step), int(np.sum(size > TOLD))
            trials.append(_Trial(what, at, way, step, spread, follows, gain, rank))
    return max(trials, key=lambda trial: trial.gain)


def _from_there_on(parts: Sequence[FloatArray]) -> FloatArray:
    """(k, …) the sum of each part and all that follow it."""
    return np.cumsum(np.array(parts)[::-1], axis=0)[::-1]


def _std_along(step: FloatArray, covariance: FloatArray) -> float:
    """Standard deviation of the length of a vector."""
    along = step / max(float(np.linalg.norm(step)), 1e-300)
    return math.sqrt(max(float(along @ covariance @ along), 0.0))


def _run(inliers: BoolArray, rows: IntArray, what: str) -> Moved | None:
    """Of some rows those that disagree, where they are nearly all the first ones, or the last."""
    out = ~inliers[rows]
    for backwards in (False, True):
        # The run in which rows that disagree most outnumber those that agree.
        many = np.cumsum(np.where(out[::-1] if backwards else out, 1, -1))
        length = int(np.argmax(many)) + 1
        run = out[len(out) - length :] if backwards else out[:length]
        found = int(run.sum())
        if found >= RUN and found >= (1.0 - STRAYS) * max(length, int(out.sum())):
            since = len(out) - length if backwards else length
            return Moved(what, int(rows[since])) if since < len(rows) else None
    return None
