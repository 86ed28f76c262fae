"""Covariance of an estimate (sandwich), before and after the residuals are known.

    Cov = A⁻¹ (M + P) A⁻¹ + G Σ Gᵀ + S Sᵀ

with A the curvature of the robust cost and priors, M the variance of its gradient by touch, P the
priors' precision (`Problem.stated_precision`), G Σ Gᵀ what the artefact's uncertainty adds, and S
the shift by one standard deviation of each scale (`artefact_and_scale`): the stated one, or what
the residuals leave of it where lengths are held that tell it. Rows that share samples
are not independent: the (JᵀJ)⁻¹ of pairwise distances understates standard deviations by two to
four times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.artefact_and_scale import (
    artefact_errors,
    joined_errors,
    scale_errors,
    shifts,
    without_shared_errors,
)
from suta_calib.solver.evaluation import AT_ONCE
from suta_calib.solver.felt_noise import felt_noise_error
from suta_calib.solver.fitted import Fitted
from suta_calib.solver.held_geometry import HeldGeometry, held_geometry, seating_covariance
from suta_calib.solver.information import Information, Rows, scaled_inverse
from suta_calib.solver.problem import Problem
from suta_calib.terms.block import grouped_rows, summed

Source = Literal["scatter", "priors", "artefact", "noise levels", "seating", "sensors"]
# Touches from which on none has leverage worth freeing residuals of.
MANY_TOUCHES: Final = 2000


@dataclass(frozen=True, eq=False)
class Spread:
    """Covariance of an estimate, computed when it is first used.

    Attributes:
        fit: the estimate.
        learned: (n, n) what unsure weights add.
    """

    fit: Fitted
    learned: FloatArray

    @cached_property
    def _parts(self) -> CovarianceParts:
        return observed_parts(self.fit)

    @property
    def total(self) -> FloatArray:
        """Covariance (n, n) of the estimate."""
        return np.asarray(self.within_scale + self.of_scale)

    @cached_property
    def within_scale(self) -> FloatArray:
        """Covariance (n, n) of the estimate in units of whatever carries its scale.

        What holds for other data of the same instrument, artefact or board.
        """
        return np.asarray(sum(self.by_source.values()))

    @cached_property
    def by_source(self) -> Mapping[Source, FloatArray]:
        """`within_scale` by origin, (n, n) each."""
        parts, by_sensors = self._parts, felt_noise_error(self.fit)
        return {
            "scatter": parts.scatter,
            "priors": parts.priors,
            "artefact": parts.artefact,
            "noise levels": self.learned,
            "seating": seating_covariance(self.fit),
            "sensors": np.outer(by_sensors, by_sensors),
        }

    @cached_property
    def held(self) -> HeldGeometry | None:
        """Effect of held geometry that no residual shows; None if there is none."""
        return held_geometry(self.fit, self.within_scale)

    @property
    def of_scale(self) -> FloatArray:
        """(n, n) the part of it that residuals of these kinds show least.

        Of scales, and of what is held.
        """
        scale = self._parts.of_scale
        if self.held is None:
            return scale
        return np.asarray(scale + self.held.of_estimate @ self.held.of_estimate.T)

    @property
    def of_artefact(self) -> FloatArray:
        """(n, n) the part of it that certified coordinates make."""
        return self._parts.artefact

    @property
    def scale_std(self) -> dict[tuple[object, ...], float]:
        """Standard deviation of the factor of each carrier, as stated or as the residuals tell."""
        parts = self._parts
        return dict(zip(parts.carriers, parts.scale_std.tolist(), strict=True))

    @property
    def by_scale(self) -> dict[tuple[object, ...], FloatArray]:
        """(n,) derivative of the estimate by the factor on all lengths of each carrier."""
        parts = self._parts
        return dict(zip(parts.carriers, parts.scale.T, strict=True))


@dataclass(frozen=True, eq=False)
class CovarianceParts:
    """The covariance of an estimate by origin.

    ``scatter`` (n, n) is of what differs from touch to touch, ``priors`` (n, n) of the priors,
    ``artefact`` (n, n) of certified coordinates, whose errors all touches share; ``scale`` (n,
    carriers) is the derivative by each scale, of which ``scale_std`` is the standard deviation: as
    it is stated, or less where the residuals tell it.
    """

    scatter: FloatArray
    priors: FloatArray
    artefact: FloatArray
    scale: FloatArray
    scale_std: FloatArray
    carriers: tuple[tuple[object, ...], ...]

    @property
    def of_scale(self) -> FloatArray:
        """(n, n) of the scales."""
        shift = self.scale * self.scale_std
        return np.asarray(shift @ shift.T)

    @property
    def total(self) -> FloatArray:
        """(n, n) their sum."""
        return np.asarray(self.scatter + self.priors + self.artefact + self.of_scale)


def observed_parts(fit: Fitted, touches: Sequence[IntArray] | None = None) -> CovarianceParts:
    """Covariance of an estimate by origin, zero for entries that were not free.

    The sandwich A⁻¹ (M + P) A⁻¹ with the priors' stated precision P in A as well: scatter as the
    residuals show it, outliers as Huber weighs them, rows of one touch together. What an artefact's
    stated uncertainty explains of the residuals is taken from them and stands in its own part.

    Args:
        fit: the estimate.
        touches: for each term (samples,), which are one cluster; `Term.clusters` by default.
    """
    problem, rows = fit.problem, fit.rows()
    bread, prior = fit.bread(rows), np.diag(problem.stated_precision())
    touches = [term.clusters for term in problem.terms] if touches is None else touches
    part, scales = artefact_errors(rows), scale_errors(fit, rows)
    nothing = np.zeros((len(fit.x), 0))
    by_artefact = nothing if part is None else shifts(rows, part, bread) * part.sigma
    by_scale = nothing if scales is None else shifts(rows, scales, bread)
    both = joined_errors(part, scales)
    scale_std = np.zeros(0) if scales is None else scales.sigma.copy()
    if both is not None and len(fit.free):
        rows, off = without_shared_errors(fit, rows, both, touches)
        inexact = np.flatnonzero(scale_std)
        scale_std[inexact] = off[len(off) - len(inexact) :]
    scatter = np.zeros_like(bread)
    for term, touch in zip(problem.terms, touches, strict=True):
        mine = [r for r in rows if any(r.line.view.block is b for b in term.blocks)]
        scatter += _clustered_variance(mine, touch, bread)
    return CovarianceParts(
        scatter,
        bread @ prior @ bread,
        by_artefact @ by_artefact.T,
        by_scale,
        scale_std,
        () if scales is None else scales.keys,
    )


def predicted_covariance(problem: Problem, information: Information, free: IntArray) -> FloatArray:
    """Covariance (n, n) before any residual is known, from `predicted_information`."""
    prior = np.diag(problem.stated_precision())
    bread = np.zeros_like(prior)
    inverse = scaled_inverse((information.curvature + prior)[np.ix_(free, free)])
    bread[np.ix_(free, free)] = inverse
    return bread @ (information.variance + prior) @ bread


def predicted_scale_covariance(fit: Fitted) -> FloatArray:
    """What scales add to `predicted_covariance` (n, n): further data do not reduce it."""
    rows = fit.rows()
    if (scales := scale_errors(fit, rows)) is None:
        return np.zeros((len(fit.x),) * 2)
    shift = shifts(rows, scales, fit.bread(rows)) * scales.sigma
    return np.asarray(shift @ shift.T)


def _clustered_variance(rows: Sequence[Rows], touch: IntArray, bread: FloatArray) -> FloatArray:
    """A⁻¹ (Σ of products of row gradients that share a touch) A⁻¹ for one term's blocks.

    Cluster-robust variance for dyads (Aronow, Samii, Assenova 2015, doi:10.1093/pan/mpv018).
    Residuals are freed of their leverage touch by touch (CR2; Bell and McCaffrey 2002). ``touch``
    (samples,) names what is one cluster.
    """
    unit = np.sqrt(np.maximum(np.diag(bread), 0.0))
    outer = np.outer(unit, unit)
    values, vectors = np.linalg.eigh(np.divide(bread, outer, where=outer > 0, out=0 * outer))
    # Eigenvalue of a covariance, relative to the largest, that is rounding.
    rounding = 1e-14
    determined = values > rounding * max(float(values[-1]), 1e-300)
    root = unit[:, None] * vectors[:, determined] * np.sqrt(values[determined])
    if not root.size or not root.any():
        return np.zeros_like(bread)
    count, width = int(touch.max()) + 1, root.shape[1]
    by_touch, twice = np.zeros((count, width)), np.zeros((width, width))
    for r in rows:
        line = r.line
        n, size = line.residual.shape
        belief, members = np.sqrt(line.weight), touch[line.view.block.samples]
        white = line.residual * (belief / line.sigma)[:, None]
        # Where nothing but scores is wanted, a few rows at a time: no room is found for all.
        alone = count > MANY_TOUCHES and members.shape[1] == 1
        score, gain = np.empty((n, width)), np.empty((0, size, width))
        height = AT_ONCE if alone else n or 1
        for first in range(0, n, height):
            part_rows = slice(first, first + height)
            part = r.jacobian[size * part_rows.start : size * part_rows.stop] @ root
            gain = part.reshape(-1, size, width) * belief[part_rows, None, None]
            # By two, of which NumPy has a fast sum, not by three.
            score[part_rows] = np.einsum("ndp,nd->np", gain, white[part_rows])
        mine = summed_by_member(score, members, count)
        by_touch += _freed(mine, gain, members) if count <= MANY_TOUCHES else mine
        twice += _between_pairs(score, gain, members)
    spread = root @ _positive(by_touch.T @ by_touch - twice) @ root.T
    return np.asarray(spread)


def summed_by_member(score: FloatArray, members: IntArray, count: int) -> FloatArray:
    """Scores (n, w) of rows that look at members (n, k), summed over each of ``count`` members."""
    first, *more = members.T
    sums = summed(score, first, count)
    for member in more:
        sums += summed(score, member, count)
    return sums


def _freed(by_touch: FloatArray, gain: FloatArray, members: IntArray) -> FloatArray:
    """Scores per touch multiplied by (I - YᵀY)^(-½), Y the touch's rows in units of the fit."""
    freed, n = by_touch.copy(), len(members)
    # Each touch with each of its rows, once.
    pairs = np.unique(members * n + np.arange(n)[:, None])
    touches, first = np.unique(pairs // n, return_index=True)
    rows = np.split(pairs % n, first[1:])
    # Touches of as many rows are decomposed together.
    for size in {len(touches_of) for touches_of in rows}:
        same_size = [k for k, touches_of in enumerate(rows) if len(touches_of) == size]
        y = gain[np.array([rows[k] for k in same_size])].reshape(len(same_size), -1, gain.shape[2])
        _, singular, directions = np.linalg.svd(y, full_matrices=False)
        extra = 1.0 / np.sqrt(np.clip(1.0 - singular**2, 0.1, 1.0)) - 1.0
        component = directions @ by_touch[touches[same_size], :, None]
        freed[touches[same_size]] += (
            np.swapaxes(directions, 1, 2) @ (extra[..., None] * component)
        )[..., 0]
    return freed


def _between_pairs(score: FloatArray, gain: FloatArray, members: IntArray) -> FloatArray:
    """What rows between the same two touches contribute: they were counted once for each."""
    if members.shape[1] == 1:
        return np.zeros((score.shape[1],) * 2)
    pair, _ = grouped_rows(members)
    leverage = np.bincount(pair, np.einsum("ndp,ndp->n", gain, gain))
    by_pair = summed(score, pair, len(leverage))
    freed = by_pair / np.sqrt(1.0 - np.clip(leverage, 0.0, 0.9))[:, None]
    return np.asarray((members.shape[1] - 1) * freed.T @ freed)


def _positive(matrix: FloatArray) -> FloatArray:
    """Nearest positive semidefinite matrix: a difference of two need not be one."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
