"""A scale that is wrong by what is stated of it, in the standard deviations of what follows it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from offset_arm import ONCE
from simulated import (
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    perturbed,
    placements,
    plane_view_scene,
    points_scene,
    tracked_scene,
)

from suta_calib import Problem, Selection, solve
from suta_calib.measurements import LengthScale
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term
from suta_calib.terms.length_scale import lengthened
from suta_calib.trust.tip_motion import tip_motion

SCALE = LengthScale(2e-3)
TRIALS = 30


def measured(kind: str, factor: float, seed: int, scale: LengthScale = SCALE) -> Problem:
    """What was measured with something whose lengths are in truth so many times as long."""
    arm = arm_named("ur5")
    unknown = arm.select(Selection(("geometric",), bound_m=0.05, bound_rad=0.26))
    truth = perturbed(unknown, 0, 3e-4, 3e-3)
    random = np.random.default_rng(seed)
    if kind == "tracked_point":
        scene = tracked_scene(arm, truth, 40)
        samples = scene.samples()[0]
        assert samples.position is not None
        seen = samples.position + 1e-4 * random.standard_normal(samples.position.shape)
        term: Term = scene.term(replace(samples, position=seen / factor))
        return Problem([replace(term, scale=scale)], unknown)
    scene = artefact_scene(kind, arm, truth, artefact(8), placements(4), tilt=0.3)
    samples = scene.samples()[0]
    noisy = replace(samples, q=samples.q + 2e-4 * random.standard_normal(samples.q.shape))
    certified = replace(artefact(8), scale=scale)
    term = replace(scene, artefact=certified).term(noisy)
    return Problem([lengthened(term, 1.0 / factor)], unknown)


@pytest.mark.parametrize("kind", ["tracked_point", "pairwise_distance"])
def test_monte_carlo_with_the_scale_drawn_from_its_prior(kind: str) -> None:
    """Errors of lengths are as large as stated, and five times so without the scale's part."""
    factors = 1.0 + SCALE.std * np.random.default_rng(5).standard_normal(TRIALS)
    found = [solve(measured(kind, f, k), ONCE) for k, f in enumerate(factors)]
    names = found[0].problem.names
    at = [names.index(n) for n in ("elbow_joint.z", "wrist_1_joint.z")]
    truth = perturbed(found[0].problem.arm_parameters, 0, 3e-4, 3e-3)
    error = np.array([s.x[at] for s in found]) - [truth[names[k]] for k in at]
    stated, without = (
        np.mean([np.diag(c)[at] for c in every], axis=0)
        for every in (
            [s.covariance for s in found],
            [s.covariance_within_scale for s in found],
        )
    )
    assert np.all(np.sqrt(np.mean(error**2, axis=0) / stated) < 1.35)
    assert np.all(np.sqrt(np.mean(error**2, axis=0) / stated) > 0.7)
    assert np.all(np.mean(error**2, axis=0) / without > 9.0)


def test_the_derivative_is_that_of_a_solution_with_longer_lengths() -> None:
    before, after = (solve(measured("tracked_point", f, 3), ONCE) for f in (1.0, 1.0 + 1e-4))
    ((carrier, shift),) = before.spread.by_scale.items()
    assert carrier == ("instrument", "default")
    moved = before.x - after.x
    assert np.linalg.norm(moved - 1e-4 * shift) < 0.02 * np.linalg.norm(moved)


def test_the_tip_moves_with_the_whole_arm() -> None:
    """All lengths are free: a factor on what an instrument sees is a factor on the whole arm."""
    solution = solve(measured("tracked_point", 1.0, 3), ONCE)
    (shift,) = solution.spread.by_scale.values()
    problem = solution.problem
    moved = tip_motion(problem, solution.x, dict(zip(problem.names, shift.tolist(), strict=True)))
    across = moved.linear - moved.linear.mean(axis=0)
    expected = moved.position - moved.position.mean(axis=0)
    np.testing.assert_allclose(across, expected, atol=0.02 * np.abs(expected).max())


def test_an_exact_scale_adds_nothing() -> None:
    exact = solve(measured("tracked_point", 1.0, 3, LengthScale(0.0)), ONCE)
    np.testing.assert_array_equal(exact.covariance, exact.covariance_within_scale)
    assert solve(measured("tracked_point", 1.0, 3), ONCE).covariance.max() > exact.covariance.max()


def test_a_stretch_that_is_estimated_holds_the_scale_already() -> None:
    """Its prior is the grade's: ± would otherwise be larger by the root of two."""
    problem = measured("pairwise_distance", 1.0, 3)
    (term,) = problem.terms
    assert term.touched is not None
    bodies = [replace(term.touched, stretch=None), replace(term.touched, stretch=SCALE.std)]
    stds = []
    for body in bodies:
        changed: dict[str, Any] = {"artefact": body}
        again = solve(Problem([replace(term, **changed)], problem.arm_parameters), ONCE)
        std = again.arm_estimates["elbow_joint.z"].std
        assert std is not None
        stds.append(std)
    assert stds[1] < 1.15 * stds[0]


def _seen_by_a_held_arm(kind: str, factor: float, seed: int) -> tuple[np.ndarray, Solution]:
    """Errors of the camera's pose over their ±, of depths so many times as long, and the answer."""
    arm = arm_named("suta")
    make = points_scene if kind == "points" else plane_view_scene
    scene = make(arm, {n: p.nominal for n, p in arm.parameters.items()})
    samples = scene.samples(Spread(position=1e-3), seed=seed)[0]
    assert samples.position is not None
    term = scene.term(replace(samples, position=samples.position * factor))
    found = solve(Problem([term], ParameterSet()))
    true = scene.exact().start_values(scene.truth)
    names = [n for n in found.problem.names if n.startswith("hand_eye.")]
    over = [(found.values[n] - true[n]) / (found.estimates[n].std or np.inf) for n in names]
    return np.array(over), found


def test_where_the_arm_is_held_the_residuals_tell_the_scale() -> None:
    over, right = _seen_by_a_held_arm("points", 1.0, 0)
    (std,) = right.spread.scale_std.values()
    # Of 5,000 ppm that are stated of a depth camera.
    assert std < 1.2e-3
    assert np.abs(over).max() < 3.5
    over, long = _seen_by_a_held_arm("points", 1.003, 0)
    (std,) = long.spread.scale_std.values()
    assert std == pytest.approx(3e-3, rel=0.4)
    assert np.abs(over).max() < 3.5


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["points", "plane_view"])
@pytest.mark.parametrize("off", [0.0, 3e-3])
def test_monte_carlo_of_a_camera_on_an_arm_that_is_held(kind: str, off: float) -> None:
    found = [_seen_by_a_held_arm(kind, 1.0 + off, seed) for seed in range(40)]
    assert 0.8 < np.sqrt(np.mean([over**2 for over, _ in found])) < 1.25
    stated = [std for _, answer in found for std in answer.spread.scale_std.values()]
    assert np.mean(stated) < max(1.2 * off, 1.5e-3)
