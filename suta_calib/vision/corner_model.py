"""Corners to a hundredth of a pixel, by a model of the picture around them.

Two blurred edges ``e = erf(n·d/σ)`` cross at a corner. Where two black and two white squares meet
(a saddle) the picture is ``a + b·e₁·e₂``; around the corner of a single square it is
``a + b·(e₁ + e₂ + e₁·e₂)``. Fitting that by least squares is unbiased under perspective, where the
gradient method of ``cornerSubPix`` errs by some hundredths of a pixel, and it tells along with the
place how certain that is, how blurred the picture is, and whether there is a corner at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from suta_calib.arrays import BoolArray, FloatArray

# Unknowns of a corner: u, v, the directions of both edges, their blur, grey between, contrast.
_UNKNOWNS: Final = 7
_ROUNDS: Final = 12
_SETTLED: Final = 1e-3  # px
# A pixel integrates over its square, so that no edge is sharper than this, px.
_SHARPEST: Final = 0.25
# Share of the variance around a corner that the model must explain: a sharp one has over 0.95.
_LEAST_SCORE: Final = 0.7
# What there must be between the lighter dark and the darker light square, of what the model has
# between dark and light. At the rim of a board, where a single square has its corner, nothing is.
_LEAST_PARTED: Final = 0.4


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
        parted: (n,) step from the lighter of the dark squares to the darker of the light ones, in
            steps of the model.
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
        corner = (self.score >= _LEAST_SCORE) & (self.parted >= _LEAST_PARTED)
        return np.asarray(corner & (moved <= reach))


def fit_corners(
    grey: NDArray[Any], start: FloatArray, radius: int, edges: FloatArray | None = None
) -> FittedCorners:
    """Fit the model around every place.

    Args:
        grey: (height, width) picture.
        start: (n, 2) places u, v to begin from, px.
        radius: of the disc of pixels that is fitted, px; less than half the way to the next corner.
        edges: (n, 2) directions of the two edges of a single dark square, rad, which lies on the
            side towards which u turns to v; saddles without.
    """
    offset, patch, weight = _patches(grey, start, radius)
    values = _start(start - np.round(start), offset, patch, weight)
    single = 0.0
    if edges is not None:
        single, values[:, 2:4] = 1.0, edges
        values[:, 6] *= -0.5
    damping = np.full(len(start), 1e-3)
    cost, J, r = _evaluated(values, offset, patch, weight, single)
    for _ in range(_ROUNDS):
        H = np.einsum("npi,npj->nij", J, J)
        g = np.einsum("npi,np->ni", J, r)
        scale = np.einsum("nii->ni", H) + 1e-9
        damped = H + np.eye(_UNKNOWNS) * (damping[:, None] * scale)[:, None, :]
        trial = values - np.linalg.solve(damped, g[..., None])[..., 0]
        trial[:, 4] = np.clip(trial[:, 4], _SHARPEST, radius)
        trial[:, :2] = np.clip(trial[:, :2], -radius, radius)
        tried = _evaluated(trial, offset, patch, weight, single)
        better = tried[0] <= cost
        step = np.abs(trial[:, :2] - values[:, :2]).max(axis=1, initial=0.0)
        values = np.where(better[:, None], trial, values)
        cost, J, r = (
            np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)
            for new, old in zip(tried, (cost, J, r), strict=True)
        )
        damping = np.where(better, damping * 0.1, damping * 10.0)
        if np.all(step[better] < _SETTLED) and better.any():
            break
    H = np.einsum("npi,npj->nij", J, J)
    count = np.count_nonzero(weight, axis=1)
    variance = cost / np.maximum(count - _UNKNOWNS, 1)
    inverse = np.linalg.pinv(H, hermitian=True)
    std = np.sqrt(variance * np.maximum(inverse[:, 0, 0], inverse[:, 1, 1]))
    mean = np.sum(weight * patch, axis=1) / np.maximum(count, 1)
    whole = np.sum(weight * (patch - mean[:, None]) ** 2, axis=1)
    return FittedCorners(
        np.round(start) + values[:, :2],
        std,
        values[:, 4],
        values[:, 6],
        np.where(whole > 0, 1.0 - cost / np.maximum(whole, 1e-9), 0.0),
        _parted(values, offset, patch, weight),
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


def _evaluated(
    values: FloatArray, offset: FloatArray, patch: FloatArray, weight: FloatArray, single: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cost (n,), Jacobian (n, p, 7) and residual (n, p) of the model."""
    blur, grey, contrast = (column[:, None] for column in values[:, 4:].T)
    edges = []
    for angle in (2, 3):
        across, along, sine, cosine = _edge(values, angle, offset)
        t = across / (np.sqrt(2.0) * blur)
        slope = np.sqrt(2.0 / np.pi) / blur * np.exp(-t * t)
        edges.append((erf(t), slope, across, along, sine, cosine))
    (e1, s1, x1, a1, sin1, cos1), (e2, s2, x2, a2, sin2, cos2) = edges
    shape = e1 * e2 + single * (e1 + e2)
    model = grey + contrast * shape
    # Slopes of the shape across either edge.
    s1, s2 = s1 * (e2 + single), s2 * (e1 + single)
    columns = (
        contrast * (s1 * sin1 + s2 * sin2),
        -contrast * (s1 * cos1 + s2 * cos2),
        -contrast * s1 * a1,
        -contrast * s2 * a2,
        -contrast * (s1 * x1 + s2 * x2) / blur,
        np.ones_like(model),
        shape,
    )
    J = np.stack([weight * column for column in columns], axis=-1)
    r = weight * (model - patch)
    return (r * r).sum(axis=1), J, r


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
    """`FittedCorners.parted`; pixels count the more the farther from the edges they are."""
    first, second = (_edge(values, angle, offset)[0] for angle in (2, 3))
    far = weight * np.minimum(np.abs(first), np.abs(second))
    means = []
    for a, b in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
        share = far * ((first * a > 0) & (second * b > 0))
        whole = share.sum(axis=1)
        mean = (share * patch).sum(axis=1) / np.maximum(whole, 1e-9)
        means.append(np.where(whole > 0, mean, values[:, 5]))
    light, dark = np.minimum(*means[:2]), np.maximum(*means[2:])
    return np.asarray((light - dark) / np.maximum(2.0 * values[:, 6], 1e-9))
