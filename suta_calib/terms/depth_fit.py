"""The pose of a depth camera by pictures that share errors of the hand, with what these are.

All points of a picture share where the hand really was: the numbers of a picture scatter by
``f² S + H L Hᵀ``, of what the camera is stated to err by, S, and of the hand's displacement and
turn, L. How large the parts are is learnt from the pictures, by restricted maximum likelihood
(Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545). Pictures that the others prove wrong are
left out.

That all lengths of the camera are too long by one part is one more unknown, with a prior. So ±
follows what the pictures tell of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.optimize import minimize
from scipy.special import fdtri

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.terms.depth_rows import (
    OF_HAND,
    SCALE,
    DepthRows,
    Eye,
    PictureSums,
    State,
)
from suta_calib.terms.hand_eye_start import FEWEST

# Pictures from parts of which is started too, so that a few that are wrong decide nothing.
_PARTS: Final = 6
# What levels of noise may be: the camera's over what is stated, the hand's in m, and in rad.
_LEAST: Final = np.array([1e-3, 1e-7, 1e-7])
_MOST: Final = np.array([1e2, 0.2, 0.2])


@dataclass(frozen=True, eq=False)
class Levels:
    """What is learnt of the noise.

    Attributes:
        camera: its standard deviations, over those that are stated.
        displaced: of the hand's place, per axis, m.
        turned: of its turn, per axis, rad.
    """

    camera: float
    displaced: float
    turned: float

    @classmethod
    def of(cls, logarithms: FloatArray) -> Levels:
        """Within what they may be."""
        return cls(*np.clip(np.exp(logarithms), _LEAST, _MOST).tolist())

    @property
    def array(self) -> FloatArray:
        """(3,)."""
        return np.array([self.camera, self.displaced, self.turned])

    @property
    def of_hand(self) -> FloatArray:
        """(6,)."""
        return np.repeat([self.displaced, self.turned], 3)


@dataclass(frozen=True, eq=False)
class WeighedSums:
    """Sums over pictures, weighed by levels of noise.

    Attributes:
        normal: (p, p) curvature.
        pull: (p,) gradient.
        cost: squares of all numbers over their noise.
        sizes: logarithm of the determinant of their covariances.
    """

    normal: FloatArray
    pull: FloatArray
    cost: float
    sizes: float

    @classmethod
    def of(cls, sums: PictureSums, levels: Levels) -> WeighedSums:
        """By Woodbury's identity: of every picture only what the hand can do counts."""
        f, half = levels.camera**2, levels.of_hand
        by_hand = half[:, None] * sums.HH * half
        kernel = half[:, None] * np.linalg.inv(f * np.eye(OF_HAND) + by_hand) * half
        by_kernel = kernel @ sums.HJ
        normal = sums.JJ.sum(axis=0) - np.einsum("nhp,nhq->pq", sums.HJ, by_kernel)
        pull = sums.Jr.sum(axis=0) - np.einsum("nhp,nh->p", by_kernel, sums.Hr)
        cost = sums.rr.sum() - np.einsum("nh,nhk,nk->", sums.Hr, kernel, sums.Hr)
        each = np.linalg.slogdet(np.eye(OF_HAND) + by_hand / f)[1]
        return cls(normal / f, pull / f, cost / f, float(each.sum() + np.log(f) * sums.count.sum()))

    def with_priors(self, state: State) -> WeighedSums:
        """With what is known beforehand."""
        normal, pull, cost = self.normal.copy(), self.pull.copy(), self.cost
        for column, at, std in state.priors:
            normal[column, column] += std**-2.0
            pull[column] += at / std**2
            cost += (at / std) ** 2
        return WeighedSums(normal, pull, cost, self.sizes)

    @cached_property
    def _spectrum(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Units (p,) of the unknowns, and the curvature in these: values (p,) and axes (p, p)."""
        size = np.sqrt(np.maximum(np.diag(self.normal), 1e-300))
        values, axes = np.linalg.eigh(self.normal / np.outer(size, size))
        # Relative size of a curvature that is rounding: what is open is far off, not infinitely.
        return size, np.maximum(values, 1e-13), axes

    @cached_property
    def inverse(self) -> FloatArray:
        """(p, p) of the curvature."""
        size, values, axes = self._spectrum
        return np.asarray((axes / values) @ axes.T / np.outer(size, size))

    @property
    def unlikely(self) -> float:
        """Negative logarithm of the restricted likelihood."""
        size, values, _ = self._spectrum
        left = self.cost - float(self.pull @ self.inverse @ self.pull)
        return 0.5 * (left + self.sizes + float(np.sum(np.log(values)) + 2 * np.sum(np.log(size))))


@dataclass(frozen=True, eq=False)
class DepthFit:
    """The camera's pose by pictures.

    Attributes:
        rows: of all pictures.
        state: the answer.
        inliers: (n,) pictures that were fitted.
        levels: of the noise.
        covariance: (p, p) of all unknowns.
        freedom: numbers that the pictures give beyond the unknowns.
        sums: of all pictures, at the answer.
    """

    rows: DepthRows
    state: State
    inliers: BoolArray
    levels: Levels
    covariance: FloatArray
    freedom: int
    sums: PictureSums

    @property
    def by_prior(self) -> list[FloatArray]:
        """The part of the covariance (p, p) that each of the priors makes."""
        columns = [(self.covariance[:, prior.column], prior.std) for prior in self.state.priors]
        return [np.outer(column, column) / std**2 for column, std in columns]

    @property
    def scale_by_data(self) -> tuple[float, float]:
        """The scale as the pictures alone have it, and its standard deviation."""
        variance = float(self.covariance[SCALE, SCALE])
        told = 1.0 / variance - self.rows.scale_std**-2.0
        if told <= 1e-6 / variance:
            return 0.0, np.inf
        return self.state.eye.scale / variance / told, told**-0.5

    def misfit(self) -> FloatArray:
        """(n,) how far pictures are off, over what one may be: above one it is wrong."""
        sums, levels = self.sums, self.levels
        spread, axes = np.linalg.eigh(sums.HH)
        there = spread > 1e-9 * spread[:, -1:]
        root = np.sqrt(np.where(there, spread, 0.0))
        inverse = np.where(there, 1.0 / np.where(there, root, 1.0), 0.0)
        off = inverse * np.einsum("nhk,nh->nk", axes, sums.Hr)
        half = levels.of_hand[:, None] * axes * root[:, None]
        total = levels.camera**2 * np.eye(OF_HAND) + np.swapaxes(half, 1, 2) @ half
        # What the answer is uncertain by, where the picture had no part in it.
        slope = inverse[:, :, None] * (np.swapaxes(axes, 1, 2) @ sums.HJ)
        of_answer = slope @ self.covariance @ np.swapaxes(slope, 1, 2)
        total += np.where(self.inliers[:, None, None], 0.0, of_answer)
        distance = np.einsum("nk,nk->n", off, np.linalg.solve(total, off[..., None])[..., 0])
        size = there.sum(axis=1)
        # Probability that a set without wrong pictures loses one.
        chance = 1.0 - 0.01 / len(distance)
        by_hand = distance / (size * fdtri(size, max(self.freedom, 1), chance))
        inner = np.maximum(sums.count - size, 0)
        left = np.maximum(sums.rr - np.sum(off**2, axis=1), 0.0)
        within = np.sqrt(left / np.maximum(inner, 1)) / levels.camera
        # Points of a picture scatter about one another so many times as much as in most: they are
        # not what they are called.
        return np.asarray(np.maximum(by_hand, np.where(inner > 0, within / 5.0, 0.0)))


def fit_depth(rows: DepthRows, *, robust: bool = True, start: Eye | None = None) -> DepthFit:
    """The answer that most pictures agree on, and which do not.

    Args:
        rows: what was seen.
        robust: False to believe all pictures.
        start: where the camera is; searched by default.
    """
    count = len(rows)
    state = rows.seen_by(start or _started(rows))
    inliers = np.ones(count, dtype=np.bool_)
    if robust:
        state, off = _descended(rows, state)
        inliers = off <= max(4.0 * float(np.median(off)), 1e-12)
    fit = _settled(rows, state, inliers)
    for _ in range(10 if robust else 0):
        agreeing = fit.misfit() <= 1.0
        # Fewer than half are no majority.
        if np.array_equal(agreeing, fit.inliers) or 2 * agreeing.sum() <= count:
            break
        fit = _settled(rows, fit.state, agreeing)
    return fit


def _started(rows: DepthRows, parts: int = _PARTS) -> Eye:
    """By each kind alone, from all pictures and from parts of them: that most agree with."""
    count, random = len(rows), np.random.default_rng(0)
    few = max(count // 3, 2 * FEWEST + 2)
    choices = [np.arange(count)]
    if few < count:
        choices += [np.sort(random.choice(count, few, replace=False)) for _ in range(parts)]
    begun = list[Eye]()
    for term, picture in zip(rows.terms, rows.picture, strict=True):
        for chosen in choices:
            some = term.take(np.isin(picture, chosen))
            begun.append(_eye_of(some.start(*some.poses.at({}))))
    off = [float(np.median(_sizes(rows.sums(rows.seen_by(eye))))) for eye in begun]
    return begun[int(np.argmin(off))]


def middle_off(rows: DepthRows) -> float:
    """How far a picture is off in the middle, for the camera that fits most best, m."""
    # Of pictures that are read aright few are wrong: all of them start well.
    state, _ = _descended(rows, rows.seen_by(_started(rows, parts=0)))
    return float(np.median(np.linalg.norm(rows.sums(state).off, axis=1)))


def _eye_of(start: FloatArray) -> Eye:
    return Eye(rotation_from_vector(start[3:6]), start[:3])


def _sizes(sums: PictureSums) -> FloatArray:
    """(n,) root mean square of every picture's numbers."""
    return np.asarray(np.sqrt(sums.rr / sums.count))


def _descended(rows: DepthRows, state: State) -> tuple[State, FloatArray]:
    """Steps with pictures that are far off weighing less; and how far pictures are off then."""
    for _ in range(12):
        sums = rows.sums(state)
        off = _sizes(sums)
        weight = 1.0 / (1.0 + (off / max(2.0 * float(np.median(off)), 1e-300)) ** 2) / sums.count
        normal = np.einsum("n,npq->pq", weight, sums.JJ)
        pull = np.einsum("n,np->p", weight, sums.Jr)
        # Sizes wait: they are told last.
        for prior in state.priors:
            normal[prior.column, prior.column] *= 1e6
        step = -WeighedSums(normal, pull, 0.0, 0.0).inverse @ pull
        state = state.moved(_short(step))
        if np.abs(step).max() < 1e-7:
            break
    return state, _sizes(rows.sums(state))


def _short(step: FloatArray) -> FloatArray:
    """A step whose turn is a small one."""
    longest = float(np.abs(step[:3]).max())
    # A turn of more than that is no small one, rad.
    return step * min(1.0, 0.7 / max(longest, 1e-12))


def _settled(rows: DepthRows, state: State, inliers: BoolArray) -> DepthFit:
    """Least squares over some pictures, weighed by the noise that they show."""
    levels = Levels(1.0, 1e-4, 1e-4)
    for _ in range(8):
        state = _weighed(rows, state, inliers, levels)
        before, levels = levels, _learnt(rows.sums(state).take(inliers), levels, state)
        if np.allclose(levels.array, before.array, rtol=0.03):
            break
    state = _weighed(rows, state, inliers, levels)
    sums = rows.sums(state)
    some = sums.take(inliers)
    ranks = np.linalg.matrix_rank(some.HH, hermitian=True)
    freedom = int(ranks.sum()) + len(state.priors) - state.unknowns
    covariance = _covariance(some, levels, state)
    return DepthFit(rows, state, inliers, levels, covariance, freedom, sums)


def _covariance(sums: PictureSums, levels: Levels, state: State) -> FloatArray:
    """(p, p) of all unknowns, the mean over what the levels of noise may be.

    Few pictures leave these uncertain, and with them what each picture counts for: their posterior
    is taken as normal in their logarithms, at the points of a cubature of the third degree.
    """
    at = np.log(levels.array)
    # Wide enough for the difference to be no rounding.
    step = 0.3
    axes = step * np.eye(3)
    corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
    curvature = np.zeros((3, 3))
    for i in range(3):
        for j in range(i + 1):
            change = sum(
                a * b * _unlikely(sums, state, at + a * axes[i] + b * axes[j]) for a, b in corners
            )
            curvature[i, j] = curvature[j, i] = change / (4.0 * step**2)
    spread, directions = np.linalg.eigh(curvature)
    # A level that nothing tells is known within a factor of e.
    sizes = np.sqrt(1.0 / np.maximum(spread, 1.0))
    points = np.sqrt(3.0) * np.concatenate([(directions * sizes).T, -(directions * sizes).T])
    covariance = np.zeros((state.unknowns, state.unknowns))
    for point in points:
        weighed = WeighedSums.of(sums, Levels.of(at + point)).with_priors(state)
        shift = weighed.inverse @ weighed.pull
        covariance += (weighed.inverse + np.outer(shift, shift)) / len(points)
    return covariance


def _weighed(rows: DepthRows, state: State, inliers: BoolArray, levels: Levels) -> State:
    """Gauss and Newton with weights by these levels of noise."""
    sums = WeighedSums.of(rows.sums(state).take(inliers), levels).with_priors(state)
    for _ in range(15):
        step = _short(-sums.inverse @ sums.pull)
        for _ in range(6):
            tried = state.moved(step)
            after = WeighedSums.of(rows.sums(tried).take(inliers), levels)
            after = after.with_priors(tried)
            if after.cost <= sums.cost:
                break
            step = 0.4 * step
        else:
            break
        gain = sums.cost - after.cost
        state, sums = tried, after
        if gain < 1e-9 * max(after.cost, 1e-300):
            break
    return state


def _unlikely(sums: PictureSums, state: State, logarithms: FloatArray) -> float:
    """Negative logarithm of the likelihood of levels."""
    weighed = WeighedSums.of(sums, Levels.of(logarithms)).with_priors(state)
    # What is stated of the camera holds within a factor of e, unless the pictures say more.
    return weighed.unlikely + 0.5 * float(logarithms[0]) ** 2


def _learnt(sums: PictureSums, start: Levels, state: State) -> Levels:
    """The levels that make the numbers most probable."""
    least, most = np.log(_LEAST), np.log(_MOST)
    begin = np.clip(np.log(start.array), least, most)
    found = minimize(
        lambda logarithms: _unlikely(sums, state, logarithms),
        begin,
        method="Nelder-Mead",
        bounds=[*zip(least, most, strict=True)],
        options={
            "xatol": 0.01,
            "fatol": 1e-3,
            "initial_simplex": begin + np.vstack([np.zeros(3), 0.7 * np.eye(3)]),
        },
    )
    return Levels.of(found.x)
