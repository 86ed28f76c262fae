"""Gauss-Newton steps and IPOPT on the same nonlinear program: who stops where."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import Spread, dh_parameters
from solver_problems import DIRTY, HUBER, SIGMA, dirty_problem, distances, far_problem

from suta_calib.arrays import FloatArray
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.gauss_newton import GaussNewton
from suta_calib.solver.interface import SETTLED, Minimum, hopeless
from suta_calib.solver.ipopt import STALLED, AnyIpopt, Ipopt
from suta_calib.solver.nlp import RobustNlp
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve


@pytest.mark.parametrize("spread", [Spread(position=SIGMA), DIRTY])
def test_an_answer_is_ipopts(spread: Spread) -> None:
    """It goes on from where Gauss-Newton steps ended, and finds nothing lower."""
    scene = distances()
    problem = Problem([scene.term(scene.samples(spread)[0], HUBER)], dh_parameters(scene.arm))
    by_steps, found = (solve(problem, SolverOptions(2, confirm=c)) for c in (False, True))
    assert (by_steps.minimum.solver, found.minimum.solver) == ("Gauss-Newton", "IPOPT")
    assert found.minimum.cost <= by_steps.minimum.cost
    std = np.sqrt(np.diag(found.covariance)[found.free])
    np.testing.assert_allclose((found.x - by_steps.x)[found.free] / std, 0.0, atol=1e-3)


@pytest.mark.parametrize("spread", [Spread(position=SIGMA), DIRTY])
def test_a_minimum_is_confirmed_where_it_stands(
    spread: Spread, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not by a line search for what rounding leaves of the cost."""
    scene = distances()
    problem = Problem([scene.term(scene.samples(spread)[0], HUBER)], dh_parameters(scene.arm))
    lowest = solve(problem, SolverOptions(confirm=False))
    nlp = RobustNlp(problem, lowest.free, lowest.sigmas)
    asked: list[FloatArray] = []
    evaluate = nlp.cost_gradient_hessian
    monkeypatch.setattr(nlp, "cost_gradient_hessian", lambda z: asked.append(z) or evaluate(z))
    found = GaussNewton().confirmed(nlp, lowest.minimum)
    assert (found.solver, found.converged) == ("IPOPT", True)
    assert len(asked) <= 3


def test_where_steps_stopped_short_ipopt_goes_on() -> None:
    scene = distances()
    problem = Problem([scene.term(scene.samples()[0], HUBER)], dh_parameters(scene.arm))
    lowest = solve(problem)
    nlp = RobustNlp(problem, lowest.free, lowest.sigmas)
    short = replace(lowest.minimum, x=problem.start(), cost=np.inf, status=SETTLED)
    found = GaussNewton().confirmed(nlp, short)
    assert found.solver == "IPOPT"
    assert found.iterations > short.iterations
    assert found.cost == pytest.approx(lowest.minimum.cost, rel=1e-9)


def test_what_ipopt_goes_on_from_without_an_end_was_no_minimum() -> None:
    problem = far_problem()
    start = problem.start()
    free = np.arange(len(start))
    nlp = RobustNlp(problem, free, problem.assumed_sigmas())
    cost, *_ = nlp.cost_gradient_hessian(start / problem.parameters.array("scale"))
    ended = Minimum(start, cost, SETTLED, 1, True, "Gauss-Newton")
    found = GaussNewton(max_iterations=2).confirmed(nlp, ended)
    assert not found.converged
    assert found.cost < cost


@pytest.mark.parametrize("spread", [Spread(position=SIGMA), DIRTY])
def test_a_refit_ends_in_ipopts_minimum(spread: Spread) -> None:
    """From the minimum with twelve touches more, whether gross errors are none or many."""
    scene = distances()
    whole = Problem([scene.term(scene.samples(spread)[0], HUBER)], dh_parameters(scene.arm))
    solution = solve(whole)
    term = whole.terms[0]
    fewer = Problem([term.take(np.arange(12, len(term.poses)))], whole.arm_parameters)
    nlp = RobustNlp(fewer, solution.free, solution.sigmas)
    near, cluster = (each.minimise(nlp, solution.x) for each in (GaussNewton(), Ipopt()))
    assert near.converged
    assert (near.solver, cluster.solver) == ("Gauss-Newton", "IPOPT")
    assert near.cost == pytest.approx(cluster.cost, rel=1e-10)
    std = np.sqrt(np.diag(solution.covariance)[solution.free])
    found, moved = ((to - cluster.x)[solution.free] for to in (near.x, solution.x))
    assert np.abs(moved / std).max() > 0.1
    np.testing.assert_allclose(found / std, 0.0, atol=1e-3)


def test_a_minimum_on_a_bound_is_ipopts() -> None:
    whole = dirty_problem()
    solution = solve(whole)
    k = int(solution.free[0])
    name, found = whole.names[k], float(solution.x[k])
    short = replace(whole.arm_parameters[name], upper=found - 1e-3)
    arm = ParameterSet([short if p.name == name else p for p in whole.arm_parameters.values()])
    bounded = Problem(whole.terms, arm)
    nlp = RobustNlp(bounded, solution.free, solution.sigmas)
    start = solution.x.copy()
    start[k] = found - 2e-3
    near, cluster = (each.minimise(nlp, start) for each in (GaussNewton(), Ipopt()))
    assert (near.solver, cluster.solver) == ("Gauss-Newton", "IPOPT")
    np.testing.assert_allclose(near.x, cluster.x, atol=1e-7)
    assert near.x[k] == short.upper
    assert near.cost == pytest.approx(cluster.cost, rel=1e-10)


def test_a_slope_that_never_vanishes_is_given_up_early() -> None:
    """At a fold no step helps, and every iteration would be fifty evaluations."""
    count = 0

    def fold(z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        nonlocal count
        count += 1
        slope = np.where(z[0] > 0.0, 3e3, -2e3)
        return 1e5 + float(slope * z[0]), np.array([slope]), np.array([[1e3]])

    where = {"x0": np.array([0.7]), "lbx": np.array([-9.0]), "ubx": np.array([9.0])}
    _, stats = AnyIpopt(1, (200, 1.0))(fold, where)
    assert stats["return_status"] == STALLED
    assert stats["iter_count"] < 60
    assert count < 2500


def test_starts_that_end_nowhere_together_are_no_reason_for_more() -> None:
    def ended(cost: float, converged: bool = False) -> Minimum:
        return Minimum(np.zeros(1), cost, STALLED, 200, converged, "IPOPT")

    assert hopeless([ended(5.0), ended(9.0), ended(5.0001)])
    assert not hopeless([ended(5.0)])
    assert not hopeless([ended(5.0), ended(5.1)])
    assert not hopeless([ended(5.0), ended(5.0, converged=True)])
