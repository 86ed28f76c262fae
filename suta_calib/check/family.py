"""One false-alarm rate over everything that may have changed.

Each suspect's gain has, without a change and given the noise, Fisher's distribution, and so has
what is left of the rows as a whole (what is no single change). The smallest of these p-values is
the test. Its distribution without a change is simulated from the known covariance: scores are
drawn by each kind of noise as often as that is probable, with its variance as uncertain as it is
(`error_model`). Many suspects look alike, so that they count as fewer independent tests than they
are: so many as make the simulated rate exact (the effective number of tests of Nyholt 2004,
doi:10.1086/383251, at the level that is asked for).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc, fdtri, ncfdtrinc

from suta_calib.arrays import FloatArray
from suta_calib.trust.evidence import Evidence
from suta_calib.trust.linear_fit import LinearFit


@dataclass(frozen=True, eq=False)
class Family:
    """All tests of one check.

    Attributes:
        false_alarm: rate over all of them.
        freedom: of the noise.
        tests: as how many independent ones they count.
        every: (m, k) what all samples alone may move, where that is less than all of their rows.
    """

    false_alarm: float
    freedom: float
    tests: float
    every: FloatArray | None

    @classmethod
    def of(
        cls,
        fit: LinearFit,
        evidence: Sequence[Evidence],
        kinds: Sequence[tuple[float, int, FloatArray]],
        known: FloatArray,
        every: FloatArray | None,
        false_alarm: float,
    ) -> Family:
        """The tests of a fit.

        Args:
            fit: of the whitened rows.
            evidence: on every suspect.
            kinds: of noise: weight, degrees of freedom, and the covariance (m, m) of the rows.
            known: (m, m) covariance by the estimates, whose size is certain.
            every: as of the attribute.
            false_alarm: rate.
        """
        assert fit.noise_freedom is not None
        # Degrees of freedom that are as good as infinitely many.
        freedom = min(fit.noise_freedom, 1e5)
        maps = [_scores(fit, e) for e in evidence]
        # Draws beyond the level on which its threshold rests: known to a tenth.
        draws = int(np.ceil(100 / false_alarm))
        random, least = np.random.default_rng(0), list[FloatArray]()
        basis = _basis(maps, len(fit.residual))
        in_basis = [m @ basis for m in maps]
        left, of_all = _projector(fit, every)
        for weight, own_freedom, covariance in kinds:
            count = max(round(weight * draws), 1)
            scale = np.sqrt(own_freedom / random.chisquare(own_freedom, count))[:, None]
            noise = random.standard_normal((count, basis.shape[1])) @ _root(basis, covariance).T
            posed = random.standard_normal((count, basis.shape[1])) @ _root(basis, known).T
            along = scale * noise + posed
            p = np.ones(count)
            for e, by_basis in zip(evidence, in_basis, strict=True):
                gain = np.sum((along @ by_basis.T) ** 2, axis=1)
                _lower(p, e.rank, freedom, gain, false_alarm)
            # Beside the suspects' scores, as if it did not depend on them: the level is kept.
            whole = float(np.sum(left * (covariance + known))) / of_all
            as_a_whole = scale[:, 0] ** 2 * whole * random.chisquare(of_all, count)
            _lower(p, of_all, freedom, as_a_whole, false_alarm)
            least.append(p)
        threshold = float(np.quantile(np.concatenate(least), false_alarm))
        return cls(false_alarm, freedom, false_alarm / max(threshold, 1e-300), every)

    def p_value(self, p_single: float) -> float:
        """Of one test, allowing for all."""
        return min(1.0, p_single * self.tests)

    def p_of_all(self, fit: LinearFit) -> float:
        """That the rows as a whole scatter so much, likewise."""
        left, count = _projector(fit, self.every)
        gain = float(fit.settled @ left @ fit.settled)
        return self.p_value(float(fdtrc(count, self.freedom, gain / count)))

    def seen(self, rank: int, power: float) -> float:
        """Noncentrality of a test of so many numbers that is found with a probability."""
        most = float(fdtri(rank, self.freedom, 1.0 - self.false_alarm / self.tests))
        return float(ncfdtrinc(rank, self.freedom, 1.0 - power, most))


def _lower(p: FloatArray, rank: int, freedom: float, gain: FloatArray, false_alarm: float) -> None:
    """Lower p-values (n,) to those of a test with these gains, as far as it matters.

    The quantile of the smallest of many p-values is no larger than that of one.
    """
    small = gain > rank * fdtri(rank, freedom, max(1.0 - 2.0 * false_alarm, 0.0))
    p[small] = np.minimum(p[small], fdtrc(rank, freedom, gain[small] / rank))


def _scores(fit: LinearFit, evidence: Evidence) -> FloatArray:
    """(rank, m) by which the whitened rows make an effect's scores: gain = |scores|²."""
    values, vectors = np.linalg.eigh(evidence.covariance)
    kept = np.argsort(values)[::-1][: evidence.rank]
    axes = vectors[:, kept] * np.sqrt(np.maximum(values[kept], 0.0))
    return np.asarray((fit.followed(evidence.effect.columns) @ axes).T)


def _basis(maps: Sequence[FloatArray], count: int) -> FloatArray:
    """(m, r) orthonormal, that all scores lie in."""
    if not maps:
        return np.zeros((count, 0))
    vectors, values, _ = np.linalg.svd(np.vstack(maps).T, full_matrices=False)
    # Of the largest singular value: less is rounding.
    return np.asarray(vectors[:, values > 1e-9 * values[0]])


def _root(basis: FloatArray, covariance: FloatArray) -> FloatArray:
    """(r, r) F with F Fᵀ the covariance in a basis."""
    values, vectors = np.linalg.eigh(basis.T @ covariance @ basis)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _projector(fit: LinearFit, every: FloatArray | None) -> tuple[FloatArray, int]:
    """(m, m) onto what samples may move and the unknowns of the fit leave; and its rank."""
    if every is None:
        left = np.eye(len(fit.residual)) - fit.jacobian @ fit.inverse @ fit.jacobian.T
        return left, max(round(len(fit.residual) - fit.spent), 1)
    vectors, values, _ = np.linalg.svd(fit.followed(every), full_matrices=False)
    # Of the largest: less is rounding.
    vectors = vectors[:, values > 1e-6 * values[0]]
    return np.asarray(vectors @ vectors.T), max(vectors.shape[1], 1)
