"""Predicted standard deviations and correlations against repeated simulated measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from simulated import (
    Scene,
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    dh_parameters,
    fixed_point_scene,
    perturbed,
    placements,
)

from suta_calib.solver.covariance import predicted_covariance
from suta_calib.solver.information import predicted_information, whitened_rows
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import Noise

SEATING = Spread(position=1e-4)
# A single parameter's ratio then scatters by 1/√200 = 7 %, and what is pooled by less.
TRIALS = 100
# Steps end where IPOPT does: in a hundred trials it is not asked.
TRIAL = SolverOptions(confirm=False)


@cache
def scenes() -> tuple[Scene, Scene]:
    arm = arm_named("suta")
    truth = perturbed(dh_parameters(arm), seed=1)
    distances = artefact_scene("pairwise_distance", arm, truth, artefact(12), placements(3))
    return distances, fixed_point_scene(arm, truth, directions=15)


@dataclass(frozen=True)
class Trials:
    """Solutions of independent repetitions, over the parameters that all of them estimated."""

    solutions: list[Solution]

    @property
    def told(self) -> np.ndarray:
        return np.flatnonzero(np.all([np.diag(s.covariance) > 0 for s in self.solutions], axis=0))

    @property
    def values(self) -> np.ndarray:
        return np.array([s.x for s in self.solutions])[:, self.told]

    @property
    def covariance(self) -> np.ndarray:
        """Mean of the predicted ones."""
        return np.mean([s.covariance for s in self.solutions], axis=0)[np.ix_(self.told, self.told)]

    def ratio(self, predicted: np.ndarray) -> np.ndarray:
        """Monte-Carlo spread over predicted standard deviations (trials or 1, parameters)."""
        return self.values.std(axis=0, ddof=1) / np.sqrt(np.mean(predicted**2, axis=0))


@cache
def distances_alone() -> Trials:
    scene = scenes()[0]
    noise = Noise(np.sqrt(2) * SEATING.position)
    return Trials(
        [
            solve(Problem([scene.term(samples, noise)], dh_parameters(scene.arm)), TRIAL)
            for samples in scene.samples(SEATING, seed=3, trials=TRIALS)
        ]
    )


@cache
def mixed() -> Trials:
    distances, points = scenes()
    parameters = dh_parameters(distances.arm)
    noise = Noise(np.sqrt(2) * SEATING.position)
    repeated = zip(
        distances.samples(SEATING, seed=4, trials=TRIALS),
        points.samples(SEATING, seed=5, trials=TRIALS),
        strict=True,
    )
    return Trials(
        [
            solve(
                Problem(
                    [distances.term(a, noise), points.term(b, Noise(SEATING.position))], parameters
                ),
                TRIAL,
            )
            for a, b in repeated
        ]
    )


# One process makes a set of trials once for all the tests that look at it.
both = pytest.mark.parametrize("trials", [distances_alone, mixed])


def naive_std(solution: Solution, told: np.ndarray) -> np.ndarray:
    """Of independent rows: s² (JᵀJ)⁻¹ with s² from the residuals."""
    rows = whitened_rows(solution.problem, solution.x, solution.sigmas)
    jacobian = np.vstack([r.jacobian for r in rows])[:, told]
    residual = np.concatenate([(r.line.residual / r.line.sigma[:, None]).ravel() for r in rows])
    variance = residual @ residual / (len(residual) - len(told))
    return np.sqrt(variance * np.diag(np.linalg.inv(jacobian.T @ jacobian)))


def pooled(ratio: np.ndarray) -> float:
    return float(np.sqrt(np.mean(ratio**2)))


def stds(trials: Trials) -> np.ndarray:
    return np.array([np.sqrt(np.diag(s.covariance))[trials.told] for s in trials.solutions])


def test_distances_share_samples_and_the_prediction_knows() -> None:
    trials = distances_alone()
    assert len(trials.told) == 10
    naive = np.array([naive_std(s, trials.told) for s in trials.solutions])
    assert pooled(trials.ratio(naive)) > 1.5
    assert 0.8 < pooled(trials.ratio(stds(trials))) < 1.25
    assert np.all(trials.ratio(stds(trials)) < 1.4)


def test_a_mix_of_kinds() -> None:
    trials = mixed()
    arm_count = trials.solutions[0].problem.arm_count
    assert np.sum(trials.told < arm_count) == 11
    assert np.sum(trials.told >= arm_count) == 6
    assert 0.8 < pooled(trials.ratio(stds(trials))) < 1.25
    assert np.all(trials.ratio(stds(trials)) < 1.4)


@both
def test_correlations_too(trials: Callable[[], Trials]) -> None:
    """A coefficient near zero scatters by 1/√TRIALS between repetitions."""
    found = trials()
    std = np.sqrt(np.diag(found.covariance))
    predicted = found.covariance / np.outer(std, std)
    seen = np.corrcoef(found.values, rowvar=False)
    assert np.abs(predicted - np.eye(len(std))).max() > 0.5
    assert np.sqrt(np.mean((predicted - seen) ** 2)) < np.hypot(0.07, 1 / np.sqrt(TRIALS))
    assert np.abs(predicted - seen).max() < 0.3


@both
def test_whitened_errors_scatter_as_chi_squared(trials: Callable[[], Trials]) -> None:
    """Against the truth, correlations included: the mean square is the number of parameters."""
    found = trials()
    solution = found.solutions[0]
    arm = found.told[found.told < solution.problem.arm_count]
    truth = np.array([scenes()[0].truth[solution.problem.names[k]] for k in arm])
    squared = []
    for s in found.solutions:
        error = s.x[arm] - truth
        squared.append(error @ np.linalg.solve(found.covariance[: len(arm), : len(arm)], error))
    assert 0.8 < np.sqrt(np.mean(squared) / len(arm)) < 1.25


def test_the_prediction_before_any_measurement_is_of_the_right_size() -> None:
    """From the nominal arm and an assumed noise alone, as a plan is judged."""
    trials = mixed()
    problem = trials.solutions[0].problem
    information = predicted_information(problem, problem.start(), problem.assumed_sigmas())
    covariance = predicted_covariance(problem, information, trials.told)
    predicted = np.sqrt(np.diag(covariance))[trials.told]
    assert 0.7 < pooled(trials.ratio(predicted[None, :])) < 1.4


def test_correlation_is_of_the_estimated_parameters() -> None:
    solution = distances_alone().solutions[0]
    names, correlation = solution.correlation()
    assert set(names) == {e.name for e in solution.estimates.values() if e.std}
    np.testing.assert_allclose(np.diag(correlation), 1.0)
    np.testing.assert_allclose(correlation, correlation.T, atol=1e-12)
    assert np.abs(correlation).max() <= 1 + 1e-12


def test_what_was_not_estimated_has_no_variance() -> None:
    solution = distances_alone().solutions[0]
    fixed = np.setdiff1d(np.arange(len(solution.x)), solution.free)
    np.testing.assert_array_equal(solution.covariance[fixed], 0.0)
    np.testing.assert_array_equal(solution.covariance[:, fixed], 0.0)
    assert np.linalg.eigvalsh(solution.covariance).min() > -1e-15


def test_the_noise_is_learnt_from_the_residuals() -> None:
    """The prediction must not rest on the assumed level: a wrong one changes it little."""
    scene = scenes()[0]
    samples = scene.samples(SEATING, seed=3)[0]
    right, wrong = (
        solve(Problem([scene.term(samples, Noise(sigma))], dh_parameters(scene.arm)))
        for sigma in (1e-4, 1e-3)
    )
    told = right.free
    np.testing.assert_array_equal(told, wrong.free)
    of_right, of_wrong = (np.sqrt(np.diag(s.covariance))[told] for s in (right, wrong))
    np.testing.assert_allclose(of_wrong, of_right, rtol=1e-3)
    assert right.noise[0] == pytest.approx(np.sqrt(2) * SEATING.position, rel=0.3)
