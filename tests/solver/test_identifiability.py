"""What is held, why, and what it is said to move together with."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.linalg import subspace_angles
from simulated import (
    DH_LENGTHS,
    Scene,
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    dh_parameters,
    fixed_point_scene,
    perturbed,
    placements,
    random_readings,
    tracked_scene,
)
from studies import first_of

from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Artefact, Landmark, Samples
from suta_calib.model.parameters import ParameterSet, Selection
from suta_calib.solver import problem as problem_module
from suta_calib.solver.identifiability import Identification
from suta_calib.solver.information import predicted_information, whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import identify_at, solve
from suta_calib.terms import FixedPoint, Noise, PoseNoise
from suta_calib.trust.accuracy import assess
from suta_calib.units import from_deg, from_mm

HIDDEN = {"joint_1.offset", "joint_2.z", "tip.y"}
SEATING = Spread(position=1e-4)
TILTED = Spread(position=1e-4, rotation=math.radians(0.1))


@cache
def pillars(tilt: float = 0.0) -> Scene:
    """Fifteen pillars, all parallel unless tilted (rad), at five placements, twice each."""
    arm = arm_named("suta")
    truth = perturbed(dh_parameters(arm), seed=1)
    certified = artefact(15)
    where = placements(5)
    return artefact_scene("pairwise_distance", arm, truth, certified, where, 2, tilt=tilt)


@cache
def one_point(cone: float = 1.0) -> Scene:
    scene = pillars()
    return fixed_point_scene(scene.arm, scene.truth, cone=cone)


def with_encoder_noise(samples: Samples, sigma: float) -> Samples:
    noise = sigma * np.random.default_rng(3).standard_normal(samples.q.shape)
    return Samples.from_arrays(samples.joints, samples.q + noise, labels=samples.labels)


def suta_problem(*parts: tuple[Scene, Samples], parameters: ParameterSet | None = None) -> Problem:
    arm = arm_named("suta")
    terms = [scene.term(samples) for scene, samples in parts]
    return Problem(terms, parameters or dh_parameters(arm))


def test_parallel_pillars_hide_three_of_the_thirteen() -> None:
    problem = suta_problem((pillars(), pillars().samples()[0]))
    assert problem.arm_count == 13
    solution = solve(problem)
    assert set(solution.unidentified) == HIDDEN
    assert len(solution.free) == 10
    assert all(c.alone for c in solution.identification.combinations)


@pytest.mark.parametrize("seed", first_of(range(5)))
@pytest.mark.parametrize("noise", ["seating", "seating and tilt", "encoders", "all"])
def test_noise_does_not_feign_knowledge(noise: str, seed: int) -> None:
    """Tilt makes tip.y look determined: rank says thirteen less two, the truth is less three."""
    spread = TILTED if noise in ("seating and tilt", "all") else SEATING
    spread = Spread() if noise == "encoders" else spread
    samples = pillars().samples(spread, seed)[0]
    if noise in ("encoders", "all"):
        samples = with_encoder_noise(samples, 1e-4)
    solution = solve(suta_problem((pillars(), samples)))
    assert set(solution.unidentified) == HIDDEN
    if noise != "seating":
        singular = solution.identification.singular_values
        assert np.sum(singular > 1e-6 * singular[0]) == 11


def test_pillars_that_lean_tell_the_tools_length() -> None:
    scene = pillars(tilt=0.4)
    samples = scene.samples(SEATING)[0]
    solution = solve(suta_problem((scene, samples)))
    assert set(solution.unidentified) == HIDDEN - {"tip.y"}


@pytest.mark.parametrize("spread", [Spread(), SEATING, TILTED], ids=["exact", "seating", "tilt"])
def test_a_fixed_point_tells_the_tools_length(spread: Spread) -> None:
    point = one_point()
    problem = suta_problem(
        (pillars(), pillars().samples(spread, 1)[0]), (point, point.samples(spread, 2)[0])
    )
    solution = solve(problem)
    assert set(solution.unidentified) == HIDDEN - {"tip.y"}
    tool = solution.estimates["tip.y"]
    assert tool.state == "identified"
    assert tool.std is not None
    assert abs(tool.value - pillars().truth["tip.y"]) < 5 * tool.std + 1e-9


def test_a_fixed_point_alone_leaves_the_scale_free() -> None:
    """The combination is the arm's lengths themselves."""
    point = one_point()
    solution = solve(suta_problem((point, point.samples()[0])))
    (scale,) = [c for c in solution.identification.combinations if not c.alone]
    lengths = {"joint_3.z", "joint_4.z", "joint_5.z", "joint_6.z", "tip.y", "tip.z"}
    assert set(scale.direction) == lengths
    for name, change in scale.direction.items():
        expected = solution.values[name] / solution.values[scale.fixed]
        assert change == pytest.approx(expected, abs=1e-6)
        others = solution.estimates[name].given
        assert (scale.fixed in others) == (name != scale.fixed)


def panda_scene(kind: str, truth: dict[str, float], seed: int) -> Scene:
    """Random readings seen by one instrument, or landmarks certified where the tip then was."""
    arm = arm_named("panda")
    q = random_readings(arm, np.random.default_rng(seed), 40)
    rotation, position = arm.forward(q, truth)
    R, p = rotation_from_vector([0.3, -1.2, 0.7]), np.array([1.1, -0.4, 0.6])
    seen = position @ R.T + p
    if kind == "tracked_point":
        return Scene(kind, arm, truth, q, False, seen, rotation, {}, ("position",))
    names = [f"L{k}" for k in range(len(q))]
    certified = Artefact(
        "simulated", {n: Landmark(n, at) for n, at in zip(names, seen, strict=True)}
    )
    labels = {"placement": ["P1"] * len(q), "repeat": ["1"] * len(q), "landmark": names}
    return Scene(kind, arm, truth, q, True, position, rotation, labels, (), certified)


def null_space(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Null directions of the dense Jacobian by the arm's parameters, the own ones eliminated."""
    rows = whitened_rows(problem, x, problem.assumed_sigmas())
    unit = problem.parameters.array("plausible")
    jacobian = np.vstack([r.jacobian for r in rows]) * unit
    arm, own = jacobian[:, : problem.arm_count], jacobian[:, problem.arm_count :]
    if own.size:
        basis, singular, _ = np.linalg.svd(own, full_matrices=False)
        basis = basis[:, singular > 1e-9 * singular[0]]
        arm = arm - basis @ (basis.T @ arm)
    _, singular, rows_of_v = np.linalg.svd(arm)
    gaps = singular[:-1] / np.maximum(singular[1:], 1e-300)
    small = singular < 1e-9 * singular[0]
    assert small.any()
    rank = int(np.argmax(small))
    assert gaps[rank - 1] >= 1e6
    return rows_of_v[rank:].T


def reported(solution_or: Identification, problem: Problem) -> np.ndarray:
    """The combinations over the arm as columns, in plausible units."""
    names = problem.names[: problem.arm_count]
    unit = problem.parameters.array("plausible")[: problem.arm_count]
    columns = [
        [c.direction.get(name, 0.0) for name in names]
        for c in solution_or.combinations
        if c.fixed in names
    ]
    return np.array(columns).T / unit[:, None]


@pytest.mark.parametrize("kind", ["tracked_point", "pairwise_distance"])
def test_all_of_a_seven_joint_arm(kind: str) -> None:
    """Everything asked for at once: the fewest are held, and nothing that matters is lost."""
    arm = arm_named("panda")
    parameters = arm.select("geometric", "*.offset")
    truth = perturbed(parameters, seed=4, length=1e-3, angle=5e-3)
    scene = panda_scene(kind, truth, seed=0)
    problem = Problem([scene.exact(Noise(1e-4))], parameters)
    solution = solve(problem)
    assert solution.converged

    x = problem.start()
    verdict_at_nominal = identify_at(problem, x, problem.assumed_sigmas())
    angles = subspace_angles(reported(verdict_at_nominal, problem), null_space(problem, x))
    assert np.max(angles) < 1e-6
    true_null = null_space(problem, solution.x)
    found = reported(solution.identification, problem)
    assert found.shape == true_null.shape
    # At the solution a combination leaves out what is too small to matter.
    assert np.max(subspace_angles(found, true_null)) < 1e-3

    held_out = panda_scene(kind, truth, seed=9).exact(Noise(1e-4))
    accuracy = assess(solution, [held_out])
    assert accuracy.validation[0].before.maximum > 1e-3
    assert accuracy.validation[0].after.maximum < 1e-9


def test_sliding_a_frame_along_its_own_axis_is_a_combination() -> None:
    """Not one of the two is undetermined: only their difference is."""
    arm = arm_named("suta")
    parameters = arm.select("joint_*.offset", "joint_3.x", "joint_3.y", "joint_4.x", "joint_4.z")
    truth = perturbed(parameters, seed=1)
    scene = tracked_scene(arm, truth)
    solution = solve(Problem([scene.exact()], parameters))
    together = [set(c.direction) for c in solution.identification.combinations if not c.alone]
    assert {"joint_3.y", "joint_4.z"} in together
    fixed = {"joint_3.y", "joint_4.z"} & set(solution.unidentified)
    assert len(fixed) == 1
    (other,) = {"joint_3.y", "joint_4.z"} - fixed
    assert solution.estimates[other].given == tuple(fixed)


def test_what_has_a_prior_is_never_held() -> None:
    arm = arm_named("suta")
    rows = [Selection((n,), prior_m=1e-3, fixed=True) for n in ("joint_2.z", "tip.y")]
    rows += [Selection(("joint_1.offset",), prior_rad=0.02, fixed=True)]
    told = [name for name in DH_LENGTHS if name not in HIDDEN]
    parameters = arm.select("joint_*.offset", *told, *rows)
    scene = pillars()
    solution = solve(suta_problem((scene, scene.samples(TILTED)[0]), parameters=parameters))
    assert solution.unidentified == ()
    for name in HIDDEN:
        estimate, prior = solution.estimates[name], parameters[name].prior
        assert estimate.state == "prior"
        assert estimate.std == pytest.approx(prior, rel=0.05)
        # Tilt noise that feigns knowledge of the tool's length is outweighed by the prior.
        assert abs(estimate.value - estimate.nominal) < 0.3 * prior


def test_the_verdict_comes_before_any_solving(suta_urdf: object) -> None:
    problem = suta_problem((pillars(), pillars().samples(SEATING)[0]))
    found = identify_at(problem, problem.start(), problem.assumed_sigmas())
    assert {problem.names[k] for k in found.fixed} == HIDDEN
    assert len(found.singular_values) == 13
    assert np.all(np.diff(found.singular_values) <= 0)


def test_parameters_that_are_not_asked_for_stay_fixed() -> None:
    arm = arm_named("suta")
    fixed = Selection(("joint_4.z",), fixed=True)
    parameters = arm.select("joint_*.offset", "joint_6.z", fixed)
    scene = pillars()
    solution: Solution = solve(suta_problem((scene, scene.samples()[0]), parameters=parameters))
    assert solution.estimates["joint_4.z"].state == "fixed"
    assert solution.values["joint_4.z"] == arm.parameters["joint_4.z"].nominal
    assert "joint_4.z" not in solution.unidentified


def test_of_very_many_samples_a_part_tells_what_noise_makes_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    noise = PoseNoise(from_mm(0.3), from_deg(0.1))
    data = FixedPoint.simulate(6_000, spread=noise, seed=0)
    found = {}
    for enough in (2_000, 6_000):
        monkeypatch.setattr(problem_module, "ENOUGH", enough)
        problem = Problem([data.term])
        assert (problem.part is None) == (enough == 6_000)
        x = problem.start()
        found[enough] = predicted_information(problem, x, [noise.position], robust=True)
    part, whole = (np.diag(each.noise_induced) for each in found.values())
    assert np.all(whole[3:] > 0.0)  # where the post is, turns tell; the tip they leave alone
    np.testing.assert_allclose(part, whole, rtol=0.08)
    np.testing.assert_array_equal(found[2_000].curvature, found[6_000].curvature)


def test_a_part_has_the_unknowns_of_all_or_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(problem_module, "ENOUGH", 10)
    posts = np.random.default_rng(0).normal(size=(12, 3))
    data = FixedPoint.simulate(48, posts=posts, seed=0)
    assert Problem([data.term]).part is None
