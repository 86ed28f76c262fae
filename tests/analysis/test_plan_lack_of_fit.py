"""A plan for an arm whose model lacks something promises no more than its data show."""

from __future__ import annotations

import numpy as np
import pytest
from offset_arm import ONCE, truth_of
from simulated import arm_named, artefact, artefact_scene, perturbed, placements

from suta_calib import Problem, Selection, solve
from suta_calib.analysis.planning.design import SharedUnknowns, present_information
from suta_calib.analysis.planning.situation import Situation
from suta_calib.arrays import FloatArray
from suta_calib.measurements import Samples

LENGTHS = "joint_4.z", "joint_6.z"


def promised(crooked: float) -> tuple[Situation, FloatArray, FloatArray]:
    """Touched three times each: the situation, what it promises of lengths, and their errors."""
    arm = arm_named("suta")
    held = arm.select(Selection(("joint_?.[xy]",), bound_m=0.01))
    truth = truth_of(arm) | perturbed(held, 3, crooked, 0.0)
    unknown = arm.select(
        Selection(("joint_*.offset",), bound_rad=0.26), Selection(LENGTHS, bound_m=0.03)
    )
    scene = artefact_scene("pairwise_distance", arm, truth, artefact(6), placements(5))
    n, labels = len(scene.q), {name: np.tile(column, 3) for name, column in scene.labels.items()}
    labels["repeat"] = np.repeat(["1", "2", "3"], n)
    noise = 1e-4 * np.random.default_rng(1).standard_normal((3 * n, scene.q.shape[1]))
    samples = Samples.from_arrays(arm.joints, np.tile(scene.q, (3, 1)) + noise, labels=labels)
    problem = Problem([scene.term(samples)], unknown)
    solution = solve(problem, ONCE)
    situation = Situation.of(problem, solution)
    space = SharedUnknowns.of(situation)
    at = [space.names.index(name) for name in LENGTHS]
    information = present_information(situation, space)
    held_back = set(space.identify(information).fixed.tolist())
    free = np.array([k for k in range(len(space.names)) if k not in held_back])
    std = np.sqrt(np.diag(space.covariance(information, free))[at])
    error = np.array([solution.values[n] - arm.offered[n].nominal for n in LENGTHS])
    return situation, std, error


def test_what_the_model_lacks_is_in_what_a_plan_promises() -> None:
    situation, std, error = promised(1.5e-3)
    assert situation.lacking > 2.0
    assert np.sqrt(np.mean(error**2)) > 5e-4
    # Without that factor they were more than six times as far off as was promised.
    assert np.sqrt(np.mean((error / std) ** 2)) > 1.0
    assert np.sqrt(np.mean((error / std) ** 2)) < 4.0


def test_a_model_that_lacks_nothing_is_planned_with_its_noise() -> None:
    situation, std, error = promised(0.0)
    assert situation.lacking == 1.0
    assert situation.sigmas[0] == pytest.approx(solve(situation.problem, ONCE).noise[0])
    assert np.sqrt(np.mean((error / std) ** 2)) < 2.5
