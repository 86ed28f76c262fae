"""The planner's mathematics: information adds up, exchange finds the best set, gauges drop out."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from offset_arm import ONCE, truth_of
from simulated import (
    ARMS,
    SUTA_URDF,
    arm_named,
    artefact,
    artefact_scene,
    dh_parameters,
    fixed_point_scene,
    perturbed,
    placements,
    random_readings,
)

from suta_calib import Selection, solve
from suta_calib.analysis.planning import Candidate, Placement, Situation, TouchPoint
from suta_calib.analysis.planning.design import (
    Design,
    SharedInformation,
    SharedUnknowns,
    best_set,
    candidate_information,
    greedy,
    no_information,
    ordered,
    present_information,
)
from suta_calib.analysis.planning.reach import Collisions
from suta_calib.analysis.planning.region import _first
from suta_calib.arrays import FloatArray
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.solver.covariance import predicted_covariance
from suta_calib.solver.information import predicted_information
from suta_calib.solver.problem import Problem

ARM = arm_named("suta")
TRUTH = perturbed(dh_parameters(ARM), 1)
WHERE = placements(3)
MARKS = artefact(6, oriented=True)


def situation(kind: str = "pairwise_distance", *, points: bool = False) -> Situation:
    """Exact simulated samples of three placements, and of two points if asked for."""
    terms = [artefact_scene(kind, ARM, TRUTH, MARKS, WHERE).exact()]
    if points:
        terms.append(fixed_point_scene(ARM, TRUTH, directions=10).exact())
    problem = Problem(terms, dh_parameters(ARM))
    sigmas = tuple([0.3e-3 if b.unit == "m" else 1e-3 for b in problem.blocks])
    return Situation(problem, problem.start(TRUTH), sigmas, True)


def as_candidates(found: Situation) -> list[Candidate]:
    """The present samples, place by place, as if they were yet to be taken."""
    made = []
    for term in found.problem.terms:
        labels = term.poses.samples.labels
        column = labels["placement"] if "placement" in labels else labels["point"]
        for name in dict.fromkeys(map(str, column)):
            rows = column == name
            q = term.poses.samples.q[rows]
            place = Placement(name, np.zeros(3), np.eye(3))
            marks = tuple(map(str, labels["landmark"][rows])) if "landmark" in labels else ()
            if not marks:
                place = TouchPoint(name, np.zeros(3), len(q), np.array([0, 0, -1.0]), 1.0)
            made.append(Candidate(place, q, marks, 1))
    return made


@pytest.mark.parametrize("kind", ["pairwise_distance", "landmark"])
def test_information_of_different_places_adds_up(kind: str) -> None:
    found = situation(kind, points=True)
    space = SharedUnknowns.of(found)
    whole = present_information(found, space)
    parts = sum(
        (candidate_information(found, space, c) for c in as_candidates(found)),
        no_information(space),
    )
    for name in ("curvature", "variance"):
        a, b = getattr(whole, name), getattr(parts, name)
        np.testing.assert_allclose(b, a, rtol=1e-6, atol=1e-6 * np.abs(a).max())


def test_covariance_is_the_solvers_with_the_terms_own_unknowns_followed() -> None:
    found = situation(points=True)
    space = SharedUnknowns.of(found)
    information = present_information(found, space)
    fixed = {int(k) for k in space.identify(information).fixed}
    arm = np.array([k for k in range(space.arm_count) if k not in fixed], dtype=np.intp)
    problem = found.problem
    own = np.arange(problem.arm_count, len(problem.names))
    predicted = predicted_information(problem, found.x, found.sigmas)
    whole = predicted_covariance(problem, predicted, np.concatenate([arm, own]))
    mine = space.covariance(information, arm)
    unit = np.sqrt(np.diag(whole)[arm])
    scaled = (mine[np.ix_(arm, arm)] - whole[np.ix_(arm, arm)]) / np.outer(unit, unit)
    assert np.abs(scaled).max() < 1e-6


def test_repeats_are_independent() -> None:
    found = situation()
    space = SharedUnknowns.of(found)
    (once, *_) = as_candidates(found)
    thrice = Candidate(once.place, once.q, once.marks, 3)
    a, b = (candidate_information(found, space, c) for c in (once, thrice))
    np.testing.assert_allclose(b.curvature, 3 * a.curvature)
    np.testing.assert_allclose(b.variance, 3 * a.variance)


def random_design(
    criterion: str, count: int = 9
) -> tuple[Design, SharedUnknowns, SharedInformation]:
    """Candidates with random information on the thirteen parameters."""
    space = SharedUnknowns.of(situation())
    rng = np.random.default_rng(5)
    information = []
    for _ in range(count):
        rows = rng.standard_normal((6, 13)) * rng.uniform(1, 60, 13)
        spread = rows.T @ np.diag(rng.uniform(0.5, 2.0, 6)) @ rows
        information.append(SharedInformation(rows.T @ rows, spread, 0 * spread))
    lever, none = rng.standard_normal((20, 13)), no_information(space)
    return Design.over(space, information, lever.T @ lever / 20, criterion, none), space, none


@pytest.mark.parametrize("criterion", ["tip", "d"])
def test_exchange_finds_the_best_of_all_sets(criterion: str) -> None:
    design, _, start = random_design(criterion)
    values = {s: design.value(start, s) for s in combinations(range(len(design)), 4)}
    best = min(values, key=lambda s: values[s])
    found = best_set(design, start, 4)
    assert len(set(found)) == 4
    assert design.value(start, found) <= design.value(start, greedy(design, start, 4)) + 1e-12
    assert design.value(start, found) == pytest.approx(values[best], rel=0.01)
    assert set(ordered(design, start, found)) == set(found)


@pytest.mark.parametrize("criterion", ["tip", "d"])
@pytest.mark.parametrize("chosen", [[], [4], [0, 3, 7]])
def test_the_next_one_is_the_best_of_all_computed_in_full(
    criterion: str, chosen: list[int]
) -> None:
    design, _, start = random_design(criterion)
    values = {k: design.value(start, [*chosen, k]) for k in range(9) if k not in chosen}
    best = min(values, key=lambda k: values[k])
    assert design.best_next(start, chosen) == (best, pytest.approx(values[best], rel=1e-10))


def test_values_are_those_of_the_covariance_written_out() -> None:
    design, space, start = random_design("tip")
    back = np.linalg.inv(design.basis)
    curvature, variance, weight = (
        back.T @ m @ back for m in (design.curvature[2], design.variance[2], design.weight)
    )
    covariance = space.plausible_covariance(
        start + SharedInformation(curvature, variance, 0 * variance)
    )
    unit = space.unit
    expected = np.trace(weight / np.outer(unit, unit) @ covariance) + design.unestimated
    assert design.tip(start, [2]) == pytest.approx(np.sqrt(expected), rel=1e-9)


def test_directions_nothing_tells_are_kept_in_the_tips_uncertainty() -> None:
    space, known = SharedUnknowns.of(situation()), np.diag([1e4] * 12 + [0.0])
    weight, none = np.diag([0.0] * 12 + [1.0]), no_information(space)
    information = [SharedInformation(known, known, 0 * known)]
    design = Design.over(space, information, weight, "tip", none)
    assert design.tip(none, [0]) == pytest.approx(space.unit[12])


@pytest.mark.parametrize("name", ARMS)
def test_links_end_at_the_tip_whatever_the_joints(name: str) -> None:
    arm = arm_named(name)
    q = random_readings(arm, np.random.default_rng(0), 4)
    for row in q:
        points = arm.skeleton(row).points
        assert points.shape == (len(arm.joints) + 2, 3)
        np.testing.assert_allclose(points[-1], arm.forward(row)[1])
    collisions = Collisions.of(arm, q)
    assert "shapes" in collisions.note
    assert collisions.free(q).all(), "a visited posture does not collide"


def test_some_postures_collide_and_a_visited_posture_does_not() -> None:
    visited = situation().readings
    collisions = Collisions.of(ARM, visited)
    assert "visual shapes" in collisions.note
    assert collisions.free(visited).all()
    rng = np.random.default_rng(0)
    anywhere = rng.uniform(-np.pi, np.pi, (300, 6))
    hit = ~collisions.free(anywhere)
    assert 0 < hit.sum() < 300


def test_without_shapes_nothing_is_checked_and_that_is_said(tmp_path: Path) -> None:
    text = SUTA_URDF.read_text(encoding="utf-8")
    bare = tmp_path / "arm.urdf"
    parts = text.split("<visual>")
    bare.write_text(parts[0] + "".join(p.split("</visual>", 1)[1] for p in parts[1:]))
    collisions = Collisions.of(ArmModel.from_urdf(bare, "tip"), np.zeros((1, 6)))
    assert collisions.note == "collisions not checked: the URDF has no shapes"
    assert collisions.free(np.zeros((2, 6))).all()


def test_no_more_readings_are_looked_at_than_it_takes() -> None:
    rows, looked_at = np.arange(10_000.0)[:, None], []

    def every_tenth(some: np.ndarray) -> np.ndarray:
        looked_at.append(len(some))
        return some[:, 0] % 10 == 0

    assert _first(rows, every_tenth, 150)[:, 0].tolist() == list(range(0, 1500, 10))
    assert sum(looked_at) < 2500
    assert len(_first(rows, every_tenth, 2000)) == 1000
    assert len(_first(rows[:0], every_tenth, 5)) == 0


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
