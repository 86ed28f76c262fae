"""Is an error beside geometry found where there is one, and left alone where there is none?"""

from __future__ import annotations

import math

import numpy as np
import pytest
from refitted_folds import cross_validate
from simulated import Spread, arm_named, artefact, artefact_scene, placements, tracked_scene
from suta_simulated import everything, scene, thirteen

from suta_calib.analysis.model_selection import ModelSelection, choose_model
from suta_calib.errors import ParameterError, SamplesError
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import HandEye, Noise, Term
from suta_calib.trust.accuracy import assess
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.cross_validation import folds_of, limited_rms
from suta_calib.trust.linearised import LinearModels

ECCENTRIC = "{select: [joint_3.ecc_c1], value_deg: 0.2}"


def chosen(
    seed: int, errors: str = "", *, bent: bool = False, families: bool = False
) -> ModelSelection:
    found = scene(seed, errors, bent=bent)
    return choose_model([found.term("calibration")], thirteen(found.arm), families=families)


def held_out(choice: ModelSelection, seed: int, errors: str, *, bent: bool = False) -> float:
    """RMS on the validation data over that of the true arm."""
    found = scene(seed, errors, bent=bent)
    accuracy = assess(choice.solution, [found.term("validation")])
    return limited_rms(accuracy.validation) / found.floor()


@pytest.mark.slow
def test_an_eccentric_encoder_is_found_and_held_out_errors_fall_to_the_floor() -> None:
    """`tests/cli/test_nongeometric.py` has it in little."""
    choice = chosen(0, ECCENTRIC)
    assert choice.added == ("joint_3.ecc_c1", "joint_3.ecc_s1")
    e = choice.solution.estimates["joint_3.ecc_c1"]
    assert e.value == pytest.approx(math.radians(0.2), abs=4 * (e.std or 0))
    assert held_out(choice, 0, ECCENTRIC) < 1.1
    assert not choice.undecided


@pytest.mark.slow
def test_it_is_found_beside_geometry_that_is_off_too() -> None:
    choice = chosen(3, ECCENTRIC, bent=True)
    assert choice.added == ("joint_3.ecc_c1", "joint_3.ecc_s1")
    assert choice.chosen.geometry
    assert held_out(choice, 3, ECCENTRIC, bent=True) < 1.1
    assert choice.rows[0].select == ("geometric",)


def test_bent_joints_are_geometry() -> None:
    choice = chosen(0, bent=True)
    assert not choice.added
    assert choice.chosen.geometry
    assert choice.chosen.name == "all of the geometry"


def test_more_unknowns_fit_better_and_predict_worse() -> None:
    choice = chosen(1, families=True)
    most = max((c for c in choice.tried if not c.geometry), key=lambda c: len(c.parameters))
    assert most.name == "harmonics and compliance, all joints"
    assert most.fitted < choice.job.fitted + 2e-6
    assert most.held_out.loss > choice.job.held_out.loss
    # Nothing is added where there is nothing.
    assert choice.chosen is choice.job
    assert not choice.rows


def tracked(truth: dict[str, float], count: int) -> Term:
    """What an instrument with a tenth of a millimetre of noise sees of an arm with these errors."""
    seen = tracked_scene(arm_named("suta"), truth, count)
    return seen.term(seen.samples(Spread(position=1e-4), seed=1)[0])


@pytest.mark.parametrize(
    ("name", "size", "bound"),
    [("joint_2.compliance", math.radians(0.05), None), ("joint_3.gain", 2e-3, 0.05)],
)
def test_a_yielding_joint_and_a_wrong_scale_are_found(
    name: str, size: float, bound: float | None
) -> None:
    unknown = arm_named("suta").select("joint_*.offset", "joint_4.z")
    choice = choose_model([tracked({name: size}, 80)], unknown, families=False)
    assert choice.added == (name,)
    e = choice.solution.estimates[name]
    assert e.value == pytest.approx(size, abs=4 * (e.std or 0))
    (row,) = choice.rows
    assert (row.select, row.bound_ratio) == ((name,), bound)


@pytest.mark.slow
@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize(("families", "seeds"), [(False, 100), (True, 30)])
def test_it_is_not_chosen_without_cause_in_95_per_cent_of_seeds(
    bent: bool, families: bool, seeds: int
) -> None:
    wrong = [s for s in range(seeds) if chosen(s, bent=bent, families=families).added]
    assert len(wrong) <= 0.05 * seeds


def test_what_a_fit_cannot_tell_does_not_stand_in_the_way_of_what_it_can() -> None:
    """A compliance that five placements hardly see seems as good, being the smaller model."""
    choice = chosen(17, ECCENTRIC, bent=True)
    assert choice.added == ("joint_3.ecc_c1", "joint_3.ecc_s1")
    assert all(choice.solution.estimates[name].std is not None for name in choice.added)
    assert len({c.name for c in choice.tried}) == len(choice.tried)


@pytest.mark.slow
@pytest.mark.parametrize("bent", [False, True])
def test_it_is_found_in_most_of_twenty_seeds(bent: bool) -> None:
    choices = {seed: chosen(seed, ECCENTRIC, bent=bent) for seed in range(20)}
    ratios = [held_out(c, seed, ECCENTRIC, bent=bent) for seed, c in choices.items()]
    assert sum(any("joint_3.ecc" in n for n in c.added) for c in choices.values()) >= 19
    # Distances at five placements tell all of the geometry less well than thirteen unknowns.
    assert np.median(ratios) < (1.25 if bent else 1.1)


def test_every_sample_is_held_out_once_with_its_placement() -> None:
    terms = [scene(0).term("calibration"), scene(0).term("fixed_point")]
    folds = folds_of(terms)
    assert [f.label for f in folds] == ["P1", "P2", "P3", "P4", "P5"]
    for fold in folds:
        kept = set(terms[0].poses.samples.labels["placement"][~fold.samples[0]].tolist())
        assert set(fold.held_out[0].poses.samples.labels["placement"].tolist()) == {fold.label}
        assert fold.label not in kept
    for k, term in enumerate(terms):
        seen = [o for f in folds for o in f.held_out[k].poses.samples.origin]
        assert sorted(seen) == sorted(term.poses.samples.origin)


def test_repeats_of_a_touch_are_held_out_together() -> None:
    arm = arm_named("suta")
    where = artefact_scene("landmark", arm, {}, artefact(oriented=True), placements(2), repeats=2)
    term = where.exact()
    touch = dict(zip(term.poses.samples.origin, term.repeats(), strict=True))
    for fold in folds_of([term]):
        out = {touch[o] for o in fold.held_out[0].poses.samples.origin}
        kept = term.take(~fold.samples[0])
        assert not out & {touch[o] for o in kept.poses.samples.origin}


def test_the_held_out_error_of_the_truth_is_that_of_the_noise() -> None:
    arm = arm_named("suta")
    term = tracked_scene(arm, {}, 60).exact(Noise(1e-4))
    found = cross_validate([term], folds_of([term]), arm.select("joint_4.z"), [1e-4])
    assert found.loss < 1e-6
    assert found.rms < 1e-9


def linear_case(kind: str) -> tuple[Problem, ParameterSet]:
    """Distances with gross errors at placements, or a tracked tip; and what may be added."""
    if kind == "distances":
        found = scene(2, ECCENTRIC)
        terms, arm, unknown = [found.term("calibration")], found.arm, thirteen(found.arm)
    else:
        arm = arm_named("suta")
        terms = [tracked({"joint_2.gain": 1e-3, "joint_3.ecc_s2": 5e-4}, 60)]
        unknown = arm.select("geometric", "joint_*.offset")
    return Problem(terms, unknown), arm.select("joint_*.ecc_*", "joint_2.gain")


@pytest.mark.parametrize("kind", ["distances", "tracked"])
def test_a_linear_fit_is_that_of_the_solver(kind: str) -> None:
    """Estimates, what is left, and what is held out, of a model that was not linearised about."""
    problem, candidates = linear_case(kind)
    options = SolverOptions(starts=1)
    solution = solve(problem, options)
    folds = folds_of(problem.terms)
    linear = LinearModels(CalibrationExamination.of(solution), folds, solution.noise)
    added = [n for n in candidates if n.startswith(("joint_2.gain", "joint_3.ecc"))]
    fit = linear.fit(added)
    more = ParameterSet([*problem.arm_parameters.values(), *(candidates[n] for n in fit.added)])
    refitted = solve(Problem(problem.terms, more), options)
    step = dict(zip((linear.problem.names[k] for k in fit.free), fit.step, strict=True))
    for name in fit.added:
        estimate = refitted.estimates[name]
        if estimate.std is not None:
            assert step[name] == pytest.approx(estimate.value, abs=0.3 * estimate.std)
    exact = cross_validate(solution.problem.terms, folds, more, solution.noise)
    np.testing.assert_allclose(linear.cross_validation(fit).losses, exact.losses, rtol=0.05)


def test_many_small_errors_are_found_together() -> None:
    """Each joint's eccentricity is hardly seen alone; all of them together are."""
    arm = arm_named("suta")
    random = np.random.default_rng(4)
    truth = {
        f"joint_{k}.ecc_{key}": float(v)
        for k in range(1, 7)
        for key, v in zip(("c1", "s1"), random.normal(0, 2e-4, 2), strict=True)
    }
    choice = choose_model([tracked(truth, 200)], arm.select("geometric", "joint_*.offset"))
    owners = {name.partition(".")[0] for name in choice.added}
    assert len(owners) >= 3
    assert choice.chosen.held_out.rms < 0.75 * choice.job.held_out.rms
    # Some 45 unknowns from 480 equations cost 5 % of the noise's, and 600 numbers scatter by 3 %.
    assert choice.chosen.held_out.rms < (1.05 + 3 * 0.03) * math.sqrt(3) * 1e-4
    for name in choice.added:
        estimate = choice.solution.estimates[name]
        assert estimate.std is not None


def test_one_step_tells_a_small_eccentricity() -> None:
    arm = arm_named("suta")
    truth = {"joint_3.ecc_c1": 1e-4, "joint_3.ecc_s1": -2e-4}
    term = tracked_scene(arm, truth, 80).exact(Noise(1e-4))
    unknown = arm.select("joint_4.z", "joint_2.offset", "joint_3.offset")
    tests = CalibrationExamination.of(
        solve(Problem([term], unknown), SolverOptions(starts=1))
    ).score_tests
    first = tests[0]
    assert (first.joint, first.family) == ("joint_3", "ecc_1")
    assert first.suspicious
    np.testing.assert_allclose(first.estimate, list(truth.values()), rtol=0.05)
    assert [t.p_single for t in tests] == sorted(t.p_single for t in tests)


def test_clean_residuals_are_not_suspicious() -> None:
    found = scene(0, bent=True)
    for unknown in (thirteen, everything):
        terms = [found.term("calibration"), found.term("fixed_point")]
        solution = solve(Problem(terms, unknown(found.arm)), SolverOptions(starts=1))
        assert not any(t.suspicious for t in CalibrationExamination.of(solution).score_tests)


def test_what_has_no_arm_or_too_little_is_refused() -> None:
    arm = arm_named("suta")
    with pytest.raises(SamplesError, match="observations"):
        choose_model([tracked_scene(arm, {}, 8).exact()], everything(arm))
    eyes = HandEye.simulate(20).term
    with pytest.raises(ParameterError, match="no arm"):
        choose_model([eyes], arm.select("joint_4.z"))
