"""Evidence of the data for given noise levels and priors, and its maximum.

By Laplace's approximation, at the parameters that are best for the weights (the equation stands in
`weights`, MacKay 1992). Residuals and Jacobian are evaluated once: each block's rows and each group
of priors are a quadratic of the step, and the rest happens on matrices of the parameters' size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.special import chdtrc

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.information import Rows
from suta_calib.solver.losses import huber_threshold
from suta_calib.terms.block import Block

# Change of a logarithm from which on it has settled.
SETTLED: Final = 1e-3


@dataclass(frozen=True, eq=False)
class Energy:
    """A part of the cost as a quadratic of the step: constant + slopeᵀΔ + ½ Δᵀ curvature Δ.

    Of a prior the curvature is a diagonal: (p,) in place of (p, p).
    """

    constant: float
    slope: FloatArray
    curvature: FloatArray

    def at(self, step: FloatArray) -> tuple[float, FloatArray]:
        """Value and slope there."""
        bent = self.curvature * step if self.curvature.ndim == 1 else self.curvature @ step
        value = self.constant + self.slope @ step + 0.5 * step @ bent
        return float(value), self.slope + bent


def energies_of_rows(
    rows: Rows, free: IntArray, step: FloatArray, trust: float, sigma: float
) -> tuple[Energy, Energy, int]:
    """A block's cost: of rows within Huber's threshold, of those beyond; how many are within.

    Of what is estimated (``free``), at a step of it, weighed with the noise ``sigma``, m or rad per
    component; ``trust`` is the share of the rows that is independent.
    """
    line = rows.line
    n, size = line.residual.shape
    spread = np.hypot(sigma, line.known_sigma)
    jacobian = rows.jacobian[:, free] * np.repeat(line.sigma / spread, size)[:, None]
    residual = (line.residual / spread[:, None]).reshape(-1)
    norm = np.linalg.norm((residual + jacobian @ step).reshape(n, size), axis=1)
    threshold = threshold_of(line.view.block, spread)
    weight = np.minimum(1.0, threshold / np.maximum(norm, 1e-300))
    parts = []
    for mine in (weight == 1.0, weight < 1.0):
        numbers = np.repeat(mine, size)
        root = np.sqrt(trust * np.repeat(weight[mine], size))
        r, j = root * residual[numbers], root[:, None] * jacobian[numbers]
        # Noise that is always there, m or rad per component: rounding is no information.
        least = float(root @ root) * (1e-6 / sigma) ** 2
        parts.append(Energy(0.5 * (float(r @ r) + least), j.T @ r, j.T @ j))
    return parts[0], parts[1], int(np.sum(weight == 1.0))


def limit_of(block: Block, spread: Any) -> Any:
    """Huber's threshold, m or rad, for the noise ``spread``: of `huber_threshold` at the most."""
    given = block.noise.huber
    stays = block.noise.fixed or math.isinf(given)
    return given if stays else np.minimum(given, huber_threshold(block.size) * spread)


def threshold_of(block: Block, spread: Any) -> Any:
    """The same in units of that noise."""
    return limit_of(block, spread) / spread


def energy_of_prior(precision: FloatArray, away: FloatArray) -> Energy:
    """What priors of (n,) precision cost at parameters that are (n,) away from them."""
    return Energy(0.5 * float(precision @ away**2), precision * away, precision)


@dataclass(frozen=True, eq=False)
class EvidencePoint:
    """-log evidence at one η, the best step of the parameters and its covariance H⁻¹ there."""

    eta: FloatArray
    value: float
    step: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class MarginalLikelihood:
    """-log evidence as a function of η relative to where one is.

    It has the energies of each block's believed rows, then of each group's priors, and those
    ``held`` that do not depend on η; ``counts`` (k,) of independent numbers or priors; for each
    block how many rows are ``beyond`` Huber's threshold, their dimension, and the threshold in
    units of the noise; ``mean`` (k,) and ``belief`` (k, k) of the hyperprior.
    """

    energies: Sequence[Energy]
    held: Sequence[Energy]
    counts: FloatArray
    beyond: Sequence[tuple[float, int, float]]
    mean: FloatArray
    belief: FloatArray

    def at(self, eta: FloatArray) -> EvidencePoint:
        """Value and best step."""
        parts = [*self.held, *self._weighed(eta)]
        curvature = np.zeros((len(parts[0].slope),) * 2)
        for part in parts:
            is_matrix = part.curvature.ndim == 2
            curvature += part.curvature if is_matrix else np.diag(part.curvature)
        unit = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        scaled = curvature * np.outer(unit, unit) + 1e-12 * np.eye(len(unit))
        cholesky = np.linalg.cholesky(scaled)
        covariance = np.linalg.inv(scaled) * np.outer(unit, unit)
        step = -covariance @ sum(part.slope for part in parts)
        off = eta - self.mean
        value = (
            sum(part.at(step)[0] for part in parts)
            + self.counts @ eta
            + self._beyond(eta)[:, 0].sum()
            + np.sum(np.log(np.diag(cholesky) / unit))
            + 0.5 * off @ self.belief @ off
        )
        return EvidencePoint(eta, float(value), step, covariance)

    def derivatives(self, point: EvidencePoint) -> tuple[FloatArray, FloatArray]:
        """Gradient (k,) and Hessian (k, k) of the value."""
        parts = self._weighed(point.eta)
        values, slopes = (np.array(e) for e in zip(*(p.at(point.step) for p in parts), strict=True))
        shares = [
            point.covariance * p.curvature
            if p.curvature.ndim == 1
            else point.covariance @ p.curvature
            for p in parts
        ]
        taken = np.array([np.trace(share) for share in shares])
        mixed = np.array([[np.sum(a * b.T) for b in shares] for a in shares])
        _, rare, rarer = self._beyond(point.eta).T
        gradient = self.counts - 2.0 * values - taken + rare + self.belief @ (point.eta - self.mean)
        hessian = (
            np.diag(4.0 * values + 2.0 * taken + rarer)
            - 4.0 * slopes @ point.covariance @ slopes.T
            - 2.0 * mixed
            + self.belief
        )
        return gradient, hessian

    def _weighed(self, eta: FloatArray) -> list[Energy]:
        return [
            Energy(w * e.constant, w * e.slope, w * e.curvature)
            for w, e in zip(np.exp(-2.0 * eta), self.energies, strict=True)
        ]

    def _beyond(self, eta: FloatArray) -> FloatArray:
        """-log chance of rows beyond thresholds, with two derivatives by log σ, (k, 3)."""
        terms, width = np.zeros((len(eta), 3)), 1e-3
        for k, (rows, size, threshold) in enumerate(self.beyond):
            if rows:
                limit = threshold * np.exp(-eta[k] - np.array([-width, 0.0, width]))
                # A tenth of the rows may be blunders: beyond the threshold they are no surprise.
                chance = 0.1 + 0.9 * chdtrc(size, limit**2)
                low, here, high = -rows * np.log(chance)
                terms[k] = here, (high - low) / (2 * width), (high - 2 * here + low) / width**2
        return terms


def most_likely(evidence: MarginalLikelihood) -> tuple[EvidencePoint, FloatArray]:
    """Newton's method with its Hessian kept positive: where it ends, and the Hessian there."""
    here = evidence.at(np.zeros(len(evidence.counts)))
    gradient, hessian = evidence.derivatives(here)
    for _ in range(30):
        values, vectors = np.linalg.eigh(hessian)
        move = -vectors @ (vectors.T @ gradient / np.maximum(np.abs(values), 1e-2))
        # Farther off than a step of one in a logarithm, the evidence is no parabola.
        move *= min(1.0, 1.0 / max(float(np.abs(move).max()), 1e-300))
        if np.max(np.abs(move)) < SETTLED / 10:
            break
        for _ in range(8):
            there = evidence.at(here.eta + move)
            if there.value <= here.value:
                break
            move = move / 2.0
        else:
            break
        here = there
        gradient, hessian = evidence.derivatives(here)
    return here, hessian


def data_information(hessian: FloatArray, belief: FloatArray) -> FloatArray:
    """Information of the data in that of data and belief: no less than nothing.

    Where a model fits badly, the evidence is no parabola, and its curvature may be below belief's.
    """
    root = np.linalg.cholesky(belief)
    scaled = np.linalg.solve(root, np.linalg.solve(root, hessian - belief).T)
    values, vectors = np.linalg.eigh(scaled)
    part = root @ vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(part @ part.T)


def covariance_of_levels(
    at: Callable[[FloatArray], Any], best: FloatArray, uncertainty: FloatArray
) -> FloatArray:
    """What the scatter of the levels adds to the covariance of the unknowns, (p, p).

    The mean over levels that are likely (Kass and Steffey 1989,
    doi:10.1080/01621459.1989.10478825), by points whose mean and covariance are those of the best
    levels (k,) and their uncertainty (k, k).
    """
    here = at(best)
    values, vectors = np.linalg.eigh(uncertainty * len(best))
    added = np.zeros_like(here.covariance)
    for offset in (vectors * np.sqrt(np.maximum(values, 0.0))).T:
        for there in (at(best + offset), at(best - offset)):
            moved = there.step - here.step
            added += there.covariance - here.covariance + np.outer(moved, moved)
    values, vectors = np.linalg.eigh(added / (2 * len(best)))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
