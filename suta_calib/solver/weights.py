"""Weights of residuals and priors, learned from the data.

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
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.model.parameters import BENDING, COMPLIANCE, EXPANSION, GAIN, MASS, OFFSET
from suta_calib.solver.information import Rows, whitened_rows
from suta_calib.solver.noise_evidence import (
    SETTLED,
    MarginalLikelihood,
    covariance_of_levels,
    data_information,
    energies_of_rows,
    energy_of_prior,
    limit_of,
    most_likely,
    threshold_of,
)
from suta_calib.solver.options import WeightOptions
from suta_calib.solver.problem import Problem
from suta_calib.terms.block import grouped_rows, summed

# The group of what is known of a camera's intrinsics.
CAMERA: Final = "camera"


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
        """Whether what was given is off by three standard deviations, and by a factor of two."""
        if self.given is None or not self.log_std:
            return False
        off = abs(math.log(self.value / self.given))
        return off > max(3.0 * self.log_std, math.log(2.0))

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the value."""
        spread = math.exp(1.96 * self.log_std)
        return self.value / spread, self.value * spread


@dataclass(frozen=True, eq=False)
class Weights(Displayable):
    """Noise levels and prior factors, with their standard deviations.

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
        elif problem.arm is not None and p.owner in problem.arm.tips:
            groups.append("tip")
        elif not p.geometric:
            kinds = {GAIN: "gains", COMPLIANCE: "compliances", EXPANSION: "expansions"}
            kinds |= {MASS: "masses", **dict.fromkeys(BENDING, "bending compliances")}
            kind = kinds.get(p.key, "eccentricities")
            groups.append("couplings" if p.coupling else kind)
        elif p.key == OFFSET:
            groups.append("offsets")
        else:
            groups.append("lengths" if p.unit == "m" else "angles")
    own_parameters = list(problem.parameters.values())[problem.arm_count :]
    return groups + [None if p.prior is None or p.prior_fixed else CAMERA for p in own_parameters]


def learn_weights(
    problem: Problem,
    x: FloatArray,
    sigmas: Sequence[float],
    free: IntArray,
    options: WeightOptions = WeightOptions(),
) -> Weights:
    """Noise levels and factors on priors that make the data most likely.

    The minimum x (n,) is for the weights so far: ``sigmas``, and priors as given.
    """
    blocks, rows = problem.blocks, whitened_rows(problem, x, sigmas)
    of_parameter = prior_groups(problem)
    names = [of_parameter[k] for k in free]
    groups = tuple(dict.fromkeys(name for name in names if name is not None))
    members = [np.array([name == group for name in names]) for group in groups]
    precision = problem.prior_precision()[free]
    away = (x - problem.parameters.array("nominal"))[free]
    stays = energy_of_prior(precision * [name is None for name in names], away)
    trust = _independent_shares(problem, rows)
    known_variance = [float(np.mean(row.line.known_sigma**2)) for row in rows]
    given = np.concatenate([problem.assumed_sigmas(), np.ones(len(groups))])
    noise, factors = slice(0, len(blocks)), slice(len(blocks), None)
    # Logarithmic standard deviation of what must stay.
    before = [
        1e-6 if b.noise.fixed else options.assumed if b.noise.sigma is None else options.stated
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
    # The weights of the rows, then noise and factors for them, until these settle.
    for _ in range(10):
        energies, counts, beyond, held = [], [], [], [stays]
        for block, r, t, k, log_sigma in zip(
            blocks, rows, trust, known_variance, eta[noise], strict=True
        ):
            inside, outside, count = energies_of_rows(r, free, step, t, math.exp(log_sigma))
            energies.append(inside)
            held.append(outside)
            counts.append(t * count * block.size)
            spread = math.sqrt(math.exp(2.0 * log_sigma) + k)
            beyond.append((t * (len(block) - count), block.size, threshold_of(block, spread)))
        for mine, log_factor in zip(members, eta[factors], strict=True):
            energies.append(energy_of_prior(precision * mine * math.exp(-2.0 * log_factor), away))
            counts.append(float(mine.sum()))
        evidence = MarginalLikelihood(
            energies, held, np.array(counts), beyond, np.log(given) - eta, belief
        )
        best, hessian = most_likely(evidence)
        eta, step = eta + best.eta, best.step
        if np.max(np.abs(best.eta)) < SETTLED:
            break
    data = data_information(hessian, belief)
    uncertainty = np.asarray(np.linalg.inv(data + belief), dtype=np.float64)
    values, stds = np.exp(eta), np.sqrt(np.diag(uncertainty))
    scale, added = np.ones(len(x)), np.zeros((len(x),) * 2)
    for mine, factor in zip(members, values[factors], strict=True):
        scale[free[mine]] = factor
    # How far the weights scatter from data to data: what nothing was learned of is as given.
    scatter = uncertainty @ data @ uncertainty
    added[np.ix_(free, free)] = covariance_of_levels(evidence.at, best.eta, scatter)
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
            for v, k, t in zip(values[noise], known_variance, trust, strict=True)
        ),
        tuple(
            float(limit_of(block, spread))
            for block, spread in zip(
                blocks, np.sqrt(values[noise] ** 2 + known_variance), strict=True
            )
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
        numbers, touch = sum(len(b) * b.size for b in term.blocks), term.repeats()
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
            squares, pairs = float(np.sum(residual**2)), float(np.sum(size * (size - 1.0)))
            correlation = (
                len(first) * (float(np.sum(together**2)) - squares) / max(pairs * squares, 1e-300)
            )
            effect = 1.0 + pairs / len(first) * min(max(correlation, 0.0), 1.0)
            shares.append(term.equations() / numbers / effect)
    return shares
