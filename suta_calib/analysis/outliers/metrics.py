"""The four metrics of every group, by exact refits.

With e the errors of a fit, g a group, θ the p identified combinations of parameters:

    contribution    Σ_{e touches g} e² / k / Σ e²       an error shared by the k samples it has
    Cook's distance Δθᵀ Cov⁻¹ Δθ / p                    with the group, and without it
    leave one out   1 - RMS without / RMS with          each over the errors of its own fit
    bias            the systematic part of the touches' residuals after registration

Cook (1977), doi:10.2307/1268249, takes XᵀX/s² for Cov⁻¹; errors here share samples, so Cov is the
covariance that scatter of the *samples* makes (`influence`), with s² of the fit without
the group, as an outlier would otherwise hide behind the scatter it makes itself.

What was found to be displaced is left out while the *other* groups are looked at, so that no group
is blamed for another one's errors (swamping) or hidden by them (masking).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from suta_calib.analysis.outliers.groups import Grouping
from suta_calib.analysis.outliers.influence import Influence
from suta_calib.analysis.outliers.reference import ReferenceFit, Refit
from suta_calib.analysis.outliers.registration import Registered, systematic
from suta_calib.analysis.outliers.result import Measures
from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.solver.information import predicted_information


@dataclass(eq=False)
class Scene:
    """What the metrics are taken over.

    Attributes:
        reference: the fit.
        believed: (samples,) touches that are not gross.
        displaced: (samples,) touches of what was found displaced.
    """

    reference: ReferenceFit
    believed: BoolArray
    displaced: BoolArray

    @property
    def kept(self) -> BoolArray:
        """(samples,) what nothing is held against."""
        return np.asarray(self.believed & ~self.displaced)

    @cached_property
    def whole(self) -> Refit:
        """The fit of every believed touch."""
        found = self.reference.over(self.believed)
        assert found is not None, "the job's own samples can be fitted"
        return found

    @cached_property
    def clean(self) -> Refit:
        """The fit of what nothing is held against."""
        return self.reference.over(self.kept) or self.whole

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
        own = [
            k for k, n in enumerate(names) if n in self.reference.estimated and k not in set(arm)
        ]
        prior = fit.problem.prior_precision()[arm]
        return Influence.of(information.curvature, information.variance, prior, arm, own)

    def with_and_without(self, rows: BoolArray) -> tuple[Refit | None, Refit | None]:
        """Fits with a group and without it, whatever else is displaced left out of both."""
        mine = rows & self.believed
        if np.any(mine & self.kept):
            mine &= self.kept
        return (
            self.reference.over(self.kept | mine),
            self.reference.over(self.kept & ~rows),
        )


def measures(
    scene: Scene,
    grouping: Grouping,
    chosen: Sequence[int] | None = None,
    done: Callable[[], None] = lambda: None,
) -> Measures:
    """The four metrics of every group.

    Args:
        scene: fit, and what is set aside.
        grouping: the groups.
        chosen: those to leave out one by one; the others have a contribution only.
        done: called after each.
    """
    n = len(grouping)
    cook, fall, bias = (np.full(n, np.nan) for _ in range(3))
    for g in range(n) if chosen is None else chosen:
        rows = grouping.rows(g)
        with_it, without = scene.with_and_without(rows)
        if with_it is not None and np.any(rows & scene.believed):
            bias[g] = _bias(scene, grouping, g, with_it)
        if with_it is not None and without is not None:
            cook[g] = _cook(scene, with_it, without)
            fall[g] = 1.0 - without.rms / with_it.rms if with_it.rms > 0 else 0.0
        done()
    return Measures(_contributions(scene, grouping), cook, fall, bias)


def shares(samples: IntArray, displaced: BoolArray) -> FloatArray:
    """(n, k) how much of an error each of its k samples answers for; rows sum to one.

    Alike, unless some of them were found displaced: then those alone.
    """
    at_fault = displaced[samples]
    blamed = np.where(np.any(at_fault, axis=1, keepdims=True), at_fault, np.ones_like(at_fault))
    return np.asarray(blamed / blamed.sum(axis=1, keepdims=True))


def _contributions(scene: Scene, grouping: Grouping) -> FloatArray:
    fit = scene.whole
    parts = fit.squared[:, None] * shares(fit.samples, scene.displaced)
    member = grouping.member[fit.samples]
    total = np.bincount(member.reshape(-1), parts.reshape(-1), len(grouping))
    whole = float(fit.squared.sum())
    return np.asarray(total / whole if whole > 0 else total)


def _cook(scene: Scene, with_it: Refit, without: Refit) -> float:
    change = np.array([with_it.values[n] - without.values[n] for n in scene.moved])
    size = without.residual.shape[1]
    variance = float(np.mean(without.squared / without.sigma**2)) / size
    if not scene.influence.directions or variance <= 0:
        return float("nan")
    return float(scene.influence.distance(change[None])[0] / variance)


def _bias(scene: Scene, grouping: Grouping, group: int, fit: Refit) -> float:
    registered = Registered.of(scene.reference.term, scene.kept)
    rows = grouping.rows(group) & scene.believed
    if registered is None:
        inside = grouping.rows(group)[fit.samples].all(axis=1)
        return float(np.sqrt(np.mean(fit.squared[inside])))
    # The arm as it is without what is displaced: it would give way to it.
    residual = registered.residuals(scene.clean.values)
    return float(systematic(residual[None], rows, grouping.name, registered)[0])
