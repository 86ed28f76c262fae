"""Was something moved between the poses? A bumped camera, a target that slid, a tip that bent.

The fit spreads what happened over its unknowns, the scatter grows, and every row stays plausible.
An unknown that is another from some row on has columns of its own, though: those of the unknown,
with zeros before that row. They are tested as `diagnostics.changes` tests an arm's, without a
solve: sums over the rows that follow are all that it takes. Where the change came late, few rows
disagree with the rest, and are left out one by one; then it tells that they follow one another.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.distributions import f
from suta_calib.pose_calibration.robust_fit import RobustFit
from suta_calib.pose_calibration.serial_correlation import correlation_length
from suta_calib.records import dataclass
from suta_calib.solver.information import whitened_rows
from suta_calib.units import deg, text

# Rows before and after, and rows (evenly spaced ones) at which it may have happened.
FEWEST: Final = 4
TIMES: Final = 40
# Chance that one of all tests calls sound data changed.
FALSE_ALARM: Final = 1e-3
# Share of a block's squares that a change must explain: of many rows anything is significant, and
# a hand that errs alike in like poses seems to change on its way.
SHARE: Final = 0.7
# Information, as a share of the unknown's own, below which nothing tells a change.
TOLD: Final = 1e-6
# What is left of exact poses, in units of the scatter that the change made.
EXACT: Final = 1e-6
# Rows that disagree, from which on it is no chance that they follow one another.
RUN: Final = 3


@dataclass(frozen=True)
class Moved:
    """What was not the same for all rows.

    Attributes:
        what: the unknown.
        since: row, from 0, from which on it is another.
        by, by_std: how far, and its standard deviation, m; NaN where the rows before or after
            disagree with the rest, so that they are not fitted.
        turn, turn_std: rad; NaN where the unknown is a point.
    """

    what: str
    since: int
    by: float = math.nan
    by_std: float = math.nan
    turn: float = math.nan
    turn_std: float = math.nan

    def sentence(self, rows: str) -> str:
        """What happened.

        Args:
            rows: what a row is, in the plural.
        """
        if math.isnan(self.by):
            return (
                f"The {rows} that do not agree are all before row {self.since}, or all from there "
                f"on (rows from 0): was {self.what} moved in between?"
            )
        by = f"{text(self.by, 'm')} ± {text(self.by_std, 'm', with_unit=True)}"
        if not math.isnan(self.turn):
            by += f" and {deg(self.turn):.2f} ± {deg(self.turn_std):.2f}°"
        return (
            f"From row {self.since} on (rows from 0) {self.what} stands elsewhere, by {by}: it was "
            f"moved. Use the {rows} before or after that alone."
        )


def moved(fit: RobustFit, parts: Mapping[str, Sequence[int]], si: FloatArray) -> Moved | None:
    """The most telling change of one unknown, or of what leaves a run of rows out.

    Args:
        fit: its rows in the order in which they were measured.
        parts: indices of each unknown's parameters that may have changed, in the solution's order;
            displacement first, turn (if any) after it, in threes.
        si: (p, p) derivative of displacements, m, and small turns, rad, by the parameters.
    """
    return _moved_among_fitted(fit, parts, si) or _run(fit.inliers, " or ".join(parts))


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
    starts = np.unique(np.linspace(FEWEST, count - FEWEST, TIMES).astype(np.intp))
    told, pull = _from_each(starts, jacobians, residuals)
    best = _best(starts, parts, told.sum(axis=0), pull.sum(axis=0))
    squares = np.array([np.sum(r**2) for r in residuals])
    left = best.left(jacobians, residuals)
    rest = np.array([np.sum(r**2) for r in left])
    if not best.rank or np.all(rest > (1.0 - SHARE) * squares):
        return None
    # What the change made of the noise of places must not hide it, nor of that of turns.
    precision = 1.0 / np.maximum(rest / [r.size for r in residuals], EXACT**2)
    told, pull = (np.tensordot(precision, each, axes=1) for each in (told, pull))
    best = _best(starts, parts, told, pull)
    blocks = zip(best.left(jacobians, residuals), np.sqrt(precision), strict=True)
    white = np.concatenate([r * root for r, root in blocks], axis=1)
    # Neighbours that err alike are fewer than they are, and seem to change somewhere.
    freedom = white.size / correlation_length(white) - len(x) - best.rank
    if freedom < 1.0:
        return None
    noise = float(np.sum(white**2)) / freedom
    tests = len(parts) * TIMES
    if f.sf(best.gain / best.rank / noise, best.rank, freedom) * tests > FALSE_ALARM:
        return None
    at = np.ix_(best.at, best.at)
    step, spread = si[at] @ best.step, noise * si[at] @ best.spread @ si[at].T
    sizes = [
        size
        for axes in (slice(0, 3), slice(3, 6))[: len(step) // 3]
        for size in (float(np.linalg.norm(step[axes])), _std_along(step[axes], spread[axes, axes]))
    ]
    return Moved(best.what, int(kept[best.start]), *sizes)


@dataclass(frozen=True, eq=False)
class _Trial:
    """An unknown that is another from a row on.

    Attributes:
        what, at: the unknown, and which parameters it is.
        start: the row among those fitted.
        step, spread: (m,) by how much it is another, and (m, m) covariance for unit noise.
        follows: (p,) what all unknowns do where it is.
        gain: squares that it explains.
        rank: directions in which the rows tell it.
    """

    what: str
    at: list[int]
    start: int
    step: FloatArray
    spread: FloatArray
    follows: FloatArray
    gain: float
    rank: int

    def left(
        self, jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray]
    ) -> list[FloatArray]:
        """What it leaves of the residuals of each block, (n, 3)."""
        moves = np.zeros_like(self.follows)
        moves[self.at] = self.step
        found = []
        for jacobian, residual in zip(jacobians, residuals, strict=True):
            left = residual - jacobian @ self.follows
            left[self.start :] -= jacobian[self.start :] @ moves
            found.append(left)
        return found


def _best(
    starts: IntArray, parts: Mapping[str, Sequence[int]], told: FloatArray, pull: FloatArray
) -> _Trial:
    """The trial that explains most, all unknowns free to follow; by sums of `_from_each`."""
    inverse = np.linalg.pinv(told[0], hermitian=True)
    trials = []
    for what, at in ((what, list(indices)) for what, indices in parts.items()):
        scale = 1.0 / np.sqrt(np.maximum(np.diag(told[0])[at], 1e-300))
        for start, after, by in zip(starts.tolist(), told[1:], pull[1:], strict=True):
            followed = after[at] @ inverse
            free = after[np.ix_(at, at)] - followed @ after[:, at]
            size, axes = np.linalg.eigh(free * np.outer(scale, scale))
            axes = scale[:, None] * axes[:, size > TOLD]
            spread = axes / size[size > TOLD] @ axes.T
            step = spread @ (by[at] - followed @ pull[0])
            follows = inverse @ (pull[0] - after[:, at] @ step)
            gain, rank = float(step @ free @ step), int(np.sum(size > TOLD))
            trials.append(_Trial(what, at, start, step, spread, follows, gain, rank))
    return max(trials, key=lambda trial: trial.gain)


def _from_each(
    starts: IntArray, jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """JᵀJ and Jᵀr of each block's rows: of all of them, and of those from each start on.

    Args:
        starts: (k,) rows.
        jacobians: (n, 3, p) of each block.
        residuals: (n, 3) of each block.

    Returns:
        (blocks, k + 1, p, p) and (blocks, k + 1, p).
    """
    told, pull = list[list[FloatArray]](), list[list[FloatArray]]()
    for jacobian, residual in zip(jacobians, residuals, strict=True):
        parts = zip(np.split(jacobian, starts), np.split(residual, starts), strict=True)
        flat = [(some.reshape(-1, some.shape[-1]), r.ravel()) for some, r in parts]
        told.append([some.T @ some for some, _ in flat])
        pull.append([some.T @ r for some, r in flat])
    return _from_there_on(np.array(told)), _from_there_on(np.array(pull))


def _from_there_on(parts: FloatArray) -> FloatArray:
    """Of each block, (blocks, k, …), the sum of a part and all that follow it."""
    return np.cumsum(parts[:, ::-1], axis=1)[:, ::-1]


def _std_along(step: FloatArray, covariance: FloatArray) -> float:
    """Standard deviation of the length of a vector."""
    along = step / max(float(np.linalg.norm(step)), 1e-300)
    return math.sqrt(max(float(along @ covariance @ along), 0.0))


def _run(inliers: BoolArray, what: str) -> Moved | None:
    """Rows that disagree and are all the first ones, or all the last."""
    out = np.flatnonzero(~inliers)
    if len(out) < RUN or out[-1] - out[0] + 1 != len(out):
        return None
    if out[-1] == len(inliers) - 1:
        return Moved(what, int(out[0]))
    return Moved(what, int(out[-1]) + 1) if out[0] == 0 else None
