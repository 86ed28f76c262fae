"""What every kind of observation promises, asked of all of them.

A kind that is added to `suta_calib.terms.KINDS` fails here until it has a case."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from simulated import (
    Spread,
    dh_parameters,
)
from terms_cases import CASES, GAUGE, SIGMA, each_case, noises, problem_of, scene, truth_of

from suta_calib.registry import shipped
from suta_calib.solver.information import whitened_rows
from suta_calib.solver.nlp import symbolic_cost
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import KINDS, ArmPoses, HandEye


def somewhere(problem: Problem, name: str, seed: int = 0) -> np.ndarray:
    x = truth_of(problem, name)
    return x + 1e-3 * np.random.default_rng(seed).standard_normal(len(x))


def test_every_kind_has_a_case() -> None:
    assert set(shipped(KINDS)) <= {c.kind for c in CASES.values()}


@each_case
def test_names_are_unique_and_nominal_is_inside_the_bounds(name: str) -> None:
    term = scene(name).exact()
    names = [p.name for p in term.own_parameters]
    assert len(set(names)) == len(names)
    assert not set(names) & set(scene(name).arm.parameters)
    assert all(p.lower <= p.nominal <= p.upper for p in term.own_parameters)
    assert all(np.isfinite(p.plausible) and p.plausible > 0 for p in term.own_parameters)
    assert term.kind == CASES[name].kind


@each_case
def test_it_shows_itself_in_a_line_without_arrays(name: str) -> None:
    term = scene(name).exact()
    count = len(term.poses)
    assert repr(term) == f"<{type(term).__name__}: {count} samples>"
    assert repr(term.poses) == f"<{type(term.poses).__name__}: {count} poses>"


@each_case
def test_blocks_fit_together(name: str) -> None:
    term = scene(name).exact()
    for block in term.blocks:
        n = len(block)
        assert n > 0
        assert (
            len(block.own_columns)
            == len(block.data)
            == len(block.known_sigma)
            == len(block.labels)
            == n
        )
        assert block.samples.min() >= 0
        assert block.samples.max() < len(term.poses)
        assert block.own_columns.shape[
            1
        ] == 0 or 0 <= block.own_columns.min() <= block.own_columns.max() < len(term.own_parameters)


@each_case
def test_the_residual_is_zero_at_the_truth(name: str) -> None:
    problem = problem_of(name, Spread())
    x = truth_of(problem, name)
    for line in problem.linearise(x, problem.assumed_sigmas()):
        np.testing.assert_allclose(line.residual, 0.0, atol=1e-9)
    nominal = problem.linearise(problem.start(), problem.assumed_sigmas())
    assert max(np.abs(line.error).max() for line in nominal) > 1e-4


@each_case
def test_the_start_is_finite_for_any_poses(name: str) -> None:
    term, rng = scene(name).exact(), np.random.default_rng(0)
    n = len(term.poses)
    turned = np.linalg.qr(rng.standard_normal((n, 3, 3)))[0]
    turned *= np.linalg.det(turned)[:, None, None]
    for rotation in (np.tile(np.eye(3), (n, 1, 1)), turned):
        for position in (np.zeros((n, 3)), rng.standard_normal((n, 3))):
            start = term.start(rotation, position)
            assert start.shape == (len(term.own_parameters),)
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
    term = HandEye(poses, *noises(SIGMA, False), robot_noise_fraction=0.5)
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
    rest = column - own @ np.linalg.lstsq(own, column, rcond=None)[0] if own.size else column
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
    assert len(recovered) >= CASES[name].alone
    assert max(map(abs, recovered.values())) < 1e-9
    for line in problem.linearise(solution.x, problem.assumed_sigmas()):
        np.testing.assert_allclose(line.residual, 0.0, atol=1e-9)


@each_case
@pytest.mark.parametrize("spread", [Spread(), SIGMA], ids=["exact", "noisy"])
def test_what_the_data_cannot_tell_is_held_and_named(name: str, spread: Spread) -> None:
    solution = solve(problem_of(name, spread))
    assert set(solution.unidentified) == CASES[name].unidentified
    for fixed in solution.unidentified:
        estimate = solution.estimates[fixed]
        assert (estimate.std, estimate.value) == (None, estimate.nominal)
    named = {c.fixed for c in solution.identification.combinations}
    assert named == CASES[name].unidentified
