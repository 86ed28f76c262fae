"""Noise and the size of priors, learned together: against arms whose errors are known."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulated import (
    Scene,
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

from suta_calib.arrays import FloatArray
from suta_calib.measurements import Samples
from suta_calib.model.parameters import ParameterSet, Selection
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.solver.weights import learn_weights, prior_groups
from suta_calib.terms import Noise
from suta_calib.terms.block import LEARNT

LENGTH, ANGLE, OFFSET = 1e-3, 2e-3, 2e-2
AS_GIVEN = SolverOptions(weights=None)
ARMS = 6
OTHER_HALF = ((0.3, 1e-4), (1.0, 1e-3), (3.0, 1e-4), (10.0, 1e-3))


def unknowns(times: float = 1.0, *, fixed: bool = False) -> ParameterSet:
    """All geometry, with priors that are so many times as wide as usual."""
    return arm_named("suta").select(
        Selection(("geometric",), prior_m=times * LENGTH, prior_rad=times * ANGLE, fixed=fixed),
        Selection(("*.offset",), prior_rad=times * OFFSET, fixed=fixed),
    )


def drawn(times: float, seed: int, lack: float = 0.0) -> dict[str, float]:
    """An arm that is off by so many times its priors, with eccentric encoders (rad) or without."""
    arm, random = arm_named("suta"), np.random.default_rng(seed)
    truth = {
        p.name: p.nominal + times * (p.prior or 0.0) * random.standard_normal()
        for p in unknowns().values()
    }
    names = [f"{joint}.{key}" for joint in arm.joints for key in ("ecc_c1", "ecc_s1")]
    return truth | {name: lack * random.standard_normal() for name in names if lack}


@cache
def scenes(times: float, seed: int, lack: float = 0.0) -> tuple[Scene, Scene]:
    """Postures to fit, and others that are held out."""
    whole = tracked_scene(arm_named("suta"), drawn(times, seed, lack), 80)
    parts = (slice(0, 30), slice(30, None))
    fitted, held_out = (
        replace(whole, q=whole.q[k], position=whole.position[k], rotation=whole.rotation[k])
        for k in parts
    )
    return fitted, held_out


def fitted(
    times: float,
    noise: float,
    seed: int,
    *,
    stated: Noise = LEARNT,
    lack: float = 0.0,
    outliers: float = 0.0,
    gross: float = 0.02,
    parameters: ParameterSet | None = None,
    options: SolverOptions = SolverOptions(),
) -> Solution:
    spread = Spread(position=noise, outliers=outliers, gross=gross)
    scene = scenes(times, seed, lack)[0]
    term = scene.term(scene.samples(spread, seed)[0], stated)
    return solve(Problem([term], parameters or unknowns()), options)


def held_out_error(solution: Solution, times: float, seed: int, lack: float = 0.0) -> float:
    """RMS of a coordinate of the tip at postures that were not fitted, m, without noise."""
    problem = Problem([scenes(times, seed, lack)[1].exact()], unknowns())
    x = np.array([solution.values[name] for name in problem.names])
    return float(np.sqrt(np.mean(problem.linearise(x, [1.0])[0].residual ** 2)))


@pytest.mark.parametrize(
    ("times", "noise"),
    [
        *((0.3, 1e-3), (1.0, 1e-4), (3.0, 1e-3), (10.0, 1e-4)),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in OTHER_HALF),
    ],
)
def test_what_was_learned_predicts_as_well_as_what_is_true(times: float, noise: float) -> None:
    """Half a millimetre is assumed, and priors that are wrong by ``times``."""
    learned, true, given = [], [], []
    for seed in range(ARMS):
        known = {"stated": Noise(noise), "parameters": unknowns(times), "options": AS_GIVEN}
        solutions = (
            fitted(times, noise, seed),
            fitted(times, noise, seed, **known),  # type: ignore[arg-type]
            fitted(times, noise, seed, options=AS_GIVEN),
        )
        for errors, solution in zip((learned, true, given), solutions, strict=True):
            errors.append(held_out_error(solution, times, seed))
    ratio = np.exp(np.mean(np.log(learned)) - np.mean(np.log(true)))
    assert ratio < 1.05
    assert np.mean(np.log(learned)) < np.mean(np.log(given)) + 0.02


def test_a_model_that_lacks_something_is_not_made_worse() -> None:
    """Eccentric encoders that nobody estimates: noise for the fit, and no licence to believe it."""
    ratios = []
    for seed in range(ARMS):
        found = [
            held_out_error(fitted(3.0, 1e-4, seed, lack=1e-3, options=options), 3.0, seed, 1e-3)
            for options in (SolverOptions(), AS_GIVEN)
        ]
        ratios.append(found[0] / found[1])
    assert np.exp(np.mean(np.log(ratios))) < 1.02


@pytest.mark.parametrize("outliers", [0.0, 0.1])
def test_what_is_said_of_the_weights_is_true(outliers: float) -> None:
    """Errors of the logarithms over their standard deviations; six arms scatter by 0.3."""
    noise, huber = 3e-4, 5e-4 if outliers else math.inf
    of_noise, of_priors = [], []
    for seed in range(ARMS):
        weights = fitted(3.0, noise, seed, stated=Noise(huber=huber), outliers=outliers).weights
        assert weights is not None
        (level,) = weights.noise
        of_noise.append(math.log(level.value / noise) / level.log_std)
        of_priors += [math.log(f.value / 3.0) / f.log_std for f in weights.priors.values()]
    assert np.sqrt(np.mean(np.square(of_noise))) < 1.9
    assert np.sqrt(np.mean(np.square(of_priors))) < 1.9


def test_parameters_scatter_as_predicted_where_weights_are_learned() -> None:
    """Arms drawn from their priors, not one arm measured again: what Bayes promises."""
    errors = []
    for seed in range(2 * ARMS):
        solution = fitted(3.0, 3e-4, seed)
        truth = drawn(3.0, seed)
        errors += [
            (e.value - truth[name]) / e.std for name, e in solution.arm_estimates.items() if e.std
        ]
    # Some 25 directions of each arm are told, the others are as wide as what is learned of priors.
    assert 0.85 < np.sqrt(np.mean(np.square(errors))) < 1.15


def test_of_what_no_data_tell_no_more_is_known_than_was_said() -> None:
    """An arm that is far better than its priors, but for where it stands: as wrong as they say."""
    untold, factors = [], []
    for seed in range(2 * ARMS):
        elsewhere = {k: v for k, v in drawn(1.0, 100 + seed).items() if k.startswith("joint_1.")}
        truth = drawn(0.2, seed) | elsewhere
        scene = tracked_scene(arm_named("suta"), truth, 30)
        term = scene.term(scene.samples(Spread(position=3e-4), seed)[0], LEARNT)
        solution = solve(Problem([term], unknowns()), SolverOptions())
        assert solution.weights is not None
        factors += [learned.value for learned in solution.weights.priors.values()]
        found = solution.arm_estimates
        untold += [
            (found[name].value - truth[name]) / (found[name].std or math.nan) for name in elsewhere
        ]
    assert max(factors) < 0.5
    assert 0.8 < np.sqrt(np.mean(np.square(untold))) < 1.2


def test_what_is_fixed_stays() -> None:
    stated = Noise(5e-4, fixed=True)
    parameters = unknowns(fixed=True)
    solution = fitted(3.0, 1e-4, 0, stated=stated, parameters=parameters)
    alone = fitted(3.0, 1e-4, 0, stated=stated, parameters=parameters, options=AS_GIVEN)
    assert solution.weights is not None
    assert solution.weights.priors == {}
    (level,) = solution.weights.noise
    assert level.value == pytest.approx(5e-4, rel=1e-3)
    assert (level.log_std, level.contradicted) == (0.0, False)
    np.testing.assert_allclose(solution.x, alone.x, atol=1e-6)


def test_contradictions_are_told_and_agreement_is_not() -> None:
    right = fitted(1.0, 5e-4, 1, stated=Noise(5e-4)).weights
    wrong = fitted(10.0, 5e-4, 1, stated=Noise(1e-5)).weights
    assert right is not None
    assert wrong is not None
    assert not any(f.contradicted for f in (*right.noise, *right.priors.values()))
    assert all(f.contradicted for f in (*wrong.noise, *wrong.priors.values()))
    assert right.noise[0].interval[0] < 5e-4 < right.noise[0].interval[1]


def test_a_threshold_follows_the_noise_down_but_neither_up_nor_where_it_stays() -> None:
    noise, size = 1e-4, 3
    efficient = huber_threshold(size)

    def threshold(stated: Noise) -> tuple[float, float]:
        weights = fitted(1.0, noise, 0, stated=stated).weights
        assert weights is not None
        return weights.thresholds[0], weights.noise[0].value

    found, learned = threshold(Noise(huber=20 * noise))
    assert found == pytest.approx(efficient * learned)
    assert learned == pytest.approx(noise, rel=0.25)
    assert threshold(Noise(huber=0.5 * noise))[0] == 0.5 * noise
    assert threshold(Noise(noise, 20 * noise, fixed=True))[0] == 20 * noise
    assert threshold(LEARNT)[0] == math.inf


def test_a_threshold_that_is_given_too_wide_does_no_harm() -> None:
    """A tenth of the rows is eight times as far off as the others, and within the threshold."""
    noise, errors = 1e-4, {}
    for name, huber in (("wide", 40 * noise), ("right", 2 * noise), ("none", math.inf)):
        solutions = [
            fitted(1.0, noise, seed, stated=Noise(huber=huber), outliers=0.1, gross=8 * noise)
            for seed in range(ARMS)
        ]
        errors[name] = [held_out_error(each, 1.0, seed) for seed, each in enumerate(solutions)]
    wide, right, none = (np.exp(np.mean(np.log(errors[k]))) for k in ("wide", "right", "none"))
    assert wide < 1.05 * right
    assert wide < 0.8 * none


def test_groups_are_lengths_angles_offsets_and_the_tip() -> None:
    arm = arm_named("suta")
    parameters = arm.select(
        Selection(("geometric", "*.offset"), prior_m=LENGTH, prior_rad=ANGLE),
        Selection(("joint_1.ecc_c1",), prior_rad=ANGLE),
        Selection(("joint_2.z",), prior_m=LENGTH, fixed=True),
        Selection(("joint_2.y",), bound_m=LENGTH),
    )
    problem = Problem([tracked_scene(arm, {}).exact()], parameters)
    found = dict(zip(problem.names, prior_groups(problem), strict=True))
    assert found["joint_3.z"] == "lengths"
    assert found["joint_3.rx"] == "angles"
    assert found["joint_3.offset"] == "offsets"
    assert found["tip.x"] == found["tip.rz"] == "tip"
    assert found["joint_1.ecc_c1"] == "eccentricities"
    assert found["joint_2.z"] is found["joint_2.y"] is found["base.x"] is None


def test_two_kinds_weigh_as_they_scatter() -> None:
    """Seats ten times as loose as the point, and nobody says so: as good as if it were known."""
    arm = arm_named("suta")
    parameters = arm.select(Selection(("joint_*.offset",), bound_rad=0.2))
    truth = perturbed(parameters, seed=1)
    seats = artefact_scene("landmark", arm, truth, artefact(6), placements(2))
    point = fixed_point_scene(arm, truth, directions=10)
    off: dict[str, list[float]] = {"learned": [], "known": [], "given": []}
    trials = 12
    for a, b in zip(
        seats.samples(Spread(1e-3), 1, trials), point.samples(Spread(1e-4), 2, trials), strict=True
    ):
        known = [seats.term(a, Noise(1e-3)), point.term(b, Noise(1e-4))]
        unsaid = [seats.term(a), point.term(b)]
        for how, terms, options in (
            ("learned", unsaid, SolverOptions()),
            ("known", known, AS_GIVEN),
            ("given", unsaid, AS_GIVEN),
        ):
            solution = solve(Problem(terms, parameters), options)
            told = [e for e in solution.arm_estimates.values() if e.std]
            off[how].append(float(np.mean([(e.value - truth[e.name]) ** 2 for e in told])))
    assert np.mean(off["learned"]) < 1.1 * np.mean(off["known"])
    assert np.mean(off["learned"]) < 0.7 * np.mean(off["given"])


def test_readings_of_one_rest_are_one_cluster() -> None:
    """What the model lacks is the same in all of them, however often they are read."""
    arm = arm_named("suta")
    truth = perturbed(dh_parameters(arm), seed=1)
    scene = artefact_scene("landmark", arm, truth, artefact(6), placements(3))
    parameters = dh_parameters(arm)
    (once,) = scene.samples(Spread(3e-4), 1)
    random = np.random.default_rng(0)
    times = 10

    def read(q: FloatArray, repeat: list[str]) -> Solution:
        labels = {
            key: np.tile(once.labels[key], len(q) // len(once)) for key in ("placement", "landmark")
        }
        samples = Samples.from_arrays(arm.joints, q, labels=labels | {"repeat": repeat})
        priors = arm.select(Selection(parameters.names, prior_m=LENGTH, prior_rad=OFFSET))
        return solve(Problem([scene.term(samples)], priors))

    q = np.tile(once.q, (times, 1))
    jitter = q + 1e-6 * random.standard_normal(q.shape)
    often = read(jitter, [str(k) for k in range(times) for _ in range(len(once))])
    single = read(once.q, ["0"] * len(once))
    assert often.sigmas[0] / math.sqrt(times) == pytest.approx(single.sigmas[0], rel=0.05)
    std = np.array([e.std for e in single.arm_estimates.values()])
    off = np.array([e.value for e in often.arm_estimates.values()]) - [
        e.value for e in single.arm_estimates.values()
    ]
    assert np.all(np.abs(off) < 0.05 * std)


def test_one_linearisation_is_enough() -> None:
    """Learned again at the new minimum: the same."""
    solution = fitted(10.0, 1e-4, 0)
    weights = solution.weights
    assert weights is not None
    (term,) = solution.problem.terms
    given = Problem([term], unknowns())
    again = learn_weights(
        given.with_priors_scaled(np.ones(len(solution.x))),
        solution.x,
        solution.sigmas,
        solution.free,
    )
    assert again.noise[0].value == pytest.approx(weights.noise[0].value, rel=0.05)
    for group, factor in weights.priors.items():
        assert again.priors[group].value == pytest.approx(factor.value, rel=0.05)


def test_without_noise_nothing_explodes() -> None:
    solution = fitted(1.0, 0.0, 0)
    assert solution.converged
    assert held_out_error(solution, 1.0, 0) < 1e-5
    assert np.isfinite(solution.covariance).all()
