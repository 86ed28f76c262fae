"""The budget of a tip: its parts add up, and k = 2 holds as often as it says."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats
from simulated import Spread, arm_named, dh_parameters, perturbed, tracked_scene
from studies import of_size

from suta_calib import Problem, Solution, solve
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.measurements.scale import LengthScale
from suta_calib.model.parameters import ParameterSet
from suta_calib.trust.extended_problem import effective_unknowns
from suta_calib.trust.tip import sensitivity
from suta_calib.trust.uncertainty_budget import (
    Contribution,
    KnownScatter,
    UncertaintyBudget,
    axis_budget,
    coverage_factor,
    tip_budget,
)

ARM = arm_named("suta")
# Of the instrument, as it states it.
SCALE = 50e-6


def told() -> ParameterSet:
    """Those of the thirteen that the pose of the base does not stand for."""
    of_base = ("joint_1.offset", "joint_1.z", "joint_2.z")
    return ParameterSet(p for p in dh_parameters(ARM).values() if p.name not in of_base)


def solved(seed: int, postures: int = 30) -> tuple[Solution, dict[str, float], FloatArray]:
    """A tracked arm with errors of its own, seen by an instrument with a scale of its own."""
    parameters = told()
    truth = perturbed(parameters, seed, 1e-3, 3e-3)
    scene = tracked_scene(ARM, truth, postures)
    samples = scene.samples(Spread(1e-4), seed=seed)[0]
    assert samples.position is not None
    factor = 1.0 + SCALE * np.random.default_rng(seed).standard_normal()
    seen = replace(samples, position=samples.position * factor)
    term: Any = scene.term(seen)
    term = replace(term, scale=LengthScale(SCALE))
    return solve(Problem([term], parameters)), truth, scene.q


def test_the_parts_add_up_to_the_tip_s_covariance() -> None:
    solution, _, q = solved(1)
    budget = tip_budget(solution, effective_unknowns(solution))
    assert budget is not None
    names, covariance = solution.arm_covariance
    at = sensitivity(ARM, solution.values, names, q)
    whole = rms_length(at.std(covariance, at.registered())[:, None]) / math.sqrt(3.0)
    assert budget.std == pytest.approx(whole, rel=1e-6)
    assert [(part.source, part.evaluation) for part in budget.contributions] == [
        ("scatter of the measurements", "A"),
        ("scale of the instrument (50 ppm)", "B"),
    ]
    # Ninety coordinates less the parameters and the pose of the base.
    assert budget.contributions[0].freedom == pytest.approx(90 - len(told()) - 6)


def test_degrees_of_freedom_are_those_of_welch_and_satterthwaite() -> None:
    parts = (Contribution("a", "A", 3.0, 8.0), Contribution("b", "B", 4.0))
    budget = UncertaintyBudget("x", "m", parts)
    assert budget.std == pytest.approx(5.0)
    assert budget.freedom == pytest.approx(5.0**4 / (3.0**4 / 8.0))
    quantile = stats.t.ppf(0.97725, budget.freedom)
    assert budget.factor == pytest.approx(quantile)
    assert budget.expanded == pytest.approx(5.0 * quantile)


def test_the_factor_is_two_where_the_scatter_is_known() -> None:
    assert coverage_factor(math.inf) == 2.0
    assert coverage_factor(1e6) == pytest.approx(2.0, abs=1e-3)
    # Table G.2 of the GUM, 95.45 %.
    assert [round(coverage_factor(n), 2) for n in (1, 5, 10, 20)] == [13.97, 2.65, 2.28, 2.13]


def test_a_vector_s_parts_add_up() -> None:
    stated = np.diag([1.0, 2.0, 3.0])
    parts = {"scale": stated, "nothing": 0.0 * stated}
    budget = axis_budget(
        "t", "m", 4.0 * np.eye(3), KnownScatter(20.0), parts, {"hand": 0.5 * stated}
    )
    assert budget.std == pytest.approx(2.0)
    assert [part.evaluation for part in budget.contributions] == ["A", "A", "B"]
    assert [part.std**2 for part in budget.contributions] == pytest.approx([1.0, 1.0, 2.0])
    assert axis_budget("t", "m", stated, KnownScatter()).contributions[0].evaluation == "B"


def test_what_has_student_s_variance_needs_no_larger_factor() -> None:
    told = axis_budget("t", "m", np.eye(3), KnownScatter(6.0, student=True))
    assert told.factor == 2.0
    assert told.contributions[0].freedom == 6.0
    # It covers what the quantile of as many degrees of freedom covers of the scatter itself.
    assert stats.t.cdf(2.0 * math.sqrt(6.0 / 4.0), 6.0) == pytest.approx(0.975, abs=2e-3)
    assert axis_budget("t", "m", np.eye(3), KnownScatter(6.0)).factor > 2.5


@pytest.mark.parametrize("trials", of_size(200, 1000))
def test_twice_the_std_holds_as_often_as_it_says(trials: int) -> None:
    inside_tip = list[bool]()
    inside: dict[str, list[bool]] = {name: [] for name in told()}
    for seed in range(trials):
        solution, truth, q = solved(seed)
        budget = tip_budget(solution, effective_unknowns(solution))
        assert budget is not None
        factor = coverage_factor(budget.contributions[0].freedom)
        for name, estimate in solution.arm_estimates.items():
            assert estimate.std is not None
            inside[name].append(abs(estimate.value - truth[name]) <= factor * estimate.std)
        error = registered(ARM.forward(q, solution.values)[1], ARM.forward(q, truth)[1])
        names, covariance = solution.arm_covariance
        at = sensitivity(ARM, solution.values, names, q)
        moves = at.registered()
        std = np.sqrt(np.einsum("nip,pq,niq->ni", moves, covariance, moves))
        inside_tip += (np.abs(error) <= budget.factor * std).ravel().tolist()
    # What is asked for: 95 ± 2 %; of a few trials chance allows for more.
    allowed = max(0.02, 3.5 * math.sqrt(0.95 * 0.05 / trials))
    for shares in [inside_tip, *inside.values()]:
        assert sum(shares) / len(shares) == pytest.approx(0.95, abs=allowed)


def registered(found: FloatArray, true: FloatArray) -> FloatArray:
    """(n, 3) what the best rigid motion leaves of errors that are small."""
    centred = true - true.mean(axis=0)
    turns = np.zeros((len(true), 3, 3))
    for k, axis in enumerate(np.eye(3)):
        turns[:, :, k] = np.cross(axis, centred)
    rigid = np.concatenate([np.tile(np.eye(3), (len(true), 1, 1)), turns], axis=2).reshape(-1, 6)
    error = (found - true).ravel()
    return np.asarray(error - rigid @ np.linalg.lstsq(rigid, error, rcond=None)[0]).reshape(-1, 3)
