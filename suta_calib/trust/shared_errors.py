"""Errors that neighbours share: what a model lacks is alike in like postures, measured in a row.

Poses that follow one another in a file are mostly near one another in space too, so that what a
model gets wrong changes slowly from row to row, and looks as if something had changed in time. The
residuals are taken to be correlated,

    cov(e_i, e_j) = σ² (κ exp(-|q_i - q_j| / ℓ - |i - j| / τ)   + 1 where i = j)

and whatever else a model may lack (`ReducedFit.lacking`) to be off by some share of what is
plausible. How much of both there is, the restricted likelihood of the residuals says (Patterson and
Thompson 1971, doi:10.1093/biomet/58.3.545) once the change is taken for true: a change that is one
leaves nothing to be shared. What it then explains by generalised least squares is held against
chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Final

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.information import scaled_inverse
from suta_calib.trust.reduced_fit import ReducedFit, whitened, widened

# Shares of what is plausible by which a model may be off in all that it lacks.
LACKING: Final = 0.01, 0.03, 0.1, 0.3, 1.0


def chance_beside_shared_errors(
    fit: ReducedFit, velocity: FloatArray, lacking: Sequence[IntArray], waves: FloatArray
) -> float:
    """Chance that errors which neighbours share look so much like what moves the tips so.

    Args:
        fit: beside which it is asked.
        velocity: (6·samples, k) of the tips.
        lacking: indices of parameters by which the model may be off.
        waves: (6·samples, m) velocity of the tips by what else it may be, as far as is plausible.
    """
    # Variance that neighbours have in common over what each has for itself, and chords of turns (or
    # travels) and rows by which that falls to a third: coarse, for a likelihood that is flat.
    common = 0.5, 2.0, 8.0
    near = 0.5, 2.0
    soon = 5.0, 30.0, np.inf
    white = _Correlation(0.0, 1.0, np.inf)
    random = np.concatenate([*lacking, np.zeros(0, dtype=np.intp)])
    alone = _Rows.of(fit, velocity)
    left = alone.fitted(white)
    # What is known beforehand counts in units of the noise that the change leaves.
    level = float(np.sqrt(left.scatter / max(left.equations - left.spent, 1.0)))
    beside = [_Rows.of(fit.beside(random, share), velocity, share * waves) for share in LACKING]
    sources = [choice.scaled(level) for choice in (alone, *beside)]
    rows = min(sources, key=lambda choice: choice.fitted(white).of_this_noise)
    tried = [white, *(_Correlation(*choice) for choice in product(common, near, soon))]
    fits = [rows.fitted(choice) for choice in tried]
    best = min(range(len(fits)), key=lambda k: fits[k].of_any_noise)
    change, without = fits[best], rows.fitted(tried[best], without=velocity.shape[1])
    determined, freedom = change.spent - without.spent, change.equations - change.spent
    if determined < 0.5 or freedom < 1.0:
        return 1.0
    count = max(round(determined), 1)
    ratio = (without.squares - change.squares) / count / (change.squares / freedom)
    return float(fdtrc(count, freedom, max(ratio, 0.0)))


@dataclass(frozen=True)
class _Correlation:
    """Variance, and reach in posture and in rows, of what neighbours have in common."""

    common: float
    near: float
    soon: float


@dataclass(frozen=True)
class _Fitted:
    """Generalised least squares.

    Attributes:
        squares: that are left, of rows and of what is known beforehand.
        scatter: those of the rows.
        spent: how many unknowns the rows have told.
        equations: independent ones.
        freedom: components of all rows beyond unknowns of which nothing is known beforehand.
        volume: logarithm of the determinants of the restricted likelihood.
    """

    squares: float
    scatter: float
    spent: float
    equations: int
    freedom: int
    volume: float

    @property
    def of_this_noise(self) -> float:
        """-2 log of the restricted likelihood where the noise is one."""
        return self.squares + self.volume

    @property
    def of_any_noise(self) -> float:
        """The same where it is the likeliest."""
        return self.freedom * float(np.log(self.squares / self.freedom)) + self.volume


@dataclass(frozen=True, eq=False)
class _CorrelatedBlock:
    """Rows of a block: residuals (n, d), derivatives (n, d, p), weights and samples (n,)."""

    residual: FloatArray
    jacobian: FloatArray
    weight: FloatArray
    sample: IntArray


@dataclass(frozen=True, eq=False)
class _Rows:
    """Whitened rows beside which a change is asked, its columns last.

    Attributes:
        blocks: of them.
        prior, away: (p,) information beforehand, and from where that says a parameter is.
        q: (samples, joints) readings, travels in units in which they are like turns.
        equations: independent ones, at most.
    """

    blocks: Sequence[_CorrelatedBlock]
    prior: FloatArray
    away: FloatArray
    q: FloatArray
    equations: int

    @classmethod
    def of(cls, fit: ReducedFit, velocity: FloatArray, waves: FloatArray | None = None) -> _Rows:
        """Some of each block's rows, as the fit leaves them, beside waves of a size of one."""
        waves = np.zeros((len(velocity), 0)) if waves is None else waves
        count, unit = len(fit.problem.names), np.ones(waves.shape[1])
        prior = np.concatenate([fit.prior, unit, np.zeros(velocity.shape[1])])
        away = np.concatenate([fit.away, np.zeros(len(prior) - count)])
        free = np.concatenate([fit.free, np.arange(count, len(prior))])
        prior, away = prior[free], away[free]
        blocks, random = [], np.random.default_rng(0)
        for r in widened(fit.rows, np.hstack([waves, velocity])):
            n, size = r.line.residual.shape
            # Rows of a block that are looked at: what so many do not tell is smaller than what is
            # lacking.
            chosen = np.sort(random.permutation(n)[:400])
            sample = r.line.view.block.samples[chosen, 0] + r.line.view.first_sample
            jacobian = r.jacobian[:, free].reshape(n, size, -1)[chosen]
            blocks.append(
                _CorrelatedBlock(whitened(r)[chosen], jacobian, r.line.weight[chosen], sample)
            )
        arm, q = fit.problem.arm, np.vstack([t.poses.samples.q for t in fit.problem.terms])
        assert arm is not None
        sliding = [arm.units[joint] == "m" for joint in arm.joints]
        travel = np.where(sliding, np.maximum(np.ptp(q, axis=0), 1e-9), 1.0)
        return cls(blocks, prior, away, q / travel, fit.equations)

    def scaled(self, noise: float) -> _Rows:
        """The same in units of such a noise."""
        blocks = [
            replace(b, residual=b.residual / noise, jacobian=b.jacobian / noise)
            for b in self.blocks
        ]
        return replace(self, blocks=blocks)

    @cached_property
    def _distances(self) -> list[tuple[FloatArray, FloatArray]]:
        """For each block how far rows (n, n) are apart, in posture and in the order they stand."""
        distances = []
        for block in self.blocks:
            q = self.q[block.sample]
            # Chords, so that a turn is no way.
            chords = sum(4.0 * np.sin((c[:, None] - c) / 2.0) ** 2 for c in q.T)
            rows = np.abs(block.sample[:, None] - block.sample)
            distances.append((np.sqrt(chords), rows.astype(float)))
        return distances

    def fitted(self, correlation: _Correlation, without: int = 0) -> _Fitted:
        """Everything follows where rows are so correlated, but for so many of the last columns."""
        count = len(self.prior) - without
        prior, away = self.prior[:count], self.away[:count]
        information, gradient = np.zeros((count, count)), prior * away
        squares, volume, components = float(prior @ away**2), 0.0, 0
        for block, (near, soon) in zip(self.blocks, self._distances, strict=True):
            n, size = block.residual.shape
            shared = np.exp(-near / correlation.near - soon / correlation.soon)
            alone = np.diag(1.0 / block.weight)
            root = np.linalg.cholesky(correlation.common * shared + alone)
            both = np.concatenate(
                [block.jacobian[:, :, :count], block.residual[:, :, None]], axis=2
            )
            free = solve_triangular(root, both.reshape(n, -1), lower=True, check_finite=False)
            free = free.reshape(n * size, count + 1)
            square = free.T @ free
            information += square[:count, :count]
            gradient += square[:count, count]
            squares += float(square[count, count])
            volume += 2.0 * size * float(np.sum(np.log(np.diag(root))))
            components += n * size
        curvature = information + np.diag(prior)
        inverse = scaled_inverse(curvature)
        step = -inverse @ gradient
        squares += float(gradient @ step)
        pulled = float(prior @ (away + step) ** 2)
        spent = float(np.sum(inverse * information))
        scale = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        values = np.linalg.eigvalsh(curvature / np.outer(scale, scale))
        # What nothing tells and nobody knows has no volume.
        volume += float(np.sum(np.log(values[values > 1e-12])))
        volume += 2.0 * float(np.sum(np.log(scale[scale > 1e-9])))
        volume -= float(np.sum(np.log(prior[prior > 0])))
        fixed = int(np.count_nonzero((prior == 0) & (scale > 1e-9)))
        return _Fitted(
            squares,
            squares - pulled,
            spent,
            min(components, self.equations),
            max(components - fixed, 1),
            volume,
        )
