"""Effect of errors that many rows share on an estimate: errors of an artefact and of a scale.

An error in a certified coordinate is the same in every touch of that landmark. It does not average
out over placements, and the scatter of the residuals shows only a part of it. With the landmarks'
coordinates l, certified with Σ = diag(σ²), the implicit function theorem gives at the solution

    dx/dl = -A⁻¹ (∂r/∂x)ᵀ Ψ (∂r/∂l)            Cov += (dx/dl) Σ (dx/dl)ᵀ

with A and Ψ the curvature of the robust cost as in `solver.covariance`. A common factor 1 + s on
all lengths of an artefact, a board or an instrument (`terms.length_scale`) is one more such
coordinate, the derivative by which is found by making them longer. The scatter must then be
read from residuals without the artefact's part, or what they show of it would count twice:
`without_shared_errors` fits the landmarks, with Σ as a prior, beside the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.fitted import Fitted
from suta_calib.solver.information import Rows, robust_product, scaled_inverse
from suta_calib.solver.problem import Problem
from suta_calib.terms.length_scale import lengthened, scale_carrier, scale_carriers
from suta_calib.terms.term import Term

# Share of the residuals' freedom that is left, whatever the landmarks take of it.
LEAST_FREEDOM: Final = 0.1


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Derivatives of whitened rows by certified coordinates, or by scales.

    Attributes:
        keys: landmarks, as in `terms.block.Certified`, with three coordinates each; or what carries
            a scale, and its name.
        sigma: (c,) standard deviations of the coordinates, m, or of the scales.
        jacobian: for each block (n·d, c), whitened as the rows are.
    """

    keys: tuple[tuple[object, ...], ...]
    sigma: FloatArray
    jacobian: tuple[FloatArray, ...]


def artefact_errors(rows: Sequence[Rows]) -> SharedErrors | None:
    """The artefact's part in the rows; None where nothing certified has an uncertainty."""
    # One artefact in two terms counts once.
    sigma = {
        key: float(stated)
        for certified in (r.line.view.block.certified for r in rows)
        if certified is not None
        for key, stated in zip(certified.keys, certified.sigma, strict=True)
        if stated > 0
    }
    if not sigma:
        return None
    index = {key: k for k, key in enumerate(sigma)}
    jacobian = tuple(_by_coordinates(r, index) for r in rows)
    return SharedErrors(tuple(sigma), np.repeat(list(sigma.values()), 3), jacobian)


def scale_errors(fit: Fitted, rows: Sequence[Rows]) -> SharedErrors | None:
    """The part of the scales in the rows, also of exact ones; None where there are none."""
    # Step of the derivative by a scale, relative.
    step, problem = 1e-6, fit.problem
    carriers = scale_carriers(problem.terms)
    if not carriers:
        return None
    columns, of_term = [], [scale_carrier(term) for term in problem.terms]
    for carrier in carriers:
        key = carrier.what, carrier.name
        longer = [
            lengthened(term, 1.0 + step) if mine and (mine.what, mine.name) == key else term
            for term, mine in zip(problem.terms, of_term, strict=True)
        ]
        after = Problem(longer, problem.arm_parameters).linearise(fit.x, fit.sigmas)
        columns.append(
            [
                ((line.residual - r.line.residual) / step / r.line.sigma[:, None]).reshape(-1)
                for line, r in zip(after, rows, strict=True)
            ]
        )
    jacobian = tuple(np.column_stack(block) for block in zip(*columns, strict=True))
    keys = tuple((carrier.what, carrier.name) for carrier in carriers)
    return SharedErrors(keys, np.array([c.std for c in carriers]), jacobian)


def joined_errors(*parts: SharedErrors | None) -> SharedErrors | None:
    """Several parts as one, without what counts as exact; None where that is all."""
    given = [part for part in parts if part is not None and part.sigma.any()]
    if not given:
        return None
    sigma = np.concatenate([part.sigma for part in given])
    blocks = zip(*(part.jacobian for part in given), strict=True)
    return SharedErrors(
        tuple(key for part in given for key in part.keys),
        sigma[sigma > 0],
        tuple(np.hstack(block)[:, sigma > 0] for block in blocks),
    )


def _by_coordinates(rows: Rows, index: dict[tuple[object, ...], int]) -> FloatArray:
    n, size = rows.line.residual.shape
    whitened = np.zeros((n, size, len(index), 3))
    certified = rows.line.view.block.certified
    if certified is not None:
        # Landmarks without uncertainty go to a column that is cut off below.
        column = np.array([index.get(key, len(index)) for key in certified.keys])
        wide = np.zeros((n, size, len(index) + 1, 3))
        scaled = certified.derivative / rows.line.sigma[:, None, None, None]
        for k in range(certified.marks.shape[1]):
            # No row looks twice at one landmark.
            wide[np.arange(n), :, column[certified.marks[:, k]]] += scaled[:, :, k]
        whitened = wide[:, :, :-1]
    return whitened.reshape(n * size, -1)


def shifts(rows: Sequence[Rows], part: SharedErrors, bread: FloatArray) -> FloatArray:
    """(n, c) derivative dx/dl of an estimate, from whitened rows there and A⁻¹ (n, n)."""
    cross = sum(robust_product(r, d) for r, d in zip(rows, part.jacobian, strict=True))
    return np.asarray(-bread @ cross)


def without_shared_errors(
    fit: Fitted, rows: Sequence[Rows], part: SharedErrors, touches: Sequence[IntArray]
) -> tuple[list[Rows], FloatArray]:
    """Rows with the residuals that a better artefact would have left, free of what it takes.

    And by how much each coordinate or scale may be off, (c,): the root mean square of its posterior
    about what the answer took it for. It is what is stated where the rows do not tell better.

    The landmarks are fitted to all rows beside the free parameters, each with its certified
    coordinates as a prior, and the residuals enlarged for the freedom they lose to that, which is
    a freedom among touches: a repeat sees the same landmark.
    """
    whites = [_white(r) for r in rows]
    shares = [
        float(np.einsum("ij,j->", d**2, part.sigma**2)) / max(float(np.sum(w**2)), 1e-300)
        for d, w in zip(part.jacobian, whites, strict=True)
    ]
    # Share of the residuals' variance below which what they show of the artefact may count twice:
    # half of it is what a standard deviation is wrong by.
    if max(shares) < 0.01:
        return list(rows), part.sigma
    counts = np.array([_equations(fit.problem.terms, r, touches) for r in rows])
    residuals, taken, off = _joint_fit(fit, rows, part, counts[:, 0])
    left = np.maximum(1.0 - taken / counts[:, 1], LEAST_FREEDOM)
    improved = []
    for r, white, share in zip(rows, residuals, left, strict=True):
        scale = r.line.sigma / np.sqrt(r.line.weight * share)
        residual = white.reshape(r.line.residual.shape) * scale[:, None]
        improved.append(replace(r, line=replace(r.line, residual=residual)))
    return improved, np.minimum(off, part.sigma)


def _joint_fit(
    fit: Fitted, rows: Sequence[Rows], part: SharedErrors, equations: FloatArray
) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """Residuals (n·d,) of each block beside fitted landmarks, and the freedom that these take.

    And (c,) how far the landmarks may be off from what they were taken for.

    A linear step of parameters and landmarks, weighed by the noise that it leaves.
    """
    free, precision = fit.free, fit.problem.prior_precision()
    pull = precision * (fit.x - fit.problem.parameters.array("nominal"))
    prior = np.concatenate([precision[free], part.sigma**-2.0])
    slope = np.concatenate([pull[free], np.zeros(len(part.sigma))])
    gains = [
        np.hstack([r.jacobian[:, free], d])
        * np.repeat(np.sqrt(r.line.weight), r.line.residual.shape[1])[:, None]
        for r, d in zip(rows, part.jacobian, strict=True)
    ]
    residuals = whites = [_white(r) for r in rows]
    off = part.sigma
    levels, taken = np.array([float(np.mean(w**2)) for w in whites]), np.zeros(len(rows))
    products = [(g.T @ g, g.T @ w) for g, w in zip(gains, whites, strict=True)]
    # The noise that weighs the landmarks' prior settles in so many rounds.
    for _ in range(4):
        # Rows that share samples say less than their number.
        trust = equations / [w.size for w in whites] / np.maximum(levels, 1e-300)
        squares = [t * square for t, (square, _) in zip(trust, products, strict=True)]
        inverse = scaled_inverse(np.asarray(sum(squares)) + np.diag(prior))
        weighed = (t * gradient for t, (_, gradient) in zip(trust, products, strict=True))
        step = -inverse @ (slope + sum(weighed))
        residuals = [w + g @ step for w, g in zip(whites, gains, strict=True)]
        share = np.array([np.einsum("ij,ji->i", inverse, square) for square in squares])
        left = np.maximum(1.0 - share.sum(axis=1) / equations, LEAST_FREEDOM)
        levels = np.array([float(np.mean(r**2)) for r in residuals]) / left
        taken = share[:, len(free) :].sum(axis=1)
        off = np.sqrt(np.diag(inverse)[len(free) :] + step[len(free) :] ** 2)
    return residuals, taken, off


def _white(rows: Rows) -> FloatArray:
    line = rows.line
    return np.asarray((line.residual * (np.sqrt(line.weight) / line.sigma)[:, None]).reshape(-1))


def _equations(
    terms: Sequence[Term], rows: Rows, touches: Sequence[IntArray]
) -> tuple[float, float]:
    """Independent numbers among a block's rows, and among its touches, whatever their repeats."""
    block = rows.line.view.block
    for term, touch in zip(terms, touches, strict=True):
        if any(block is b for b in term.blocks):
            numbers = sum(len(b) * b.size for b in term.blocks)
            equations = term.equations() * len(block) * block.size / numbers
            return equations, equations * (int(touch.max()) + 1) / (int(term.poses.rests.max()) + 1)
    raise ValueError("a row of no term")
