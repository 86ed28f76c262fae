"""The four metrics of every group, by exact refits.

With e the errors of a fit, g a group, θ the p identified combinations of parameters:

    contribution    Σ_{e touches g} e² / k / Σ e²       an error shared by the k samples it has
    Cook's distance Δθᵀ Cov⁻¹ Δθ / p                    with the group, and without it
    leave one out   1 - RMS without / RMS with          each over the errors of its own fit
    bias            the systematic part of the touches' residuals after registration

Cook (1977), doi:10.2307/1268249, takes XᵀX/s² for Cov⁻¹; errors here share samples, so Cov is the
covariance that scatter of the *samples* makes (`Influence`), with s² of the fit without
the group, as an outlier would otherwise hide behind the scatter it makes itself.

What was found to be displaced is left out while the *other* groups are looked at, so that no group
is blamed for another one's errors (swamping) or hidden by them (masking).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from suta_calib.analysis.outliers.reference import (
    Grouping,
    ReferenceFit,
    Refit,
    Registered,
    systematic,
)
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.solver.information import predicted_information, scaled_inverse

# Eigenvalue of an information matrix, of the largest, that counts as none.
SINGULAR: Final = 1e-10


@dataclass(eq=False)
class JudgedFit:
    """A fit, which touches (samples,) are not gross, and which are of what is displaced."""

    reference: ReferenceFit
    believed: BoolArray
    displaced: BoolArray

    @property
    def not_gross(self) -> BoolArray:
        """(samples,) what nothing is held against."""
        return np.asarray(self.believed & ~self.displaced)

    @cached_property
    def full_refit(self) -> Refit:
        """The fit of every believed touch."""
        refit = self.reference.over(self.believed)
        assert refit is not None, "the job's own samples can be fitted"
        return refit

    @cached_property
    def clean(self) -> Refit:
        """The fit of what nothing is held against."""
        return self.reference.over(self.not_gross) or self.full_refit

    @cached_property
    def moved(self) -> tuple[str, ...]:
        """The arm's parameters that the fit estimates."""
        return tuple(n for n in self.reference.parameters if n in self.reference.estimated)

    @cached_property
    def influence(self) -> Influence:
        """How a change of those parameters counts."""
        fit = self.clean
        names = fit.problem.names
        sigmas = self.reference.block_sigmas(fit.problem.terms)
        information = predicted_information(fit.problem, fit.x, sigmas)
        arm = [names.index(n) for n in self.moved]
        of_term = [
            k for k, n in enumerate(names) if n in self.reference.estimated and k not in set(arm)
        ]
        prior = fit.problem.prior_precision()[arm]
        return Influence.of(information.curvature, information.variance, prior, arm, of_term)

    @cached_property
    def registered(self) -> Registered | None:
        """Its touches against what is certified, set by set; None where nothing is."""
        return Registered.of(self.reference.term, self.not_gross)

    @cached_property
    def off(self) -> FloatArray | None:
        """(samples, 3) where they lie from there, m.

        The arm is as it is without what is displaced: it would give way to it.
        """
        return None if self.registered is None else self.registered.residuals(self.clean.values)

    def with_and_without(self, rows: BoolArray) -> tuple[Refit | None, Refit | None]:
        """Fits with a group and without it, whatever else is displaced left out of both."""
        mine = rows & self.believed
        if np.any(mine & self.not_gross):
            mine &= self.not_gross
        return self.reference.over(self.not_gross | mine), self.reference.over(
            self.not_gross & ~rows
        )


def measures(
    scene: JudgedFit,
    grouping: Grouping,
    chosen: Sequence[int] | None = None,
    done: Callable[[], None] = lambda: None,
) -> FloatArray:
    """(4, groups) metrics of every group, NaN where one does not exist.

    The ``chosen`` are left out one by one, and ``done`` is called after each; the others have a
    contribution only.
    """
    n, full_fit = len(grouping), scene.full_refit
    parts = full_fit.squared[:, None] * shares(full_fit.samples, scene.displaced)
    member = grouping.member[full_fit.samples]
    total = float(full_fit.squared.sum()) or 1.0
    contribution = np.bincount(member.reshape(-1), parts.reshape(-1), n) / total
    cook, fall, bias = np.full((3, n), np.nan)
    for g in range(n) if chosen is None else chosen:
        rows = grouping.rows(g)
        with_it, without = scene.with_and_without(rows)
        if with_it is not None and np.any(rows & scene.believed):
            bias[g] = _bias(scene, grouping, g, with_it)
        if with_it is not None and without is not None:
            change = np.array([with_it.values[n] - without.values[n] for n in scene.moved])
            variance = np.mean(without.squared / without.sigma**2) / without.residual.shape[1]
            if scene.influence.directions and variance > 0:
                cook[g] = scene.influence.distance(change[None])[0] / variance
            fall[g] = 1.0 - without.rms / with_it.rms if with_it.rms > 0 else 0.0
        done()
    return np.array([contribution, cook, fall, bias])


def shares(samples: IntArray, displaced: BoolArray) -> FloatArray:
    """(n, k) how much of an error each of its k samples answers for; rows sum to one.

    Alike, unless some of them were found displaced: then those alone.
    """
    at_fault = displaced[samples]
    blamed = np.where(np.any(at_fault, axis=1, keepdims=True), at_fault, np.ones_like(at_fault))
    return np.asarray(blamed / blamed.sum(axis=1, keepdims=True))


def _bias(scene: JudgedFit, grouping: Grouping, group: int, fit: Refit) -> float:
    rows = grouping.rows(group) & scene.believed
    if scene.registered is None or scene.off is None:
        inside = grouping.rows(group)[fit.samples].all(axis=1)
        return float(np.sqrt(np.mean(fit.squared[inside])))
    return float(systematic(scene.off[None], rows, grouping.name, scene.registered)[0])


@dataclass(frozen=True, eq=False)
class Influence:
    """The quadratic form of Cook's distance: a change of the parameters in units of their noise.

    Only combinations that the data determine count: a priori knowledge keeps the others in place,
    and what leaving samples out does to them is no influence of the samples. ``form`` (p, p) is
    the inverse covariance of these ``directions``, over all parameters.
    """

    form: FloatArray
    directions: int

    @classmethod
    def of(
        cls,
        curvature: FloatArray,
        variance: FloatArray,
        prior: FloatArray,
        arm: Sequence[int],
        own_rows: Sequence[int],
    ) -> Influence:
        """From the cost's curvature without priors and its gradient's variance, both (n, n).

        ``prior`` (p,) is the precision of the priors on the p parameters of the ``arm``; those of
        ``own_rows`` are estimated with them, and count for nothing themselves.
        """
        passed_on = np.hstack(
            [
                np.eye(len(arm)),
                -curvature[np.ix_(arm, own_rows)]
                @ scaled_inverse(curvature[np.ix_(own_rows, own_rows)], SINGULAR),
            ]
        )
        both = np.ix_([*arm, *own_rows], [*arm, *own_rows])
        data = passed_on @ curvature[both] @ passed_on.T
        score = passed_on @ variance[both] @ passed_on.T
        total = data + np.diag(prior)
        # R (p, r) with Rᵀ M R = 1, of the r directions that are more than rounding.
        scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
        values, vectors = np.linalg.eigh(total / np.outer(scale, scale))
        significant = values > SINGULAR * max(float(values.max(initial=0.0)), 1e-300)
        root = vectors[:, significant] / np.sqrt(values[significant]) / scale[:, None]
        share, turn = np.linalg.eigh(root.T @ data @ root)
        # Share of a combination's information that must come from the data.
        basis = root @ turn[:, share > 0.9]
        weigh = total @ basis
        return cls(
            weigh @ scaled_inverse(basis.T @ score @ basis, SINGULAR) @ weigh.T, basis.shape[1]
        )

    def distance(self, change: FloatArray) -> FloatArray:
        """(k,) squared distances per direction of changes (k, p)."""
        squared = np.sum((change @ self.form) * change, axis=1)
        return np.asarray(squared / max(self.directions, 1))
