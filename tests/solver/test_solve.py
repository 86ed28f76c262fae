"""The minimiser: against references, within bounds, and honest when it fails."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from simulated import (
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    dh_parameters,
    fixed_point_scene,
    perturbed,
    placements,
    tracked_scene,
)
from solver_problems import DIRTY, HUBER, SIGMA, dirty_problem, distances, far_problem

from suta_calib.errors import ParameterError, SamplesError
from suta_calib.measurements import Artefact, Samples
from suta_calib.measurements import Landmark as Mark
from suta_calib.model.parameters import Selection
from suta_calib.solver import evaluation, information
from suta_calib.solver.covariance import observed_parts
from suta_calib.solver.fitted import Fitted
from suta_calib.solver.gauss_newton import GaussNewton
from suta_calib.solver.information import predicted_information
from suta_calib.solver.nlp import RobustNlp
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Estimate
from suta_calib.solver.solve import identify_at, solve, solve_again, start_points
from suta_calib.terms import ArmPoses, MeasuredPoses, Noise, TouchedLandmark


def test_the_minimum_is_scipys_or_lower() -> None:
    """SciPy's trust region on the same residuals, the same loss, the same free parameters."""
    problem = dirty_problem()
    solution = solve(problem)
    free = solution.free
    assert len(free) == 10

    def residual(z: np.ndarray) -> np.ndarray:
        x = solution.x.copy()
        x[free] = z
        (line,) = problem.linearise(x, solution.sigmas)
        return np.asarray(line.residual[:, 0] / line.sigma)

    start = problem.start()[free]
    reference = least_squares(
        residual,
        start,
        loss="huber",
        f_scale=1.35,
        x_scale=0.01,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-12,
    )
    assert solution.minimum.cost <= reference.cost * (1 + 1e-8)
    assert solution.minimum.cost == pytest.approx(reference.cost, rel=1e-6)
    np.testing.assert_allclose(solution.x[free], reference.x, atol=1e-6)


def test_the_exact_hessian_leads_to_the_same_minimum() -> None:
    problem = dirty_problem()
    fast, exact = (solve(problem, SolverOptions(hessian=h)) for h in ("gauss-newton", "exact"))
    assert fast.converged
    assert exact.converged
    assert fast.minimum.cost == pytest.approx(exact.minimum.cost, rel=1e-10)
    np.testing.assert_allclose(fast.x, exact.x, atol=1e-8)


def test_the_gradient_vanishes_at_the_solution() -> None:
    problem = dirty_problem()
    solution = solve(problem)
    _, gradient, hessian = problem.evaluation.cost_gradient_hessian(solution.x, solution.sigmas)
    free = solution.free
    step = np.linalg.solve(hessian[np.ix_(free, free)], gradient[free])
    assert np.all(np.abs(step) < 1e-3 * np.sqrt(np.diag(solution.covariance)[free]))


def test_a_start_that_falls_into_a_minimum_already_found_ends_there() -> None:
    """The same minimum, the same count and verdict as when every start is carried to its end."""
    problem = dirty_problem()
    solution = solve(problem, SolverOptions(starts=6))
    left = [a for a in solution.attempts if a.joined]
    assert left
    assert not solution.minimum.joined
    assert solution.agreeing == len(solution.attempts)
    # Each carried to its end by itself.
    held = set(solution.identification.fixed.tolist())
    starts = start_points(problem, problem.start(), held, SolverOptions(starts=6))
    std = np.sqrt(np.diag(solution.covariance)[solution.free])
    for start, attempt in zip(starts, solution.attempts, strict=True):
        nlp = RobustNlp(problem, solution.free, solution.sigmas)
        alone = GaussNewton().minimise(nlp, start)
        assert not alone.joined
        assert attempt.cost == pytest.approx(alone.cost, abs=1e-6)
        np.testing.assert_allclose((attempt.x - alone.x)[solution.free] / std, 0.0, atol=1e-3)
        assert attempt.iterations < alone.iterations or not attempt.joined


def test_other_starts_find_what_the_first_one_misses() -> None:
    told: list[tuple[int, int]] = []
    options = SolverOptions(starts=4, seed=2)
    several = solve(far_problem(), options, lambda done, of: told.append((done, of)))
    assert several.attempts[0].cost > 1e3
    assert several.minimum.cost < 1e-6
    assert len(several.attempts) == 4
    assert "1 of 4 starts reached the same minimum" in several.sentence
    assert told[:4] == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_starts_depend_on_the_seed_alone() -> None:
    problem = far_problem()
    first, again, other = (
        start_points(problem, problem.start(), set(), SolverOptions(starts=3, seed=s))
        for s in (4, 4, 5)
    )
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[0], other[0])
    assert not np.any(np.isclose(first[1:], other[1:])[:, :5])
    alone, twice = (solve(problem, SolverOptions(starts=2, seed=2)) for _ in range(2))
    np.testing.assert_array_equal(alone.x, twice.x)


def bounded(bound: float) -> Problem:
    arm = arm_named("suta")
    rows = [Selection(("joint_*.offset",), bound_rad=0.2), Selection(("joint_6.z",), bound_m=0.03)]
    parameters = arm.select(*rows, Selection(("joint_4.z",), bound_m=bound))
    truth = {"joint_4.z": arm.parameters["joint_4.z"].nominal + 5e-3}
    return Problem([tracked_scene(arm, truth).exact(Noise(SIGMA))], parameters)


def test_a_bound_is_kept_and_said() -> None:
    solution = solve(bounded(4e-3))
    estimate = solution.estimates["joint_4.z"]
    assert estimate.value == pytest.approx(0.571 + 4e-3, abs=1e-7)
    assert estimate.value <= 0.571 + 4e-3
    assert (estimate.state, estimate.std) == ("at_bound", None)
    assert solution.estimates["joint_6.z"].state == "identified"
    free = solve(bounded(2e-2)).estimates["joint_4.z"]
    assert free.state == "identified"
    assert free.value == pytest.approx(0.576, abs=1e-9)


@pytest.mark.parametrize("hessian", ["gauss-newton", "exact"])
def test_not_converging_is_an_answer_and_no_exception(hessian: str) -> None:
    scene = distances()
    problem = Problem([scene.exact(HUBER)], dh_parameters(scene.arm))
    solution = solve(problem, SolverOptions(max_iterations=1, hessian=hessian))
    assert not solution.converged
    assert solution.sentence.startswith("not converged: IPOPT said Maximum_Iterations_Exceeded")
    assert np.isfinite(solution.x).all()
    assert set(solution.estimates) == set(problem.names)


def with_prior(prior: float, name: str = "joint_4.z") -> Problem:
    """A prior whose size is known, beside what has none."""
    scene = distances()
    told = ("joint_3.z", "joint_5.z", "joint_6.z", "tip.z")
    rows = [Selection(("joint_[2-6].offset", *told)), Selection((name,), prior_m=prior, fixed=True)]
    samples = scene.samples(Spread(position=SIGMA), seed=2)[0]
    return Problem([scene.term(samples, Noise(math.sqrt(2) * SIGMA))], scene.arm.select(*rows))


def test_a_loose_prior_changes_nothing() -> None:
    free = solve(with_prior(10.0)).estimates["joint_4.z"]
    loose = solve(with_prior(0.05)).estimates["joint_4.z"]
    assert free.state == loose.state == "identified"
    assert free.std is not None
    assert abs(free.value - loose.value) < 0.05 * free.std
    assert loose.std == pytest.approx(free.std, rel=0.01)


def test_a_tight_prior_is_said_to_be_one() -> None:
    estimate = solve(with_prior(1e-6)).estimates["joint_4.z"]
    assert estimate.state == "prior"
    assert estimate.std == pytest.approx(1e-6, rel=0.02)
    assert estimate.value == pytest.approx(estimate.nominal, abs=1e-5)


def test_a_prior_on_what_nothing_tells_stays_what_it_was() -> None:
    solution = solve(with_prior(2e-3, "joint_2.z"))
    estimate = solution.estimates["joint_2.z"]
    assert estimate.state == "prior"
    assert estimate.std == pytest.approx(2e-3, rel=1e-6)
    assert estimate.value == pytest.approx(estimate.nominal, abs=1e-12)
    assert "joint_2.z" not in solution.unidentified


def test_prior_and_data_are_weighed_by_their_precisions() -> None:
    """One unknown, told twice: the data pull it from nominal as far as their share allows."""
    scene = tracked_scene(arm_named("suta"), {"joint_6.z": 0.371 + 2e-5}, 40)
    samples = scene.samples(Spread(position=SIGMA), seed=2)[0]

    def estimate(prior: float | None) -> Estimate:
        parameters = scene.arm.select(
            Selection(("joint_6.z",), prior_m=prior, fixed=prior is not None)
        )
        problem = Problem([scene.term(samples, Noise(SIGMA))], parameters)
        return solve(problem).estimates["joint_6.z"]

    alone = estimate(None)
    assert alone.std is not None
    both = estimate(alone.std)
    share = (both.value - both.nominal) / (alone.value - alone.nominal)
    assert share == pytest.approx(0.5, abs=0.1)
    assert both.std == pytest.approx(alone.std / math.sqrt(2), rel=0.1)


def test_a_whole_problem_without_an_arm() -> None:
    """Pivoting: the poses are measured, the tip in the tool and the point are sought."""
    arm = arm_named("suta")
    scene = fixed_point_scene(arm, {}, points=[(0.45, 0.1, 0.05)])
    samples = scene.samples(Spread(position=SIGMA), seed=1)[0]
    rotation, position = arm.forward(samples.q)
    term = type(scene.term(samples))(MeasuredPoses(rotation, position, samples), Noise(SIGMA))
    solution = solve(Problem([term]))
    assert solution.problem.arm is None
    stacked = np.hstack([rotation.reshape(-1, 3), np.tile(-np.eye(3), (len(samples), 1))])
    expected = np.linalg.lstsq(stacked, -position.reshape(-1), rcond=None)[0]
    np.testing.assert_allclose(solution.x, expected, atol=1e-12)
    error = solution.x - [0.0, 0.0, 0.0, 0.45, 0.1, 0.05]
    assert np.all(np.abs(error) < 4 * np.sqrt(np.diag(solution.covariance)))


def test_problems_without_sense_are_refused() -> None:
    scene = distances()
    with pytest.raises(ParameterError, match="no observations"):
        Problem([])
    with pytest.raises(ParameterError, match="no unknowns"):
        solve(Problem([scene.exact()]))
    other = tracked_scene(arm_named("ur5"), {}, 5)
    with pytest.raises(ParameterError, match="different arms"):
        Problem([scene.exact(), other.exact()], dh_parameters(scene.arm))


def test_two_artefacts_cannot_stand_at_one_placement() -> None:
    """Their poses would be taken for one unknown, and both be wrong."""
    arm = arm_named("suta")
    labels = {"placement": ["P1"] * 3, "repeat": ["1"] * 3, "landmark": ["A", "B", "C"]}
    samples = Samples.from_arrays(arm.joints, np.zeros((3, 6)), labels=labels)
    marks = {n: Mark(n, p) for n, p in zip("ABC", np.eye(3), strict=True)}
    terms = [
        TouchedLandmark(ArmPoses(arm, samples), Artefact(name, marks)) for name in ("one", "two")
    ]
    with pytest.raises(ParameterError, match="'one' and of artefact 'two'"):
        Problem(terms)


def test_unknowns_that_vanishing_residuals_set_free_are_not_called_determined() -> None:
    arm = arm_named("suta")
    unknowns = arm.select(
        Selection(("*.x", "*.y", "*.z"), bound_m=0.03),
        Selection(("*.offset",), bound_rad=math.radians(15)),
    )
    truth = perturbed(dh_parameters(arm), 3, 3e-3, 1e-2)
    where = [placements(6)[3], placements(8)[3]]
    scene = artefact_scene("pairwise_distance", arm, truth, artefact(4), where)
    term = scene.term(scene.samples(Spread(position=2e-4), 0)[0], Noise(huber=1.35e-3), Noise())
    with pytest.raises(SamplesError, match=r"12 independent equations for \d+ unknowns"):
        solve(Problem([term], unknowns), SolverOptions(starts=4))


def test_problems_of_as_many_unknowns_are_not_confused() -> None:
    """IPOPT is set up once for a number of unknowns: in turns, and in threads at once."""

    def deviations(seed: int) -> np.ndarray:
        scene = tracked_scene(arm_named("suta"), perturbed(dh_parameters(arm_named("suta")), seed))
        term = scene.term(scene.samples(Spread(position=SIGMA), seed=seed)[0], Noise(SIGMA))
        return solve(Problem([term], dh_parameters(scene.arm)), SolverOptions(starts=2)).x

    alone = [deviations(seed) for seed in (1, 2)]
    assert np.abs(alone[0] - alone[1]).max() > 1e-3
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(deviations, (1, 2)))
    assert np.array_equal(alone, together)


def test_nearly_the_same_problem_is_solved_from_where_it_was() -> None:
    problem = dirty_problem()
    solution = solve(problem, SolverOptions(weights=None))
    scene = distances()
    term = scene.term(scene.samples(DIRTY)[0], Noise(2 * SIGMA, SIGMA))
    other = Problem([term], problem.arm_parameters)
    fresh = solve(other, SolverOptions(weights=None))
    again = solve_again(other, solution, SolverOptions(weights=None))
    std = np.sqrt(np.diag(fresh.covariance))
    np.testing.assert_allclose(again.x, fresh.x, atol=1e-4 * std.max())
    np.testing.assert_allclose(again.covariance, fresh.covariance, atol=1e-5 * std.max() ** 2)
    np.testing.assert_allclose(again.noise, fresh.noise, rtol=1e-5)
    assert again.converged
    assert not {*again.free} ^ {*fresh.free}


def test_where_other_things_are_told_it_is_solved_anew() -> None:
    problem = dirty_problem()
    solution = solve(problem, SolverOptions(weights=None))
    nothing = replace(solution.identification, fixed=np.zeros(0, dtype=np.intp))
    again = solve_again(problem, replace(solution, identification=nothing))
    np.testing.assert_array_equal(again.identification.fixed, solution.identification.fixed)


def test_over_other_unknowns_it_is_solved_anew() -> None:
    """Where rows of one placement are all left out, it is an unknown no more."""
    arm = arm_named("suta")
    truth = perturbed(dh_parameters(arm), seed=1)
    scene = artefact_scene("landmark", arm, truth, artefact(8), placements(4))
    term, options = scene.term(scene.samples()[0], HUBER), SolverOptions(weights=None)
    solution = solve(Problem([term], dh_parameters(arm)), options)
    placement = np.array(term.poses.samples.labels["placement"])
    fewer = Problem([term.take(np.flatnonzero(placement != placement[0]))], dh_parameters(arm))
    assert fewer.names != solution.problem.names
    again = solve_again(fewer, solution, options)
    np.testing.assert_array_equal(again.x, solve(fewer, options).x)


@pytest.mark.parametrize("kind", ["distances", "tracked"])
def test_sums_over_parts_of_the_rows_are_those_over_all(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if kind == "distances":
        problem = dirty_problem()
    else:
        scene = tracked_scene(arm_named("suta"), {})
        samples = scene.samples(DIRTY)[0]
        problem = Problem([scene.term(samples, HUBER)], dh_parameters(scene.arm))
    x, sigmas = problem.start(), problem.assumed_sigmas()
    free = np.setdiff1d(np.arange(len(x)), identify_at(problem, x, sigmas).fixed)

    def sums() -> list[np.ndarray]:
        _, *derivatives = problem.evaluation.cost_gradient_hessian(x, sigmas)
        information = predicted_information(problem, x, sigmas, robust=True)
        parts = information.curvature, information.variance, information.noise_induced
        return [*derivatives, *parts, observed_parts(Fitted(problem, x, sigmas, free)).total]

    whole = sums()
    for module in (evaluation, information):
        monkeypatch.setattr(module, "AT_ONCE", 7)
    for some, everything in zip(sums(), whole, strict=True):
        np.testing.assert_allclose(
            some, everything, rtol=1e-7, atol=1e-12 * np.abs(everything).max()
        )


def test_something_else_than_a_problem_or_values_is_refused_in_words() -> None:
    problem: Any = 3
    with pytest.raises(ParameterError, match=r"found 3; expected a problem"):
        solve(problem)
    with pytest.raises(ParameterError, match=r"found 3; expected values by name"):
        arm_named("suta").at(problem)


def test_readings_of_other_joints_are_refused() -> None:
    arm = arm_named("suta")
    backwards = arm.joints[::-1]
    refused = rf"readings of {', '.join(backwards)}.*in its order: {', '.join(arm.joints)}"
    with pytest.raises(SamplesError, match=refused):
        ArmPoses(arm, Samples.from_arrays(backwards, np.zeros((1, len(backwards)))))
    with pytest.raises(SamplesError, match="readings of no joints"):
        ArmPoses(arm, Samples.from_arrays([], np.zeros((3, 0))))
