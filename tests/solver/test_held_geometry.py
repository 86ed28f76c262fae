"""A held length that sets the scale is in every ± with its tolerance; conventions are in none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from offset_arm import ONCE, truth_of
from simulated import (
    Scene,
    arm_named,
    artefact,
    artefact_scene,
    fixed_point_scene,
    line_scene,
    placements,
    plane_scene,
    tracked_scene,
)

from suta_calib import ArmModel, ParameterSet, Problem, Selection, Term, observe, solve
from suta_calib.measurements.scale import GRADES
from suta_calib.model.parameters import POSITION
from suta_calib.solver.held_geometry import TOLERANCES
from suta_calib.solver.solution import Solution
from suta_calib.trust.scale_effects import scale_effects
from suta_calib.trust.tip import sensitivity

SCENES: dict[str, Callable[[ArmModel, dict[str, float]], Scene]] = {
    "fixed_point": fixed_point_scene,
    "line": line_scene,
    "plane": plane_scene,
}
TRIALS = 24


@cache
def arm_of(grade: str = "") -> ArmModel:
    return arm_named("suta").of_grade(grade)


def unknowns(arm: ArmModel) -> ParameterSet:
    """Offsets and two of the three long lengths: joint_6.z of 371 mm is held."""
    turns = Selection(("joint_[2-6].offset",), bound_rad=0.26)
    return arm.select(turns, Selection(("joint_4.z", "tip.y"), bound_m=0.03))


def noisy(scene: Scene, seed: int) -> Term:
    samples = scene.samples()[0]
    shaken = 1e-4 * np.random.default_rng(seed).standard_normal(samples.q.shape)
    return scene.term(replace(samples, q=samples.q + shaken))


def solved(kind: str, held: float, grade: str = "", seed: int = 0) -> tuple[Solution, float]:
    """With joint_6.z off by so much, m: the solution, and joint_4.z."""
    arm = arm_of(grade)
    truth = truth_of(arm) | {
        "joint_1.offset": 0.0,
        "joint_4.z": 0.571 + 1e-3,
        "tip.y": -0.253 + 5e-4,
    }
    truth["joint_6.z"] = arm.offered["joint_6.z"].nominal + held
    term = noisy(SCENES[kind](arm, truth), seed)
    return solve(Problem([term], unknowns(arm)), ONCE), truth["joint_4.z"]


@pytest.mark.parametrize("kind", SCENES)
def test_a_held_length_that_is_off_is_in_the_others(kind: str) -> None:
    """Half a per cent of the arm: once good at a hundred of its standard deviations."""
    solution, truth = solved(kind, 2.2e-3)
    found = solution.estimates["joint_4.z"]
    assert found.std is not None
    off = abs(found.value - truth)
    assert off > 2.5e-3
    within = np.sqrt(np.diag(solution.covariance_within_scale))
    assert off > 20 * within[solution.problem.names.index("joint_4.z")]
    assert off < 2 * found.std
    (effect,) = scale_effects(solution)
    assert (effect.what, effect.name) == ("held length", "joint_6.z")
    assert effect.carries


def test_monte_carlo_with_held_lengths_drawn_from_the_drawing() -> None:
    """The estimate's errors, and the tip's, are as large as stated."""
    arm, random = arm_of("printed"), np.random.default_rng(2)
    lengths = [
        n for n in arm.geometric if n.rpartition(".")[2] in POSITION and n not in unknowns(arm)
    ]
    errors, stated, tips = list[float](), list[float](), list[tuple[float, float]]()
    for k in range(TRIALS):
        common = GRADES["printed"] * random.standard_normal()
        truth = truth_of(arm) | {"joint_1.offset": 0.0}
        for name in sorted(lengths):
            nominal = arm.offered[name].nominal
            own = TOLERANCES["printed"][0] * random.standard_normal() if nominal else 0.0
            truth[name] = nominal * (1.0 + common) + own
        problem = Problem([noisy(fixed_point_scene(arm, truth, 12), k)], unknowns(arm))
        found = solve(problem, ONCE)
        estimate = found.estimates["joint_4.z"]
        assert estimate.std is not None
        errors.append(estimate.value - 0.571)
        stated.append(estimate.std)
        names, covariance = found.arm_covariance
        q = problem.terms[0].poses.samples.q[::3]
        at = sensitivity(arm, found.values, names, q)
        true = sensitivity(arm, truth, [], q)
        shift = at.position - true.position
        left = shift - shift.mean(axis=0)
        tips.append((float(np.mean(left**2)), float(np.mean(at.std(covariance) ** 2)) / 3))
    assert 0.6 < np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(stated))) < 1.3
    off, std = np.mean(tips, axis=0)
    assert off < 1.5 * std


def test_a_grade_says_how_far_a_held_length_may_be_off() -> None:
    machined, printed = (solved("fixed_point", 0.0, grade)[0] for grade in ("machined", "printed"))
    stds = [s.estimates["joint_4.z"].std for s in (machined, printed)]
    assert stds[0] is not None
    assert stds[1] is not None
    assert 0.05e-3 < stds[0] < 0.5e-3
    assert 2e-3 < stds[1] < 6e-3


def test_what_knows_a_length_needs_no_held_one() -> None:
    """Offsets that stand for where the base is, and all lengths seen by an instrument."""
    arm = arm_of()
    truth = truth_of(arm) | {"joint_4.z": 0.572}
    for scene in (
        artefact_scene("pairwise_distance", arm, truth, artefact(8), placements(4), tilt=0.3),
        tracked_scene(arm, truth, 40),
    ):
        solution = solve(Problem([noisy(scene, 0)], unknowns(arm)), ONCE)
        held = solution.spread.held
        assert held is None or not held.matters
        assert [effect.what for effect in scale_effects(solution)] in (["artefact"], ["instrument"])
        names, covariance = solution.arm_covariance
        rows = [solution.problem.names.index(n) for n in names if n in solution.problem.names]
        plain = solution.covariance_within_scale[np.ix_(rows, rows)]
        q = solution.problem.terms[0].poses.samples.q
        tip = [
            float(np.mean(sensitivity(arm, solution.values, n, q).std(c) ** 2))
            for n, c in ((names, covariance), ([solution.problem.names[k] for k in rows], plain))
        ]
        assert tip[0] < 1.5 * tip[1]


def test_observe_says_before_measuring_what_will_carry_the_scale() -> None:
    arm = arm_of()
    term = fixed_point_scene(arm, truth_of(arm)).exact()
    found = observe(Problem([term], unknowns(arm)))
    assert found.assessment.level == "care"
    (note,) = found.assessment.notes
    assert "depend on joint_6.z, which keeps its URDF value and carries the scale" in note
    seen = tracked_scene(arm, truth_of(arm), 40).exact()
    assert observe(Problem([seen], unknowns(arm))).assessment.notes == ()
    # Somebody has said how good it is.
    graded = arm_of("machined")
    term = fixed_point_scene(graded, truth_of(graded)).exact()
    found = observe(Problem([term], unknowns(graded)))
    assert found.assessment.level == "good"
    assert "machined" in found.assessment.notes[0]
