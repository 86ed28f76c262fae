"""Corners to a hundredth of a pixel, by a model of the picture around them.

Two edges cross at a corner, and a lens blurs them as a normal distribution would: what is 1 on one
side of an edge and -1 on the other, s₁ and s₂, becomes its mean E over what a pixel gathers. Where
two black and two white squares meet (a saddle) the picture is ``a + b·E[s₁ s₂]``; around the corner
of a single square it is ``a + b·E[s₁ + s₂ + s₁ s₂]``. Edges that are not square to each other are
correlated: blur rounds a sharp corner more than a blunt one, and who takes ``E[s₁] E[s₂]`` for both
finds a marker that is seen aslant some tenths of a pixel off. Fitting that by least squares is
unbiased under perspective, where the gradient method of ``cornerSubPix`` errs by some hundredths of
a pixel, and it tells along with the place how certain that is, how blurred the picture is, and
whether there is a corner at all.

A hand that moves while a picture is taken blurs it along one direction, which is asked of all its
corners together. Who takes one blur for every edge finds the corners of markers some tenths of a
pixel off, and saddles two to five times less surely than they are known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from suta_calib.arrays import BoolArray, FloatArray

# Unknowns of a corner: u, v, the directions of both edges, their blur, grey between, contrast.
_UNKNOWNS: Final = 7
_ROOT_HALF: Final = np.sqrt(0.5)
# Places and weights of Gauss and Legendre's integral from -1 to 1: errs by less than a thousandth.
_NODES: Final = np.polynomial.legendre.leggauss(6)
# Share of the variance around a corner that the model must explain: a sharp one has over 0.95.
_LEAST_SCORE: Final = 0.7


@dataclass(frozen=True, eq=False)
class FittedCorners:
    """Corners as they were found.

    Attributes:
        pixel: (n, 2) places, px.
        std: (n,) standard deviation of either coordinate by the picture's noise, px.
        blur: (n,) standard deviation of the blur of the edges, px.
        contrast: (n,) half the difference of white and black at a saddle; a quarter of it, with
            its sign, at a single square's corner; grey levels.
        score: (n,) share of the variance around each that such a corner explains.
        parted: (n,) step from the lighter of the dark squares to the darker of the light ones, as
            part of the model's.
    """

    pixel: FloatArray
    std: FloatArray
    blur: FloatArray
    contrast: FloatArray
    score: FloatArray
    parted: FloatArray

    def plausible(self, start: FloatArray, reach: FloatArray | float) -> BoolArray:
        """(n,) which are corners within ``reach`` px of where they were looked for."""
        moved = np.linalg.norm(self.pixel - start, axis=1)
        # What there must be between the lighter dark and the darker light square, of what the model
        # has there. At the rim of a board, where a single square has its corner, nothing is.
        corner = (self.score >= _LEAST_SCORE) & (self.parted >= 0.4)
        return np.asarray(corner & (moved <= reach))


def fit_corners(
    grey: NDArray[Any], start: FloatArray, radius: int, edges: FloatArray | None = None
) -> FittedCorners:
    """Fit the model around every place (n, 2), px, in a picture (height, width).

    Args:
        grey: the picture.
        start: places u, v to begin from.
        radius: of the disc of pixels that is fitted, px; less than half the way to the next corner.
        edges: (n, 2) directions of the two edges of a single dark square, rad, which lies on the
            side towards which u turns to v; saddles without.
    """
    return fitted(grey, start, radius, edges).corners(np.round(start))


def fitted(
    grey: NDArray[Any], start: FloatArray, radius: int, edges: FloatArray | None = None
) -> CornerFit:
    """The model around every place, and the shape of the blur: what `fit_corners` answers by."""
    offset, patch, weight = _patches(grey, start, radius)
    values = _start(start - np.round(start), offset, patch, weight)
    single = 0.0
    if edges is not None:
        single, values[:, 2:4] = 1.0, edges
        values[:, 6] *= -0.5
    fit = CornerFit(np.eye(2), values, offset, patch, weight, single).settled(radius)
    for _ in range(5):
        step = fit.blurred_along()
        if not step.any():
            break
        fit = fit.warped(step).settled(radius)
    return fit


@dataclass(frozen=True, eq=False)
class CornerFit:
    """Corners of one picture, in coordinates in which its blur is the same in every direction.

    A hand that moves while the picture is taken blurs it along one direction: the blur's
    covariance is ``b² L Lᵀ`` with one L for the picture, and with ``u = L w`` it is ``b²`` in w.

    Attributes:
        shape: (2, 2) L, symmetric, of determinant 1.
        values: (n, 7) unknowns, places and directions in w.
        offset: (p, 2) of a disc's pixels, px.
        patch: (n, p) their greys.
        weight: (n, p) 0 where there is no pixel.
        single: 1 for corners of single squares, 0 for saddles.
    """

    shape: FloatArray
    values: FloatArray
    offset: FloatArray
    patch: FloatArray
    weight: FloatArray
    single: float

    @cached_property
    def evaluated(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Cost (n,), Jacobian (n, p, 7) and residual (n, p)."""
        return self._at(self.values)

    def _at(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        straight = self.offset @ np.linalg.inv(self.shape).T
        return evaluated(values, straight, self.patch, self.weight, self.single)

    def settled(self, radius: int) -> CornerFit:
        """By steps of Levenberg and Marquardt, for each corner its own."""
        values, (cost, J, r) = self.values, self.evaluated
        damping = np.full(len(values), 1e-3)
        for _ in range(12):
            H = np.einsum("npi,npj->nij", J, J)
            g = np.einsum("npi,np->ni", J, r)
            scale = np.einsum("nii->ni", H) + 1e-9
            damped = H + np.eye(_UNKNOWNS) * (damping[:, None] * scale)[:, None, :]
            trial = values - np.linalg.solve(damped, g[..., None])[..., 0]
            # A pixel integrates over its square, so that no edge is sharper than this, px.
            trial[:, 4] = np.clip(trial[:, 4], 0.25, radius)
            trial[:, :2] = np.clip(trial[:, :2], -radius, radius)
            tried = self._at(trial)
            better = tried[0] <= cost
            step = np.abs(trial[:, :2] - values[:, :2]).max(axis=1, initial=0.0)
            values = np.where(better[:, None], trial, values)
            cost, J, r = (
                np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)
                for new, old in zip(tried, (cost, J, r), strict=True)
            )
            damping = np.where(better, damping * 0.1, damping * 10.0)
            if np.all(step[better] < 1e-3) and better.any():
                break
        settled = replace(self, values=values)
        vars(settled)["evaluated"] = cost, J, r
        return settled

    def warped(self, stretch: FloatArray) -> CornerFit:
        """The same with the blur stretched by exp of a symmetric matrix: upper row, trace 0."""
        a, b = stretch
        size = max(float(np.hypot(a, b)), 1e-300)
        upper = np.array([[a, b], [b, -a]]) / size
        shape = (np.cosh(size) * np.eye(2) + np.sinh(size) * upper) @ self.shape
        # Symmetric again: a blur is the same whichever way it is turned before.
        u, singular, _ = np.linalg.svd(shape)
        shape = (u * singular) @ u.T
        to = np.linalg.inv(shape) @ self.shape
        values = self.values.copy()
        values[:, :2] = values[:, :2] @ to.T
        for k in (2, 3):
            along = np.stack([np.cos(values[:, k]), np.sin(values[:, k])], axis=1) @ to.T
            values[:, k] = np.arctan2(along[:, 1], along[:, 0])
        return replace(self, shape=shape, values=values)

    def blurred_along(self) -> FloatArray:
        """(2,) by which the picture's blur is longer in one direction; zeros where by chance.

        A step of Gauss and Newton in what all corners have in common, each with all its own
        unknowns following, and a score test of it that lets many corners err as they like.
        """
        # Step of the differences by it.
        stretch = 1e-5
        _, J, r = self.evaluated
        variance = self._variance
        corner = self.explained >= _LEAST_SCORE
        if corner.sum() < 3:
            return np.zeros(2)
        columns = [(self.warped(by).evaluated[2] - r) / stretch for by in stretch * np.eye(2)]
        Z = np.stack(columns, axis=-1)
        inner = np.linalg.pinv(np.einsum("npi,npj->nij", J, J), hermitian=True)
        Z = Z - np.einsum("npi,nij->npj", J, inner) @ (np.swapaxes(J, 1, 2) @ Z)
        precision = np.where(corner, 1.0 / np.maximum(variance, 1e-9), 0.0)
        scores = precision[:, None] * np.einsum("npk,np->nk", Z, r)
        curvature = np.einsum("n,npk,npl->kl", precision, Z, Z)
        total = scores.sum(axis=0)
        deviations = scores[corner] - scores[corner].mean(axis=0)
        # Fewer corners do not tell themselves how much they scatter: the pixels have to say it.
        scatter = deviations.T @ deviations if corner.sum() >= 8 else curvature
        squared = float(total @ np.linalg.pinv(scatter, hermitian=True) @ total)
        step = -np.linalg.pinv(curvature, hermitian=True) @ total
        size = float(np.linalg.norm(step))
        # One in 10⁴ by chance (chi-squared with two degrees of freedom), and as much as matters to
        # a corner; and not farther at once, in logarithms of its length.
        if squared < 18.4 or size < 0.01:
            return np.zeros(2)
        return np.asarray(step * min(1.0, 0.5 / size))

    @property
    def _variance(self) -> FloatArray:
        """(n,) of a pixel about the model."""
        count = np.count_nonzero(self.weight, axis=1)
        return np.asarray(self.evaluated[0] / np.maximum(count - _UNKNOWNS, 1))

    @property
    def explained(self) -> FloatArray:
        """(n,) share of the variance around each."""
        count = np.count_nonzero(self.weight, axis=1)
        mean = np.sum(self.weight * self.patch, axis=1) / np.maximum(count, 1)
        total = np.sum(self.weight * (self.patch - mean[:, None]) ** 2, axis=1)
        return np.where(total > 0, 1.0 - self.evaluated[0] / np.maximum(total, 1e-9), 0.0)

    def corners(self, middle: FloatArray) -> FittedCorners:
        """What is found, about the middles (n, 2) of the discs, px."""
        _, J, r = self.evaluated
        L = self.shape
        inverse = np.linalg.pinv(np.einsum("npi,npj->nij", J, J), hermitian=True)[:, :2, :2]
        diagonal = np.einsum("ai,nij,aj->na", L, inverse, L)
        straight = self.offset @ np.linalg.inv(L).T
        there = _parted(self.values, straight, self.patch, self.weight)
        expected = _parted(self.values, straight, self.patch + r, self.weight)
        # Such a step that is none, grey levels.
        least_step = 0.1
        return FittedCorners(
            middle + self.values[:, :2] @ L.T,
            np.sqrt(self._variance * diagonal.max(axis=1)),
            self.values[:, 4],
            self.values[:, 6],
            self.explained,
            there / np.maximum(expected, least_step),
        )


def _patches(
    grey: NDArray[Any], start: FloatArray, radius: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Offsets (p, 2) of a disc's pixels, their greys (n, p), and 0 where there is no pixel."""
    span = np.arange(-radius, radius + 1)
    offset = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    offset = offset[np.hypot(*offset.T) <= radius + 0.5]
    at = np.round(start).astype(np.intp)[:, None] + offset
    height, width = grey.shape
    inside = np.all((at >= 0) & (at < [width, height]), axis=2)
    at = np.clip(at, 0, [width - 1, height - 1])
    return offset.astype(float), grey[at[..., 1], at[..., 0]].astype(float), inside.astype(float)


def _start(
    place: FloatArray, offset: FloatArray, patch: FloatArray, weight: FloatArray
) -> FloatArray:
    """Unknowns to begin from: edges across each other where the picture's second harmonic is."""
    d = offset - place[:, None]
    angle = 2.0 * np.arctan2(d[..., 1], d[..., 0])
    count = np.maximum(weight.sum(axis=1), 1.0)
    mean = (weight * patch).sum(axis=1) / count
    centred = weight * (patch - mean[:, None])
    cosine, sine = (centred * np.cos(angle)).sum(axis=1), (centred * np.sin(angle)).sum(axis=1)
    first = np.arctan2(cosine, -sine) / 2.0
    contrast = np.sqrt((centred**2).sum(axis=1) / count)
    blur = np.ones(len(place))
    return np.column_stack([place, first, first + np.pi / 2, blur, mean, contrast])


def evaluated(
    values: FloatArray, offset: FloatArray, patch: FloatArray, weight: FloatArray, single: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cost (n,), Jacobian (n, p, 7) and residual (n, p) of the model."""
    blur, grey, contrast = (column[:, None] for column in values[:, 4:].T)
    (x1, a1, sin1, cos1), (x2, a2, sin2, cos2) = (_edge(values, k, offset) for k in (2, 3))
    t1, t2 = x1 / blur, x2 / blur
    between = values[:, 2:3] - values[:, 3:4]
    # No edges are nearer to each other than this.
    rho = np.clip(np.cos(between), -0.99, 0.99)
    both, density, beyond1, beyond2, sides = crossed(t1, t2, rho)
    shape = both + single * sides
    model = grey + contrast * shape
    # Slopes of the shape across either edge, and by the angle between them.
    s1, s2 = (
        2.0 * _ROOT_HALF / np.sqrt(np.pi) / blur * np.exp(-0.5 * t * t) * (beyond + single)
        for t, beyond in ((t1, beyond1), (t2, beyond2))
    )
    opened = 4.0 * density * np.sin(between)
    columns = (
        contrast * (s1 * sin1 + s2 * sin2),
        -contrast * (s1 * cos1 + s2 * cos2),
        -contrast * (s1 * a1 + opened),
        -contrast * (s2 * a2 - opened),
        -contrast * (s1 * x1 + s2 * x2) / blur,
        np.ones_like(model),
        shape,
    )
    J = np.stack([weight * column for column in columns], axis=-1)
    r = weight * (model - patch)
    return (r * r).sum(axis=1), J, r


def crossed(
    t1: FloatArray, t2: FloatArray, rho: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Product of the signs of two edges, blurred: the mean of what a bivariate normal meets.

    By Plackett's integral over the correlation (1954, doi:10.1093/biomet/41.3-4.351).

    Args:
        t1: (n, p) distances from the first edge, in standard deviations of the blur.
        t2: from the second one.
        rho: (n, 1) cosine of the angle between the edges' normals.

    Returns:
        (n, p) each: the product; the normal density; for either edge the mean sign of the other
        one along it, so that ``2 φ(t)`` times it is the slope across; and the sum of both signs.
    """
    end = np.arcsin(rho)
    squares, product = t1 * t1 + t2 * t2, t1 * t2
    integral = np.zeros_like(product)
    for node, share in zip(*_NODES, strict=True):
        angle = 0.5 * end * (1.0 + node)
        integral += share * np.exp((product * np.sin(angle) - 0.5 * squares) / np.cos(angle) ** 2)
    e1, e2 = erf(t1 * _ROOT_HALF), erf(t2 * _ROOT_HALF)
    both = e1 * e2 + end / np.pi * integral
    left = 1.0 - rho * rho
    density = np.exp((rho * product - 0.5 * squares) / left) / (2.0 * np.pi * np.sqrt(left))
    scale = np.sqrt(0.5 / left)
    beyond1, beyond2 = erf((t2 - rho * t1) * scale), erf((t1 - rho * t2) * scale)
    return both, density, beyond1, beyond2, e1 + e2


def _edge(
    values: FloatArray, angle: int, offset: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Distances of pixels (n, p) from an edge and along it; sine and cosine of its direction."""
    du, dv = offset[:, 0] - values[:, :1], offset[:, 1] - values[:, 1:2]
    direction = values[:, angle, None]
    sine, cosine = np.sin(direction), np.cos(direction)
    return dv * cosine - du * sine, dv * sine + du * cosine, sine, cosine


def _parted(
    values: FloatArray, offset: FloatArray, patch: FloatArray, weight: FloatArray
) -> FloatArray:
    """(n,) greys from the lighter of the dark squares to the darker of the light ones.

    Pixels count the more the farther from the edges they are.
    """
    first, second = (_edge(values, angle, offset)[0] for angle in (2, 3))
    far = weight * np.minimum(np.abs(first), np.abs(second))
    means = []
    for a, b in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
        share = far * ((first * a > 0) & (second * b > 0))
        sum_of_shares = share.sum(axis=1)
        mean = (share * patch).sum(axis=1) / np.maximum(sum_of_shares, 1e-9)
        means.append(np.where(sum_of_shares > 0, mean, values[:, 5]))
    light, dark = np.minimum(*means[:2]), np.maximum(*means[2:])
    return np.asarray(light - dark)
