"""How much residuals and priors are worth against each other, learned from the data themselves.

What a job says of its noise and of how far geometry may be off is a guess, and against each other
the guesses decide how far geometry moves. With η the logarithms of a noise level σ per block and of
a factor f per group of priors, the evidence of the data is, by Laplace's approximation,

    -log p(data | η) = Σ_b t_b [½ Σ ‖r‖² / σ² + n d log σ]
                     + Σ_g [½ Σ ((x - nominal) / (f prior))² + n log f] + ½ log det H

at the x that is best for η, with H the curvature there (MacKay 1992, doi:10.1162/neco.1992.4.3.415;
for least squares it is the restricted likelihood of Patterson and Thompson 1971,
doi:10.1093/biomet/58.3.545, which counts what the unknowns have taken of the residuals). Rows that
share samples say less than their number: t_b is the share of them that is independent. A row beyond
Huber's threshold pulls at x as Huber lets it, and tells of σ only that it lies beyond. A threshold
that is given follows the noise down to where it is 95 % efficient (`huber_threshold`), unless the
noise is to stay: one of several σ lets what the model lacks pull as much as what it follows.

Groups of few parameters tell little of their factor, so that all are drawn to a common one
(`WeightOptions`). Residuals and Jacobian are evaluated once: the rest happens on matrices of the
parameters' size, with the rows' weights following the linear prediction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.distributions import chi2
from suta_calib.model.parameters import COMPLIANCE, EXPANSION, GAIN, OFFSET
from suta_calib.solver.information import Rows, whitened_rows
from suta_calib.solver.level_uncertainty import covariance_of_levels
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.problem import Problem
from suta_calib.terms.block import Block, grouped_rows, summed

# The group of what is known of a camera's intrinsics.
CAMERA: Final = "camera"
# Noise that is always there, m or rad per component: rounding is no information.
FINEST: Final = 1e-6
# Share of rows that may be blunders: beyond Huber's threshold they are then no surprise.
BLUNDERS: Final = 0.1
# Logarithmic standard deviation of what must stay.
FIXED: Final = 1e-6
# Standard deviations, and the factor, from where on what was given is contradicted.
SIGNIFICANT: Final = 3.0
WORTH_A_WORD: Final = 2.0
# Rows' weights, then noise and factors for them: so often at most, until they change by less.
ROUNDS: Final = 10
SETTLED: Final = 1e-3
NEWTON_STEPS: Final = 30
HALVINGS: Final = 8
# Curvature, relative to the largest, that rounding may have taken away.
ROUNDING: Final = 1e-12
# Longest step in a logarithm: the evidence is no parabola farther off.
LONGEST: Final = 1.0


@dataclass(frozen=True)
class WeightOptions:
    """What is believed of noise levels and priors beforehand: logarithmic standard deviations.

    Attributes:
        stated: of a noise level that the job states; a data sheet is right within a factor of two.
        assumed: of one that nobody stated.
        common: of the factor common to all priors; a guess is right within one of ten.
        between: of a group's factor about the common one: whoever guesses one size too small is
            likely to guess the others so. Free factors would let groups of few parameters run away.
        camera: of the factor on what is known of a camera: what its calibration says of itself, or
            what calibrations usually are, is right within one of three.
    """

    stated: float = math.log(2.0)
    assumed: float = math.log(10.0)
    common: float = math.log(10.0)
    between: float = 0.2
    camera: float = math.log(3.0)


@dataclass(frozen=True)
class Learned:
    """A noise level, or a factor on the priors of a group.

    Attributes:
        value: m or rad per component; of a factor, a number.
        log_std: standard deviation of its logarithm; zero where it was to stay as given.
        given: what the job says; None where it says nothing.
    """

    value: float
    log_std: float
    given: float | None

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict what was given: surely, and by a factor worth a word."""
        if self.given is None or not self.log_std:
            return False
        off = abs(math.log(self.value / self.given))
        return off > max(SIGNIFICANT * self.log_std, math.log(WORTH_A_WORD))

    @property
    def interval(self) -> tuple[float, float]:
        """Where the value is with a chance of 95 %."""
        spread = math.exp(1.96 * self.log_std)
        return self.value / spread, self.value * spread


@dataclass(frozen=True, eq=False)
class Weights:
    """Noise levels and prior factors, with how well the data tell them.

    Attributes:
        noise: of each block.
        priors: factor on the standard deviations of each group's priors.
        sigmas: levels to minimise with: larger than the noise where a block's rows share samples.
        thresholds: Huber's of each block to minimise with, m or rad; inf for least squares.
        prior_scale: (n,) factor of every parameter's prior; one where it was not learned.
        covariance: (n, n) of the estimate, what not knowing the weights better adds to it (Kass and
            Steffey 1989, doi:10.1080/01621459.1989.10478825).
    """

    noise: tuple[Learned, ...]
    priors: dict[str, Learned]
    sigmas: tuple[float, ...]
    thresholds: tuple[float, ...]
    prior_scale: FloatArray
    covariance: FloatArray

    def applied_to(self, problem: Problem) -> Problem:
        """The problem, over the same unknowns, with these priors and thresholds.

        Noise levels belong to no problem: beside it go `sigmas`.
        """
        return problem.with_priors_scaled(self.prior_scale).with_thresholds(self.thresholds)


def prior_groups(problem: Problem) -> list[str | None]:
    """Whose size is guessed together with that of a parameter's prior, for each of the problem.

    None where there is no prior, and where it was to stay. The terms' own unknowns that have one
    are a camera's.
    """
    groups: list[str | None] = []
    for p in problem.arm_parameters.values():
        if p.prior is None or p.prior_fixed:
            groups.append(None)
        elif problem.arm is not None and p.owner == problem.arm.tip:
            groups.append("tip")
        elif not p.geometric:
            kinds = {GAIN: "gains", COMPLIANCE: "compliances", EXPANSION: "expansions"}
            kind = kinds.get(p.key, "eccentricities")
            groups.append("couplings" if p.coupling else kind)
        elif p.key == OFFSET:
            groups.append("offsets")
        else:
            groups.append("lengths" if p.unit == "m" else "angles")
    own = list(problem.parameters.values())[problem.arm_count :]
    return groups + [None if p.prior is None or p.prior_fixed else CAMERA for p in own]


def learn_weights(
    problem: Problem,
    x: FloatArray,
    sigmas: Sequence[float],
    free: IntArray,
    options: WeightOptions = WeightOptions(),
) -> Weights:
    """Noise levels and factors on priors for which the data are the least surprising.

    Args:
        problem: terms and parameters, priors as given.
        x: (n,) minimum for the weights so far.
        sigmas: noise of each block that it is the minimum for, m or rad per component.
        free: indices that were estimated.
        options: how far the weights may be from what was given.
    """
    blocks, rows = problem.blocks, whitened_rows(problem, x, sigmas)
    of_parameter = prior_groups(problem)
    names = [of_parameter[k] for k in free]
    groups = tuple(dict.fromkeys(name for name in names if name is not None))
    members = [np.array([name == group for name in names]) for group in groups]
    precision = problem.prior_precision()[free]
    away = (x - problem.parameters.array("nominal"))[free]
    stays = _of_prior(precision * [name is None for name in names], away)
    trust = _independent_shares(problem, rows)
    known = [float(np.mean(block.known_sigma**2)) for block in blocks]
    given = np.concatenate([problem.assumed_sigmas(), np.ones(len(groups))])
    noise, factors = slice(0, len(blocks)), slice(len(blocks), None)
    before = [
        FIXED if b.noise.fixed else options.assumed if b.noise.sigma is None else options.stated
        for b in blocks
    ]
    covariance = np.diag(np.square([*before, *[options.between] * len(groups)]))
    # Who guesses an arm's errors too small need not be the one who calibrated the camera.
    camera = np.array([group == CAMERA for group in groups], dtype=np.bool_)
    covariance[factors, factors] += np.where(
        np.outer(camera, camera), options.camera**2, options.common**2
    ) * (camera[:, None] == camera)
    belief = np.linalg.inv(covariance)
    eta, step = np.log(given), np.zeros(len(free))
    for _ in range(ROUNDS):
        energies, counts, beyond, held = [], [], [], [stays]
        for block, r, t, k, log_sigma in zip(blocks, rows, trust, known, eta[noise], strict=True):
            inside, outside, count = _of_rows(r, free, step, t, math.exp(log_sigma))
            energies.append(inside)
            held.append(outside)
            counts.append(t * count * block.size)
            spread = math.sqrt(math.exp(2.0 * log_sigma) + k)
            beyond.append((t * (len(block) - count), block.size, _threshold(block, spread)))
        for mine, log_factor in zip(members, eta[factors], strict=True):
            energies.append(_of_prior(precision * mine * math.exp(-2.0 * log_factor), away))
            counts.append(float(mine.sum()))
        evidence = _Evidence(energies, held, np.array(counts), beyond, np.log(given) - eta, belief)
        best, hessian = _minimise(evidence)
        eta, step = eta + best.eta, best.step
        if np.max(np.abs(best.eta)) < SETTLED:
            break
    data = _told_by_data(hessian, belief)
    uncertainty = np.asarray(np.linalg.inv(data + belief), dtype=np.float64)
    values, stds = np.exp(eta), np.sqrt(np.diag(uncertainty))
    scale, added = np.ones(len(x)), np.zeros((len(x),) * 2)
    for mine, factor in zip(members, values[factors], strict=True):
        scale[free[mine]] = factor
    # How far the weights scatter from data to data: what nothing was learned of is as given.
    told = uncertainty @ data @ uncertainty
    added[np.ix_(free, free)] = covariance_of_levels(evidence.at, best.eta, told)
    return Weights(
        tuple(
            Learned(float(v), 0.0 if b.noise.fixed else float(std), b.noise.sigma)
            for b, v, std in zip(blocks, values[noise], stds[noise], strict=True)
        ),
        {
            group: Learned(float(v), float(std), 1.0)
            for group, v, std in zip(groups, values[factors], stds[factors], strict=True)
        },
        tuple(
            math.sqrt((v**2 + k) / t - k)
            for v, k, t in zip(values[noise], known, trust, strict=True)
        ),
        tuple(
            float(_threshold(block, spread) * spread)
            for block, spread in zip(blocks, np.sqrt(values[noise] ** 2 + known), strict=True)
        ),
        scale,
        added,
    )


def _independent_shares(problem: Problem, rows: Sequence[Rows]) -> list[float]:
    """Of each block's numbers, the share that is independent of the others.

    Distances share touches, and repeats of a touch share what the model gets wrong about their
    posture: as far as their residuals are alike (Kish 1965: the design effect 1 + (m - 1) ICC).
    """
    lines, shares = iter(rows), []
    for term in problem.terms:
        whole, touch = sum(len(b) * b.size for b in term.blocks), term.repeats()
        for block in term.blocks:
            line = next(lines).line
            # Readings of one rest count once in the term's equations already.
            _, first, rest, read = np.unique(
                term.readings(block),
                axis=0,
                return_index=True,
                return_inverse=True,
                return_counts=True,
            )
            residual = summed(line.residual * line.weight[:, None], rest.reshape(-1), len(first))
            residual /= read[:, None]
            group, size = grouped_rows(touch[block.samples[first]])
            together = summed(residual, group, len(size))
            own, pairs = float(np.sum(residual**2)), float(np.sum(size * (size - 1.0)))
            alike = len(first) * (float(np.sum(together**2)) - own) / max(pairs * own, 1e-300)
            effect = 1.0 + pairs / len(first) * min(max(alike, 0.0), 1.0)
            shares.append(term.equations() / whole / effect)
    return shares


@dataclass(frozen=True, eq=False)
class _Energy:
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


def _of_rows(
    rows: Rows, free: IntArray, step: FloatArray, trust: float, sigma: float
) -> tuple[_Energy, _Energy, int]:
    """A block's cost: of rows within Huber's threshold, of those beyond; how many are within."""
    line = rows.line
    n, size = line.residual.shape
    spread = np.hypot(sigma, line.view.block.known_sigma)
    jacobian = rows.jacobian[:, free] * np.repeat(line.sigma / spread, size)[:, None]
    residual = (line.residual / spread[:, None]).reshape(-1)
    norm = np.linalg.norm((residual + jacobian @ step).reshape(n, size), axis=1)
    threshold = _threshold(line.view.block, spread)
    weight = np.minimum(1.0, threshold / np.maximum(norm, 1e-300))
    parts = []
    for mine in (weight == 1.0, weight < 1.0):
        some = np.repeat(mine, size)
        root = np.sqrt(trust * np.repeat(weight[mine], size))
        r, j = root * residual[some], root[:, None] * jacobian[some]
        least = float(root @ root) * (FINEST / sigma) ** 2
        parts.append(_Energy(0.5 * (float(r @ r) + least), j.T @ r, j.T @ j))
    return parts[0], parts[1], int(np.sum(weight == 1.0))


def _threshold(block: Block, spread: Any) -> Any:
    """Huber's, in units of the noise ``spread``, m or rad: of `huber_threshold` at the most."""
    given = block.noise.huber / spread
    stays = block.noise.fixed or math.isinf(block.noise.huber)
    return given if stays else np.minimum(given, huber_threshold(block.size))


def _of_prior(precision: FloatArray, away: FloatArray) -> _Energy:
    return _Energy(0.5 * float(precision @ away**2), precision * away, precision)


@dataclass(frozen=True, eq=False)
class _Point:
    """-log evidence at one η, the best step of the parameters and its covariance H⁻¹ there."""

    eta: FloatArray
    value: float
    step: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class _Evidence:
    """-log evidence as a function of η relative to where one is.

    Attributes:
        energies: of each block's believed rows, then of each group's priors.
        held: of what does not depend on η.
        counts: (k,) how many independent numbers or priors each stands for.
        beyond: of each block how many rows are beyond Huber's threshold, their dimension, and the
            threshold in units of the noise.
        mean, belief: (k,), (k, k) of the hyperprior.
    """

    energies: Sequence[_Energy]
    held: Sequence[_Energy]
    counts: FloatArray
    beyond: Sequence[tuple[float, int, float]]
    mean: FloatArray
    belief: FloatArray

    def at(self, eta: FloatArray) -> _Point:
        """Value and best step."""
        parts = [*self.held, *self._weighed(eta)]
        curvature = np.zeros((len(parts[0].slope),) * 2)
        for part in parts:
            whole = part.curvature.ndim == 2
            curvature += part.curvature if whole else np.diag(part.curvature)
        unit = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        scaled = curvature * np.outer(unit, unit) + ROUNDING * np.eye(len(unit))
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
        return _Point(eta, float(value), step, covariance)

    def derivatives(self, point: _Point) -> tuple[FloatArray, FloatArray]:
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

    def _weighed(self, eta: FloatArray) -> list[_Energy]:
        return [
            _Energy(w * e.constant, w * e.slope, w * e.curvature)
            for w, e in zip(np.exp(-2.0 * eta), self.energies, strict=True)
        ]

    def _beyond(self, eta: FloatArray) -> FloatArray:
        """-log chance of rows beyond thresholds, with two derivatives by log σ, (k, 3)."""
        found, width = np.zeros((len(eta), 3)), 1e-3
        for k, (rows, size, threshold) in enumerate(self.beyond):
            if rows:
                limit = threshold * np.exp(-eta[k] - np.array([-width, 0.0, width]))
                chance = BLUNDERS + (1.0 - BLUNDERS) * chi2.sf(limit**2, size)
                low, here, high = -rows * np.log(chance)
                found[k] = here, (high - low) / (2 * width), (high - 2 * here + low) / width**2
        return found


def _minimise(evidence: _Evidence) -> tuple[_Point, FloatArray]:
    """Newton's method with its Hessian kept positive: where it ends, and the Hessian there."""
    here = evidence.at(np.zeros(len(evidence.counts)))
    gradient, hessian = evidence.derivatives(here)
    for _ in range(NEWTON_STEPS):
        values, vectors = np.linalg.eigh(hessian)
        move = -vectors @ (vectors.T @ gradient / np.maximum(np.abs(values), 1e-2))
        move *= min(1.0, LONGEST / max(float(np.abs(move).max()), 1e-300))
        if np.max(np.abs(move)) < SETTLED / 10:
            break
        for _ in range(HALVINGS):
            there = evidence.at(here.eta + move)
            if there.value <= here.value:
                break
            move = move / 2.0
        else:
            break
        here = there
        gradient, hessian = evidence.derivatives(here)
    return here, hessian


def _told_by_data(hessian: FloatArray, belief: FloatArray) -> FloatArray:
    """Information of the data in that of data and belief: no less than nothing.

    Where a model fits badly, the evidence is no parabola, and its curvature may be below belief's.
    """
    root = np.linalg.cholesky(belief)
    scaled = np.linalg.solve(root, np.linalg.solve(root, hessian - belief).T)
    values, vectors = np.linalg.eigh(scaled)
    part = root @ vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(part @ part.T)
