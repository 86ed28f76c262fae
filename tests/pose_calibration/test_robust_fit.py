"""What the robust fits share: their covariance, and what speaks against an answer."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from registration_scenes import NOISE, simulate

from suta_calib.pose_calibration import robust_fit as module
from suta_calib.pose_calibration.registration import Registration, register
from suta_calib.solver.compiled_residual import term_residuals
from suta_calib.solver.covariance import observed_parts
from suta_calib.solver.problem import Problem
from suta_calib.terms import HandEye, OutlierModel, PoseNoise


def registered(correlated: bool) -> Registration:
    _, a, b = simulate(60, spread=NOISE, seed=3)
    drift = 1e-3 * np.sin(np.arange(60) / 8.0)[:, None] * np.ones(3)
    return register(a, b + drift * correlated, robust=False)


def test_white_rows_have_the_covariance_of_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = registered(correlated=False)
    solution = expected.solution
    each = [np.arange(60, dtype=np.intp)]
    again = observed_parts(solution.spread.fit, each).total
    np.testing.assert_array_equal(solution.covariance, again)

    def never(*_: Any) -> Any:
        raise AssertionError("computed twice")

    monkeypatch.setattr(module, "observed_parts", never)
    np.testing.assert_array_equal(registered(correlated=False).covariance, expected.covariance)
    with pytest.raises(AssertionError, match="computed twice"):
        registered(correlated=True)


def test_what_speaks_against_an_answer() -> None:
    converged: Any = SimpleNamespace(converged=True, sentence="")
    stuck: Any = SimpleNamespace(converged=False, sentence="Iteration limit")
    answer, inliers = registered(correlated=False), np.arange(10) < 6
    assert replace(answer, solution=converged).objections("poses", inliers) == []
    inliers[0] = False
    assert replace(answer, solution=stuck).objections("poses", inliers) == [
        "The solver did not converge: Iteration limit.",
        "50% of the poses do not agree with the others.",
    ]


def test_residuals_without_derivatives_are_those_of_the_solver() -> None:
    data = HandEye.simulate(20, hand=PoseNoise(1e-3, 1e-2), eye=PoseNoise(1e-3, 1e-2), seed=0)
    problem = Problem([data.term])
    x = np.array([data.truth[name] for name in problem.names])
    lines = problem.linearise(x, problem.assumed_sigmas())
    found = term_residuals(data.term, data.truth)
    for line, residual in zip(lines, found, strict=True):
        np.testing.assert_allclose(residual, line.residual, atol=1e-15)


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_where_rows_that_settled_tell_other_things_the_rounds_go_on(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, a, b = simulate(60, spread=NOISE, seed=3, gross=OutlierModel(share))
    expected, asked = register(a, b), list[object]()

    def other(found: object) -> None:
        asked.append(found)

    monkeypatch.setattr(module, "judged", other)
    answer = register(a, b)
    assert asked
    np.testing.assert_allclose(answer.solution.x, expected.solution.x, atol=1e-9)
    np.testing.assert_array_equal(answer.inliers, expected.inliers)
    np.testing.assert_allclose(answer.solution.noise, expected.solution.noise, rtol=1e-6)
    assert answer.assessment == expected.assessment


@pytest.mark.parametrize("count", [30, 100, 300])
def test_nearly_a_third_that_saw_another_place_is_left_out(count: int) -> None:
    """Of so many any choice may seem wrong by chance, but not all eight times the noise off."""
    for seed in range(3):
        random = np.random.default_rng(seed)
        a = random.uniform(-0.1, 0.1, (count, 3))
        b = a + 0.3 + 2e-4 * random.standard_normal((count, 3))
        wrong = np.sort(random.permutation(count)[: 3 * count // 10])
        b[wrong] += [1.6e-3, 0.0, 0.0]
        found = register(a, b)
        assert found.outliers == tuple(wrong)
        off = found.act(np.zeros((1, 3)))[0] - 0.3
        assert np.linalg.norm(off) < 4 * found.target_error(np.zeros((1, 3)))[0]


def test_long_tails_are_no_other_place() -> None:
    """Of Student's t with 2.5 degrees of freedom hardly any row is left out."""
    lost = 0
    for seed in range(10):
        random = np.random.default_rng(seed)
        a = random.uniform(-0.1, 0.1, (100, 3))
        lost += len(register(a, a + 0.3 + 1e-4 * random.standard_t(2.5, (100, 3))).outliers)
    assert lost <= 50
