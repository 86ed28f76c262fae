"""What every kind of observation promises, asked of all of them.

A kind that is added to `suta_calib.terms.KINDS` fails here until it has a case.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import casadi as ca
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
    hand_eye_scene,
    perturbed,
    placements,
    tracked_scene,
)

from suta_calib.model.arm import ArmModel
from suta_calib.solver.information import whitened_rows
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.solver.symbolic import symbolic_cost
from suta_calib.terms import KINDS, ArmPoses, HandEye, Noise

GAUGE = {"joint_1.offset", "joint_2.z"}
SIGMA = Spread(position=1e-4, rotation=1e-3)
Make = Callable[[ArmModel, dict[str, float]], Scene]


@dataclass(frozen=True)
class Case:
    """A set-up of one kind, and what of the SUTA's thirteen parameters it cannot tell."""

    kind: str
    make: Make
    unidentified: frozenset[str]


def over_artefact(kind: str, oriented: bool) -> Make:
    certified = artefact(8, oriented=oriented)
    return lambda arm, truth: artefact_scene(kind, arm, truth, certified, placements(4))


def case(kind: str, make: Make, *names: str) -> Case:
    return Case(kind, make, frozenset(GAUGE | set(names)))


# Parallel pillars hide the tool's length; one point hides the scale, held by one of the lengths;
# a camera's unknown pose on the tip takes up whatever follows the last joint.
CASES = {
    "pairwise_distance": case(
        "pairwise_distance", over_artefact("pairwise_distance", False), "tip.y"
    ),
    "landmark": case("landmark", over_artefact("landmark", False), "tip.y"),
    "landmark with seats": case("landmark", over_artefact("landmark", True), "tip.y"),
    "fixed_point": case("fixed_point", fixed_point_scene, "joint_4.z"),
    "tracked_point": case("tracked_point", tracked_scene),
    "tracked_point with orientation": case(
        "tracked_point", lambda arm, truth: tracked_scene(arm, truth, oriented=True)
    ),
    "hand_eye": case("hand_eye", hand_eye_scene, "joint_6.offset", "tip.y", "tip.z"),
}
AVAILABLE = [name for name, c in CASES.items() if c.kind in KINDS]
each_case = pytest.mark.parametrize("name", AVAILABLE)


@cache
def scene(name: str) -> Scene:
    arm = arm_named("suta")
    return CASES[name].make(arm, perturbed(dh_parameters(arm), seed=1))


def noises(spread: Spread, robust: bool) -> tuple[Noise, Noise]:
    """Lengths and angles: known scatter, and Huber's threshold where it is robust."""
    found = []
    for sigma in (spread.position, spread.rotation):
        found.append(Noise(sigma, huber_threshold(3) * sigma) if robust else Noise(sigma))
    return found[0], found[1]


def problem_of(name: str, spread: Spread = SIGMA, seed: int = 0, robust: bool = False) -> Problem:
    s = scene(name)
    term = s.term(s.samples(spread, seed)[0], *noises(SIGMA, robust))
    return Problem([term], dh_parameters(s.arm))


def truth_of(problem: Problem, name: str) -> np.ndarray:
    """The parameter vector at which the exact samples of a case were made."""
    return problem.start(scene(name).truth)


def somewhere(problem: Problem, name: str, seed: int = 0) -> np.ndarray:
    x = truth_of(problem, name)
    return x + 1e-3 * np.random.default_rng(seed).standard_normal(len(x))


def test_every_kind_has_a_case() -> None:
    assert set(KINDS) <= {c.kind for c in CASES.values()}


@each_case
def test_names_are_unique_and_nominal_is_inside_the_bounds(name: str) -> None:
    term = scene(name).exact()
    names = [p.name for p in term.own]
    assert len(set(names)) == len(names)
    assert not set(names) & set(scene(name).arm.parameters)
    assert all(p.lower <= p.nominal <= p.upper for p in term.own)
    assert all(np.isfinite(p.plausible) and p.plausible > 0 for p in term.own)
    assert term.kind == CASES[name].kind


@each_case
def test_blocks_fit_together(name: str) -> None:
    term = scene(name).exact()
    for block in term.blocks:
        n = len(block)
        assert n > 0
        assert len(block.own) == len(block.data) == len(block.known_sigma) == len(block.labels) == n
        assert block.samples.min() >= 0
        assert block.samples.max() < len(term.poses)
        assert block.own.shape[1] == 0 or 0 <= block.own.min() <= block.own.max() < len(term.own)


@each_case
def test_the_residual_is_zero_at_the_truth(name: str) -> None:
    problem = problem_of(name, Spread())
    x = truth_of(problem, name)
    for line in problem.linearise(x, problem.assumed_sigmas()):
        np.testing.assert_allclose(line.residual, 0.0, atol=1e-9)
    nominal = problem.linearise(problem.start(), problem.assumed_sigmas())
    assert max(np.abs(line.residual).max() for line in nominal) > 1e-4


@each_case
def test_the_start_is_finite_for_any_poses(name: str) -> None:
    term, rng = scene(name).exact(), np.random.default_rng(0)
    n = len(term.poses)
    turned = np.linalg.qr(rng.standard_normal((n, 3, 3)))[0]
    turned *= np.linalg.det(turned)[:, None, None]
    for rotation in (np.tile(np.eye(3), (n, 1, 1)), turned):
        for position in (np.zeros((n, 3)), rng.standard_normal((n, 3))):
            start = term.start(rotation, position)
            assert start.shape == (len(term.own),)
            assert np.isfinite(start).all()


def stacked(problem: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All whitened residuals, and their Jacobian."""
    rows = whitened_rows(problem, x, problem.assumed_sigmas())
    residual = [(r.line.residual / r.line.sigma[:, None]).reshape(-1) for r in rows]
    return np.concatenate(residual), np.vstack([r.jacobian for r in rows])


@each_case
def test_the_jacobian_equals_central_differences(name: str) -> None:
    problem = problem_of(name)
    assert_jacobian(problem, somewhere(problem, name))


def test_so_it_does_where_the_noise_is_the_hands_in_part() -> None:
    s = scene("hand_eye")
    poses = ArmPoses(s.arm, s.samples(SIGMA)[0])
    term = HandEye(poses, *noises(SIGMA, False), hand_share=0.5)
    problem = Problem([term], dh_parameters(s.arm))
    assert_jacobian(problem, somewhere(problem, "hand_eye"))


def assert_jacobian(problem: Problem, x: np.ndarray) -> None:
    jacobian = stacked(problem, x)[1].copy()
    scale = np.abs(jacobian).max()
    for k in range(len(x)):
        step = 1e-6 * (np.arange(len(x)) == k)
        difference = (stacked(problem, x + step)[0] - stacked(problem, x - step)[0]) / 2e-6
        np.testing.assert_allclose(
            jacobian[:, k], difference, atol=2e-8 * scale, err_msg=problem.names[k]
        )


@each_case
@pytest.mark.parametrize("gauge", sorted(GAUGE))
def test_noise_tells_nothing_of_where_the_arm_stands(name: str, gauge: str) -> None:
    """Whatever the parameters, the term's own unknowns follow the whole arm's motion exactly."""
    problem = problem_of(name)
    jacobian = stacked(problem, somewhere(problem, name, seed=2))[1]
    column = jacobian[:, problem.names.index(gauge)]
    own = jacobian[:, problem.arm_count :]
    rest = column - own @ np.linalg.lstsq(own, column)[0] if own.size else column
    assert np.abs(rest).max() < 1e-10 * np.abs(jacobian).max()


@each_case
@pytest.mark.parametrize("robust", [False, True])
def test_the_gradient_is_the_costs_and_agrees_with_casadi(name: str, robust: bool) -> None:
    """The fast evaluation against one CasADi expression of the whole cost, outliers included."""
    problem = problem_of(name, Spread(1e-4, 1e-3, outliers=0.1), robust=robust)
    x, sigmas = somewhere(problem, name), problem.assumed_sigmas()
    symbol = ca.MX.sym("x", len(x))
    expression = symbolic_cost(problem, symbol, sigmas)
    reference = ca.Function("c", [symbol], [expression, ca.gradient(expression, symbol)])
    expected, expected_gradient = reference(x)
    cost, gradient, hessian = problem.evaluation.cost_gradient_hessian(x, sigmas)
    assert cost == pytest.approx(float(expected), rel=1e-12)
    assert problem.evaluation.cost(x, sigmas) == pytest.approx(cost, rel=1e-14)
    size = np.abs(gradient).max()
    np.testing.assert_allclose(gradient, expected_gradient.full()[:, 0], atol=1e-11 * size)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12 * np.abs(hessian).max())
    assert np.linalg.eigvalsh(hessian).min() > -1e-10 * np.abs(hessian).max()
    if robust:
        weights = [line.weight for line in problem.linearise(x, sigmas)]
        assert min(w.min() for w in weights) < 0.5


@each_case
def test_without_outliers_the_matrix_is_gauss_newtons(name: str) -> None:
    problem = problem_of(name)
    x = somewhere(problem, name)
    residual, jacobian = stacked(problem, x)
    _, gradient, hessian = problem.evaluation.cost_gradient_hessian(x, problem.assumed_sigmas())
    expected = jacobian.T @ jacobian
    np.testing.assert_allclose(hessian, expected, atol=1e-12 * np.abs(expected).max())
    size = np.abs(gradient).max()
    np.testing.assert_allclose(gradient, jacobian.T @ residual, atol=1e-11 * size)


@each_case
def test_a_noise_free_solve_recovers_what_is_identified(name: str) -> None:
    problem = problem_of(name, Spread())
    solution = solve(problem)
    truth = scene(name).truth
    assert solution.converged
    alone = [e for e in solution.estimates.values() if e.state == "identified" and not e.given]
    recovered = {e.name: e.value - truth[e.name] for e in alone if e.name in truth}
    assert len(recovered) >= 5
    assert max(map(abs, recovered.values())) < 1e-9
    for line in problem.linearise(solution.x, problem.assumed_sigmas()):
        np.testing.assert_allclose(line.residual, 0.0, atol=1e-9)


@each_case
@pytest.mark.parametrize("spread", [Spread(), SIGMA], ids=["exact", "noisy"])
def test_what_the_data_cannot_tell_is_held_and_named(name: str, spread: Spread) -> None:
    solution = solve(problem_of(name, spread))
    assert set(solution.unidentified) == CASES[name].unidentified
    for held in solution.unidentified:
        estimate = solution.estimates[held]
        assert (estimate.std, estimate.value) == (None, estimate.nominal)
    named = {c.held for c in solution.identification.combinations}
    assert named == CASES[name].unidentified


@cache
def told_alone(name: str) -> tuple[str, ...]:
    """The arm's parameters that exact data determine by themselves."""
    estimates = solve(problem_of(name, Spread())).estimates.values()
    arm = scene(name).truth
    return tuple(e.name for e in estimates if e.std and not e.given and e.name in arm)


def error_of(name: str, spread: Spread, seed: int, robust: bool) -> float:
    """Root mean square error of those parameters, in units of the solver's scales."""
    problem = problem_of(name, spread, seed, robust)
    values, truth = solve(problem).values, scene(name).truth
    errors = [(values[n] - truth[n]) / problem.parameters[n].scale for n in told_alone(name)]
    assert len(errors) >= 5
    return float(np.sqrt(np.mean(np.square(errors))))


@each_case
def test_with_outliers_huber_beats_least_squares_threefold(name: str) -> None:
    spread = Spread(SIGMA.position, SIGMA.rotation, outliers=0.1, gross=0.01)
    plain, huber = (
        np.sqrt(np.mean([error_of(name, spread, seed, robust) ** 2 for seed in range(3)]))
        for robust in (False, True)
    )
    assert huber < plain / 3


@each_case
def test_gross_outliers_do_not_change_what_is_identified(name: str) -> None:
    """An outlier of 30 mm tells the scale of an arm that only touched points, and wrongly."""
    spread = Spread(SIGMA.position, SIGMA.rotation, outliers=0.1, gross=0.03)
    assert set(solve(problem_of(name, spread, 0, True)).unidentified) == CASES[name].unidentified


def spread_over_prediction(name: str, trials: int) -> float:
    """Root of the mean, over the parameters, of Monte-Carlo variance over predicted variance."""
    s = scene(name)
    values, predicted = [], []
    for samples in s.samples(SIGMA, seed=11, trials=trials):
        problem = Problem([s.term(samples, *noises(SIGMA, False))], dh_parameters(s.arm))
        solution = solve(problem)
        assert solution.converged
        values.append(solution.x)
        predicted.append(np.diag(solution.covariance))
    told = np.flatnonzero(np.all(np.array(predicted) > 0, axis=0))
    assert len(told) >= 10
    ratio = np.var(values, axis=0, ddof=1)[told] / np.mean(predicted, axis=0)[told]
    return float(np.sqrt(np.mean(ratio)))


@each_case
def test_the_monte_carlo_spread_is_the_predicted_one(name: str) -> None:
    """120 trials: a single parameter's ratio scatters by 1/√240 = 6.5 %, pooled ones by less.

    The limits are then more than three standard deviations away, whatever the correlation.
    """
    assert 0.8 < spread_over_prediction(name, trials=120) < 1.25


@pytest.mark.slow
@each_case
def test_the_monte_carlo_spread_is_the_predicted_one_closely(name: str) -> None:
    """500 trials: 3.2 % at most, so that a bias of the prediction of a tenth shows."""
    assert 0.88 < spread_over_prediction(name, trials=500) < 1.12
