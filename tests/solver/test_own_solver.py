"""A solver of one's own: the one that the docs show, and what is refused of others."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, ClassVar, final

import numpy as np
import pytest
from simulated import Spread, dh_parameters
from solver_problems import DIRTY, HUBER, SIGMA, dirty_problem, distances

from suta_calib import Problem, SolverOptions, solve
from suta_calib.errors import ParameterError, SolverError
from suta_calib.solver import Answer, GaussNewton, Ipopt, RobustNlp, Solver

PLAIN = SolverOptions(weights=None)


def shown(repository: Path, problem: Problem) -> dict[str, Any]:
    """What the page's block about a solver defines, run for a problem."""
    page = (repository / "docs/guides/extend.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```$", page, re.M | re.S)
    names: dict[str, Any] = {"problem": problem, "__name__": "shown"}
    exec(compile(block, "docs/guides/extend.md", "exec"), names)
    return names


@pytest.mark.parametrize("spread", [Spread(position=SIGMA), DIRTY], ids=["clean", "outliers"])
def test_the_solver_that_the_docs_show_reaches_the_same_minimum(
    spread: Spread, repository: Path
) -> None:
    scene = distances()
    problem = Problem([scene.term(scene.samples(spread)[0], HUBER)], dh_parameters(scene.arm))
    found, ours = shown(repository, problem)["solution"], solve(problem)
    assert found.converged
    assert found.minimum.solver == "SciPy"
    assert found.minimum.cost == pytest.approx(ours.minimum.cost, rel=1e-8)
    std = np.sqrt(np.diag(ours.covariance)[ours.free])
    np.testing.assert_allclose((found.x - ours.x)[ours.free] / std, 0.0, atol=1e-3)


def test_it_starts_anywhere_and_stays_within_bounds(repository: Path) -> None:
    problem = dirty_problem()
    solver = shown(repository, problem)["LeastSquares"]()
    found = solve(problem, SolverOptions(starts=3, solver=solver))
    assert found.agreeing == len(found.attempts) == 3
    assert {attempt.solver for attempt in found.attempts} == {"SciPy"}


def test_residuals_and_jacobian_are_those_of_the_cost() -> None:
    """With outliers beyond Huber's threshold, and priors."""
    problem = dirty_problem()
    solution = solve(problem, PLAIN)
    nlp = RobustNlp(problem, solution.free, solution.sigmas)
    z = nlp.begin(solution.x)
    z = z + 1e-4 * np.random.default_rng(0).standard_normal(len(z))
    cost, gradient, _ = nlp.cost_gradient_hessian(z)
    residuals, jacobian = nlp.residuals(z), nlp.jacobian(z)
    assert 0.5 * residuals @ residuals == pytest.approx(cost, rel=1e-12)
    assert nlp.cost(z) == pytest.approx(cost, rel=1e-14)
    np.testing.assert_allclose(jacobian.T @ residuals, gradient, rtol=1e-8, atol=1e-8 * cost)
    step = 1e-6 * np.random.default_rng(1).standard_normal(len(z))
    change = (nlp.residuals(z + step) - nlp.residuals(z - step)) / 2
    np.testing.assert_allclose(jacobian @ step, change, atol=1e-5 * np.abs(change).max())


@final
class Fixed(Solver):
    """Answers what a test says."""

    name: ClassVar[str] = "fixed"

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def search(self, nlp: RobustNlp, z: np.ndarray) -> Answer:
        del nlp
        answer: Answer = self.answer(z)
        return answer


def fails(z: np.ndarray) -> Answer:
    raise ZeroDivisionError("no way down")


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (lambda z: z, "the solver fixed: found array.*; expected an Answer"),
        (lambda z: Answer(z[1:], True), r"the solver fixed: z: found shape \(\d+,\); expected"),
        (lambda _: Answer("far", True), "the solver fixed: z: found 'far'; expected numbers"),
        (lambda z: Answer(z * np.nan, True), "z: found NaN or infinity; expected finite numbers"),
        (lambda z: Answer(z + 1.0, True), "found a cost of .*; expected at most .*, that of the"),
        (fails, r"the solver fixed: found ZeroDivisionError \(no way down\)"),
    ],
    ids=["type", "shape", "text", "nan", "up", "raises"],
)
def test_what_is_no_answer_is_refused_in_words(answer: Any, says: str) -> None:
    with pytest.raises(SolverError, match=says):
        solve(dirty_problem(), SolverOptions(weights=None, solver=Fixed(answer)))


def test_one_that_gives_up_says_so() -> None:
    solver = Fixed(lambda z: Answer(z, False, "tired", 3))
    found = solve(dirty_problem(), SolverOptions(weights=None, solver=solver))
    assert not found.converged
    assert "fixed said tired after 3 iterations" in found.sentence


@pytest.mark.parametrize("given", ["gauss-newton", GaussNewton, 7])
def test_what_is_no_solver_is_refused(given: Any) -> None:
    with pytest.raises(ParameterError, match="expected an object of a subclass of Solver"):
        solve(dirty_problem(), SolverOptions(solver=given))
    with pytest.raises(ParameterError, match=r"found the Hessian 'exakt'.*did you mean 'exact'"):
        solve(dirty_problem(), SolverOptions(hessian="exakt"))


def test_an_error_of_casadi_is_told_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(*_: Any) -> None:
        raise RuntimeError(
            "Error in Function::call\n.../casadi/core/oracle_function.cpp: evaluation failed"
        )

    monkeypatch.setattr("suta_calib.solver.ipopt._run", breaks)
    with pytest.raises(SolverError, match=r"IPOPT: found an error of CasADi \(.*evaluation failed"):
        solve(dirty_problem(), SolverOptions(weights=None, hessian="exact"))


def test_one_place_builds_a_solver() -> None:
    assert SolverOptions().build_solver() == GaussNewton(200, True)
    exact = SolverOptions(hessian="exact", max_iterations=7).build_solver()
    assert exact == Ipopt(exact=True, max_iterations=7)
    mine = Fixed(fails)
    assert SolverOptions(solver=mine).build_solver() is mine
