"""The scanner's pose by scans that share errors of the hand, with what these are.

A hand errs by more than a scanner does, and all points of a profile share its error. So a profile
counts as the few numbers that it shows (an arc: centre and radius; a piece of a line: two heights),
which scatter by the hand's error and by what the points of the profile scatter. How large both are
is learnt from the scans, by restricted maximum likelihood (Patterson and Thompson 1971,
doi:10.1093/biomet/58.3.545). Scans that the others prove wrong are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import fdtri

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.planar import fitted_circle, piece_of_line
from suta_calib.terms.hand_eye_start import Poses
from suta_calib.terms.profile_start import (
    Answers,
    BallModel,
    PlaneModel,
    ScanModel,
    in_scanner,
    scanner,
)
from suta_calib.words import listed

# Of what a profile shows, in units of the model's scale: noise below it is rounding.
_LEAST: Final = 1e-6


def model_of(
    hand: Poses, points: Sequence[FloatArray], radius: float | None, *, plane: bool
) -> ScanModel:
    """What the points (k, 2) on the surface, one array for each scan, show."""
    if plane:
        ends = in_scanner(np.array([piece_of_line(p) for p in points]))
        return PlaneModel(hand, ends, np.array([_of_line(p) for p in points]))
    circles = [fitted_circle(p) for p in points]
    arcs = np.array([[*centre, size] for centre, size in circles])
    scatter = np.array([_of_circle(p, arc) for p, arc in zip(points, arcs, strict=True)])
    return BallModel(hand, arcs, radius, scatter)


def _of_circle(points: FloatArray, arc: FloatArray) -> FloatArray:
    """(3, 3) covariance of a fitted circle, by how its points scatter; neighbours err alike."""
    away = points - arc[:2]
    distance = np.linalg.norm(away, axis=1)
    slope = np.column_stack([away / distance[:, None], np.ones(len(away))])
    return np.asarray(_variance(distance - arc[2], 3) * np.linalg.pinv(slope.T @ slope))


def _of_line(points: FloatArray) -> FloatArray:
    """(2, 2) covariance of the heights of both ends of a piece of a line."""
    centred = points - points.mean(axis=0)
    across = np.linalg.svd(centred, full_matrices=False)[2][1]
    return np.asarray(2.0 / len(points) * _variance(centred @ across, 2) * np.eye(2))


def _variance(off: FloatArray, unknowns: int) -> float:
    """Variance of points about a curve, for as many as are independent."""
    square = float(np.sum(off**2)) / max(len(off) - unknowns, 1)
    correlation = float(np.sum(off[1:] * off[:-1]) / max(np.sum(off**2), 1e-300))
    correlation = min(max(correlation, 0.0), 0.95)
    return square * (1.0 + correlation) / (1.0 - correlation)


@dataclass(frozen=True, eq=False)
class ScanFit:
    """The scanner's pose by scans.

    Attributes:
        model: of all scans.
        state: the answer.
        inliers: (n,) scans that were fitted.
        levels: (2,) standard deviations of the two sources of noise.
        covariance: (3 + k, 3 + k) of a turn of X about its own axes and of all else.
        freedom: numbers that the scans give beyond the unknowns.
        by_source: (2, 3 + k, 3 + k) the parts of the covariance that the two sources make.
        turned: (n,) scans that were not fitted because x of their profile is reversed.
    """

    model: ScanModel
    state: Answers
    inliers: BoolArray
    levels: FloatArray
    covariance: FloatArray
    freedom: int
    by_source: FloatArray
    turned: BoolArray

    @property
    def outliers(self) -> list[int]:
        """Scans that the others prove wrong, from 0."""
        return np.flatnonzero(~self.inliers).tolist()

    @property
    def fit_turned(self) -> BoolArray:
        """(n,) scans that were not fitted, and fit well with x reversed."""
        nowhere, every = np.zeros_like(self.inliers), np.ones_like(self.inliers)
        again = self.misfit(self.model.reversed(every), nowhere)
        return np.asarray(~self.inliers & (again <= self.well))

    @property
    def well(self) -> FloatArray:
        """(n,) misfit below which a change makes a scan right.

        It brings it well among the others, not to their edge.
        """
        return np.minimum(0.5, self.misfit(self.model, np.zeros_like(self.inliers)) / 8.0)

    def misfit(self, model: ScanModel, fitted: BoolArray) -> FloatArray:
        """(n,) how far scans are off, over what a scan may be: above one it is wrong.

        Args:
            model: of the scans.
            fitted: (n,) whether the answer followed them.
        """
        size = model.residuals(self.state)[0].shape[2]
        # Probability that a set without wrong scans loses one.
        chance = 0.01 / len(fitted)
        limit = size * fdtri(size, max(self.freedom, 1), 1.0 - chance)
        return np.asarray(self.distance(model, fitted) / limit)

    def distance(self, model: ScanModel, fitted: BoolArray) -> FloatArray:
        """(n,) squared distances of scans, in units of what they scatter; else as `misfit`."""
        residual, slope = model.residuals(self.state)
        total = _total(model, self.state, self.levels)
        of_answer = slope[0] @ self.covariance @ np.swapaxes(slope[0], 1, 2)
        total = np.where(fitted[:, None, None], total, total + of_answer)
        return np.asarray(np.einsum("ni,nij,nj->n", residual[0], np.linalg.inv(total), residual[0]))


def _total(model: ScanModel, state: Answers, levels: FloatArray) -> FloatArray:
    """(n, d, d) covariance of the residuals."""
    sources = np.einsum("k,knij->nij", levels**2, model.noise(state))
    least = (_LEAST * model.scale) ** 2 * np.eye(sources.shape[1])
    return np.asarray(sources + model.scatter + least)


def fit_scans(model: ScanModel, *, robust: bool = True) -> ScanFit:
    """The answer that most scans agree on, and which do not."""
    state, count = scanner(model), len(model.hand[1])
    inliers = np.ones(count, dtype=np.bool_)
    if robust:
        residual, _ = model.residuals(state)
        size = np.linalg.norm(residual[0], axis=1)
        inliers = size <= max(4.0 * model.typical(state), float(np.median(size)))
    fit = _settled(model, state, inliers)
    return _without_turned(_agreed(fit)) if robust else fit


def _agreed(fit: ScanFit) -> ScanFit:
    """The same without the scans that the others prove wrong."""
    for _ in range(10):
        agreeing = fit.misfit(fit.model, fit.inliers) <= 1.0
        # Fewer than half are no majority.
        if np.array_equal(agreeing, fit.inliers) or 2 * agreeing.sum() <= len(agreeing):
            break
        fit = _settled(fit.model, fit.state, agreeing)
    return fit


def _without_turned(fit: ScanFit) -> ScanFit:
    """The same without profiles that were turned about the beam, but were followed by it.

    Of many turned profiles some pull the answer to themselves. Once those that are known are turned
    back, the others are found by an answer that all of these give.
    """
    known = fit.fit_turned
    if not known.any():
        return fit
    model, every = fit.model, np.ones_like(known)
    turned, back, follow = known, fit, fit.inliers | known
    # Turned back scans show others: until they show no more.
    for _ in range(5):
        back = _agreed(_settled(model.reversed(turned), back.state, follow))
        nowhere = np.zeros_like(known)
        gain = back.distance(back.model, nowhere)
        gain = gain - back.distance(back.model.reversed(every), nowhere)
        # Twice the logarithm of the likelihood ratio that is worth a trial: one in seven.
        more = gain > 4.0
        if not more.any():
            break
        turned, follow = turned ^ more, back.inliers | more
    # Of a profile that fits both ways nothing is said: e⁷ is a thousand.
    turned = turned & (gain < -2.0 * 7.0)
    sound = ~turned & (back.misfit(model, back.inliers & ~turned) <= 1.0)
    # More than half would be no outliers, and of less than a third too little would be left.
    if 2 * turned.sum() > len(turned) or 3 * sound.sum() < len(turned):
        return replace(fit, turned=known)
    return replace(_settled(model, back.state, sound), turned=turned)


def _settled(model: ScanModel, state: Answers, inliers: BoolArray) -> ScanFit:
    """Least squares over some scans, weighed by the noise that they show."""
    agreeing = model.take(np.flatnonzero(inliers).astype(np.intp))
    levels = np.full(2, 0.02 * model.scale)
    for _ in range(8):
        state = _weighed(agreeing, state, levels)
        before, levels = levels, _levels(agreeing, state, levels)
        if np.allclose(before, levels, rtol=1e-2, atol=_LEAST * model.scale):
            break
    state = _weighed(agreeing, state, levels)
    residual, slope = agreeing.residuals(state)
    free = agreeing.free(state)
    J, weight = slope[0] @ free, np.linalg.inv(_total(agreeing, state, levels))
    inner = _inverse(_information(J, weight))
    freedom = residual[0].size - free.shape[1]
    # The noise of few scans is itself uncertain: errors in units of it have Student's variance.
    student = freedom / (freedom - 2.0) if freedom > 2 else 3.0
    covariance = student * free @ inner @ free.T
    by_source = [
        student * free @ inner @ _information(J, weight @ one @ weight) @ inner @ free.T
        for one in levels[:, None, None, None] ** 2 * agreeing.noise(state)
    ]
    none = np.zeros_like(inliers)
    return ScanFit(model, state, inliers, levels, covariance, freedom, np.array(by_source), none)


def _information(slope: FloatArray, weight: NDArray[Any]) -> FloatArray:
    return np.asarray(np.einsum("nip,nij,njq->pq", slope, weight, slope))


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a matrix whose diagonal spans many magnitudes."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.asarray(
        np.linalg.pinv(matrix / np.outer(scale, scale), 1e-14) / np.outer(scale, scale)
    )


def _weighed(model: ScanModel, state: Answers, levels: FloatArray) -> Answers:
    """Gauss and Newton with weights by these levels of noise."""
    for _ in range(15):
        weight = np.linalg.inv(_total(model, state, levels))
        residual, slope = model.residuals(state)
        free = model.free(state)
        J, r = slope[0] @ free, residual[0]
        pull = np.einsum("nip,nij,nj->p", J, weight, r)
        step = -free @ (_inverse(_information(J, weight)) @ pull)
        cost = float(np.einsum("ni,nij,nj->", r, weight, r))
        for _ in range(6):
            tried = model.moved(state, step[None])
            after = model.residuals(tried)[0][0]
            better = float(np.einsum("ni,nij,nj->", after, weight, after))
            if better <= cost:
                break
            step = 0.4 * step
        else:
            break
        state = tried
        if cost - better < 1e-10 * cost:
            break
    return state


def _levels(model: ScanModel, state: Answers, start: FloatArray) -> FloatArray:
    """Standard deviations of the two sources, as the residuals show them."""
    residual, slope = model.residuals(state)
    r, J, sources = residual[0], slope[0] @ model.free(state), model.noise(state)
    floor = model.scatter + (_LEAST * model.scale) ** 2 * np.eye(r.shape[1])

    def unlikely(logarithms: FloatArray) -> float:
        total = floor + np.einsum("k,knij->nij", np.exp(2.0 * logarithms), sources)
        weight = np.linalg.inv(total)
        misfit = float(np.einsum("ni,nij,nj->", r, weight, r))
        sizes = np.linalg.slogdet(total)[1].sum() + np.linalg.slogdet(_information(J, weight))[1]
        return 0.5 * (misfit + float(sizes))

    # Beyond these nothing changes: no source is so small, and no hand so bad.
    least, most = np.log(1e-8), np.log(0.2)
    minimum = minimize(
        unlikely,
        np.clip(np.log(np.maximum(start, 1e-8)), least, most),
        method="Nelder-Mead",
        bounds=[(least, most)] * 2,
        options={"xatol": 0.01, "fatol": 1e-3},
    )
    return np.asarray(np.exp(minimum.x))


def causes(fit: ScanFit, names: Sequence[str]) -> list[str]:
    """What would make scans agree that do not, one sentence each."""
    nowhere = np.zeros_like(fit.inliers)
    well, found = fit.well, list[str]()
    wrong = np.flatnonzero(~fit.inliers & ~fit.turned).tolist()
    if rows := np.flatnonzero(fit.turned).tolist():
        found.append(
            f"{_fit(rows, names)} the others with x reversed: the profile was turned by 180° about "
            f"the beam. Change the sign of x in {_these(rows)}, or leave {_them(rows)} out."
        )
    # Of more nobody exchanged two: something else is wrong.
    order, left = np.arange(len(names)), wrong[:12]
    while left:
        j = left.pop(0)
        for k in left:
            swapped = order.copy()
            swapped[[j, k]] = k, j
            again = fit.misfit(fit.model.exchanged(swapped), nowhere)
            if np.all(again[[j, k]] <= well[[j, k]]):
                left.remove(k)
                found.append(
                    f"{_fit([j, k], names)} the others if the two are exchanged. Check which "
                    "profile was taken at which pose."
                )
                break
    return found


def _fit(rows: Sequence[int], names: Sequence[str]) -> str:
    one = len(rows) == 1
    return f"Scan{'s' * (not one)} {listed([names[k] for k in rows])} fit{'s' * one}"


def _these(rows: Sequence[int]) -> str:
    return "this profile" if len(rows) == 1 else "these profiles"


def _them(rows: Sequence[int]) -> str:
    return "it" if len(rows) == 1 else "them"
