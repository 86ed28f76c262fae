"""Errors that neighbours share: what a model lacks is alike in like postures, measured in a row.

Poses that follow one another in a file are mostly near one another in space too, so that what a
model gets wrong changes slowly from row to row, and looks as if something had changed in time. The
residuals are taken to be correlated,

    cov(e_i, e_j) = σ² (κ exp(-|q_i - q_j| / ℓ - |i - j| / τ)   + 1 where i = j)

and whatever else a model may lack (`ReducedFit.lacking`) to be off by some share of what is
plausible. How much of both there is, the restricted likelihood of the residuals says (Patterson and
Thompson 1971, doi:10.1093/biomet/58.3.545) once the change is taken for true: a change that is one
leaves nothing to be shared. What it then explains by generalised least squares is held against
chance: rows freed of their correlation are a `LinearFit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.trust.evidence import Effect, weigh_effects
from suta_calib.trust.examination import samples_of
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.trust.reduced_fit import ReducedFit


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
    more = np.hstack([fit.jacobian[:, random], fit.columns(waves)])
    plausible = fit.problem.parameters.array("plausible")[random]
    off, change = np.concatenate([plausible, np.ones(waves.shape[1])]), fit.columns(velocity)
    # Shares of what is plausible by which a model may be off in all that it lacks.
    fits = [
        fit.linear.beside(change),
        *(
            fit.linear.beside(more, (share * off) ** -2.0).beside(change)
            for share in (0.01, 0.03, 0.1, 0.3, 1.0)
        ),
    ]
    rows = _FreedRows.of(fit)
    left = rows.freed(fits[0], white)
    # What is known beforehand counts in units of the noise that the change leaves.
    scatter = float(np.sum(left.fit.settled**2))
    noise = float(np.sqrt(scatter / max(left.fit.rows - left.fit.spent, 1.0)))
    scaled = [replace(f, jacobian=f.jacobian / noise, residual=f.residual / noise) for f in fits]
    likeliest = min(scaled, key=lambda choice: rows.freed(choice, white).of_this_noise)
    tried = [white, *(_Correlation(*choice) for choice in product(common, near, soon))]
    freed = (rows.freed(likeliest, choice) for choice in tried)
    best = min(freed, key=lambda choice: choice.of_any_noise).fit
    before = best.jacobian.shape[1] - velocity.shape[1]
    without = replace(
        best,
        jacobian=best.jacobian[:, :before],
        prior_precision=best.prior[:before],
        from_prior=best.away[:before],
    )
    weighed = weigh_effects(without, [Effect("change", best.jacobian[:, before:])])
    return weighed[0].p_single if weighed else 1.0


@dataclass(frozen=True)
class _Correlation:
    """Variance, and reach in posture and in rows, of what neighbours have in common."""

    common: float
    near: float
    soon: float


@dataclass(frozen=True, eq=False)
class Freed:
    """Rows freed of their correlation, and what its likelihood needs beside their squares.

    Attributes:
        fit: of these rows.
        freedom: components of all rows beyond unknowns of which nothing is known beforehand.
        volume: logarithm of the determinants of the restricted likelihood.
        more: squares of other components.
    """

    fit: LinearFit
    freedom: int
    volume: float
    more: float = 0.0

    @classmethod
    def of(cls, every: FloatArray, fit: LinearFit, volume: float, **more: Any) -> Freed:
        """Of the columns of a fit with its residuals, (m, p + 1), freed of their correlation.

        Args:
            every: these.
            fit: it.
            volume: logarithm of the determinant of the rows' covariance.
            more: attributes of the `LinearFit`.
        """
        freed = LinearFit(every[:, :-1], every[:, -1], fit.prior, fit.away, **more)
        curvature = freed.information + np.diag(fit.prior)
        scale = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        values = np.linalg.eigvalsh(curvature / np.outer(scale, scale))
        # Undetermined directions without a prior do not count.
        volume += float(np.sum(np.log(values[values > 1e-12])))
        volume += 2.0 * float(np.sum(np.log(scale[scale > 1e-9])))
        volume -= float(np.sum(np.log(fit.prior[fit.prior > 0])))
        fixed = int(np.count_nonzero((fit.prior == 0) & (scale > 1e-9)))
        return cls(freed, max(len(every) - fixed, 1), volume)

    def beside(self, squares: float, count: int) -> Freed:
        """With more components, independent and of no unknown, of which the squares are known."""
        return replace(self, more=self.more + squares, freedom=self.freedom + count)

    @property
    def of_this_noise(self) -> float:
        """-2 log of the restricted likelihood where the noise is one."""
        return self.fit.squares + self.more + self.volume

    @property
    def of_any_noise(self) -> float:
        """The same where it is the likeliest."""
        squares = self.fit.squares + self.more
        return self.freedom * float(np.log(squares / self.freedom)) + self.volume


@dataclass(frozen=True, eq=False)
class _Block:
    """Some rows (n,) of a block.

    Attributes:
        components: (n, d) their numbers among those of all rows.
        weight: (n,).
        near, soon: (n, n) how far rows are apart, in posture and in the order they stand.
    """

    components: IntArray
    weight: FloatArray
    near: FloatArray
    soon: FloatArray


@dataclass(frozen=True, eq=False)
class _FreedRows:
    """Rows beside which a change is asked."""

    blocks: Sequence[_Block]

    @classmethod
    def of(cls, fit: ReducedFit) -> _FreedRows:
        """Some of each block's rows."""
        arm, q = fit.problem.arm, np.vstack([t.poses.samples.q for t in fit.problem.terms])
        assert arm is not None
        sliding = [arm.units[joint] == "m" for joint in arm.joints]
        # Travels in units in which they are like turns.
        q = q / np.where(sliding, np.maximum(np.ptp(q, axis=0), 1e-9), 1.0)
        blocks, random, sample_of = [], np.random.default_rng(0), samples_of(fit.rows)
        ends = np.cumsum([0, *(r.line.residual.size for r in fit.rows)])
        for (first, end), r in zip(pairwise(ends.tolist()), fit.rows, strict=True):
            n, size = r.line.residual.shape
            # Rows of a block that are looked at: what so many do not tell is smaller than what is
            # lacking.
            chosen = np.sort(random.permutation(n)[:400])
            components = np.arange(first, end).reshape(n, size)[chosen]
            sample, weight = sample_of[components[:, 0]], fit.linear.weights[components[:, 0]]
            # Chords, so that a turn is no way.
            chords = sum(4.0 * np.sin((c[:, None] - c) / 2.0) ** 2 for c in q[sample].T)
            soon = np.abs(sample[:, None] - sample).astype(float)
            blocks.append(_Block(components, weight, np.sqrt(chords), soon))
        return cls(blocks)

    def freed(self, fit: LinearFit, correlation: _Correlation) -> Freed:
        """These rows of a fit, where they are so correlated."""
        parts, volume = list[FloatArray](), 0.0
        both = np.hstack([fit.jacobian, fit.residual[:, None]])
        for block in self.blocks:
            n, size = block.components.shape
            shared = np.exp(-block.near / correlation.near - block.soon / correlation.soon)
            root = np.linalg.cholesky(correlation.common * shared + np.diag(1.0 / block.weight))
            rows = both[block.components].reshape(n, -1)
            free = solve_triangular(root, rows, lower=True, check_finite=False)
            parts.append(free.reshape(n * size, -1))
            volume += 2.0 * size * float(np.sum(np.log(np.diag(root))))
        every = np.vstack(parts)
        rows_at_most = min(float(len(every)), fit.rows)
        return Freed.of(every, fit, volume, independent_rows=rows_at_most)
