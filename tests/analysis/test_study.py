"""Studies of a calibration: their figures against closed forms, other code and known truth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import (
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    dh_parameters,
    perturbed,
    placements,
)
from study_scene import planned, suta_job

from suta_calib.analysis.study import (
    ParameterSpread,
    Request,
    SizeStudy,
    SpreadStudy,
    StudyPlan,
    TrialScatter,
    judge_sizes,
    judge_spread,
    plan_study,
    run_study,
    study_of_job,
)
from suta_calib.analysis.study.trial import FullDataFit, Trial, held_out_rms, nominal_rms, run_trial
from suta_calib.errors import SamplesError
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.trust.accuracy import Accuracy, assess


def simulated_plan(**asked: object) -> StudyPlan:
    """A whole model, six placements in two repeats: nothing but noise between data and model."""
    arm = arm_named("suta")
    parameters = dh_parameters(arm)
    truth = perturbed(parameters, 1)
    scene = artefact_scene("pairwise_distance", arm, truth, artefact(6), placements(6), 2)
    term, held_out = (scene.term(s) for s in scene.samples(Spread(position=1e-4), 3, 2))
    request = Request(**asked)
    return plan_study(parameters, [term], [held_out], SolverOptions(), request)


# ── Trials ───────────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("name", ["calibration", "calibration_full"])
def test_held_out_errors_are_those_of_a_calibration(name: str) -> None:
    job = suta_job(name)
    solution = solve(Problem(job.observations, job.parameters))
    found = assess(solution, job.validation)
    after = Accuracy.overall(found.validation, "after").rms
    assert held_out_rms(solution, job.validation) == pytest.approx(after, rel=1e-12)
    before = Accuracy.overall(found.validation, "before").rms
    data = replace(planned().data, terms=job.observations, parameters=job.parameters)
    assert nominal_rms(data) == pytest.approx(before, rel=1e-12)


def test_a_landmark_job_registers_new_placements_on_the_held_out_rows() -> None:
    arm = arm_named("suta")
    parameters = dh_parameters(arm)
    scene = artefact_scene("landmark", arm, perturbed(parameters, 1), artefact(6), placements(4), 1)
    term = scene.term(scene.samples(Spread(position=1e-4))[0])
    old = np.isin(term.poses.samples.labels["placement"], ["P0", "P1", "P2"])
    some, held_out = term.take(old), term
    solution = solve(Problem([some], parameters))
    after = Accuracy.overall(assess(solution, [held_out]).validation, "after").rms
    assert held_out_rms(solution, [held_out]) == pytest.approx(after, rel=1e-9)


def test_a_trial_with_all_sets_is_the_calibration() -> None:
    job, plan = suta_job(), planned(sizes=(15,))
    solution = solve(Problem(job.observations, job.parameters))
    trial = run_trial(plan.data, 15, 0)
    assert trial.problem == ""
    assert trial.rms == pytest.approx(held_out_rms(solution, job.validation), rel=1e-6)


def test_a_trial_depends_on_its_own_numbers_alone() -> None:
    data = planned().data
    first = run_trial(data, 4, 7)
    run_trial(data, 3, 1)
    assert run_trial(data, 4, 7) == first
    assert run_trial(data, 4, 8) != first
    assert run_trial(replace(data, seed=1), 4, 7) != first


def test_draws_are_fair_and_without_replacement() -> None:
    data = planned().data
    drawn = [data.chosen(4, k) for k in range(400)]
    assert all(len(set(sets)) == 4 for sets in drawn)
    count = np.bincount(np.concatenate(drawn), minlength=15)
    # 400 · 4 / 15 = 107 of each, ± 4.5 standard deviations of a hypergeometric count.
    assert np.abs(count - 1600 / 15).max() < 4.5 * math.sqrt(400 * 4 / 15 * 11 / 15)
    again = planned(kind="bootstrap").data
    assert any(len(set(again.chosen(15, k))) < 15 for k in range(3))


def test_a_trial_that_cannot_be_solved_says_why() -> None:
    one_row = planned(unit="sample", sizes=(1,))
    trial = run_trial(one_row.data, 1, 0)
    assert "without two different landmarks" in trial.problem
    assert math.isnan(trial.rms)


# ── Sizes ────────────────────────────────────────────────────────────────────────────────────
def judged(plan: StudyPlan, errors: dict[int, list[float]], tolerance: float = 0.05) -> SizeStudy:
    trials = [
        Trial(size, k, "" if rms > 0 else "no", rms if rms > 0 else math.nan)
        for size, row in errors.items()
        for k, rms in enumerate(row)
    ]
    return judge_sizes(plan, trials, tolerance)


def test_the_figures_are_those_of_the_trials_that_were_solved() -> None:
    found = judged(planned(sizes=(1, 2), trials=4), {1: [4.0, 8.0, -1.0, 6.0], 2: [3.0] * 4})
    one, two = found.sizes
    assert (one.trials, one.failed, two.failed) == (4, 1, 0)
    assert (one.mean, one.std, *one.range) == (6.0, 2.0, 4.0, 8.0)
    assert (one.improvement, two.improvement, two.std) == (0.0, 0.5, 0.0)
    assert found.failures == {"no": 1}
    assert "1 of 4 with 1" in " ".join(found.assessment.notes)


@pytest.mark.parametrize(
    ("means", "tolerance", "enough"),
    [
        ([2.0, 1.04, 1.0], 0.05, 2),
        ([2.0, 1.06, 1.0], 0.05, 3),
        ([2.0, 1.06, 1.0], 0.10, 2),
        # A dip that does not last is not enough.
        ([1.0, 1.5, 1.0], 0.05, 3),
        ([-1.0, 1.0, 1.0], 0.05, 2),
    ],
)
def test_the_smallest_size_within_the_tolerance(
    means: list[float], tolerance: float, enough: int
) -> None:
    errors = {size: [mean] for size, mean in enumerate(means, 1)}
    found = judged(planned(sizes=(1, 2, 3), trials=1), errors, tolerance)
    assert found.recommended == enough
    assert found.levelled is (enough < 3)
    assert (found.assessment.level == "good") is (enough < 3 and means[0] > 0)


def test_no_result_at_all_is_not_usable() -> None:
    found = judged(planned(sizes=(1, 2), trials=1), {1: [-1.0], 2: [-1.0]})
    assert (found.recommended, found.baseline) == (None, None)
    assert not found.assessment.usable


def test_more_sets_are_better_and_the_first_few_bring_most() -> None:
    """The trend of the dataset-size table, on simulated data: noise averages out."""
    plan = simulated_plan(trials=12, sizes=(1, 2, 3, 6, 12))
    found = judge_sizes(plan, run_study(plan), 0.05)
    by_size = {s.size: s for s in found.sizes}
    assert by_size[1].mean > by_size[2].mean > by_size[3].mean > by_size[12].mean
    assert by_size[6].improvement > 0.9 * by_size[12].improvement
    assert by_size[12].distinct == 1
    assert by_size[12].std == pytest.approx(0.0, abs=1e-15)
    assert found.uncalibrated > 5 * by_size[12].mean


@pytest.mark.parametrize(
    ("asked", "held_out", "sizes", "left_out"),
    [
        (None, True, tuple(range(1, 11)), ()),
        (None, False, tuple(range(1, 11)), ()),
        ((1, 15, 16, 20), True, (1, 15), (16, 20)),
        # Something must be left to look at.
        ((14, 15), False, (14,), (15,)),
    ],
)
def test_sizes_that_the_data_allow(
    asked: tuple[int, ...] | None, held_out: bool, sizes: tuple[int, ...], left_out: tuple[int, ...]
) -> None:
    plan = planned(sizes=asked, held_out=held_out)
    assert (plan.sizes, plan.left_out) == (sizes, left_out)


def test_of_single_samples_ten_sizes_are_studied_and_a_fifth_is_held_out() -> None:
    assert planned(unit="sample").sizes == (22, 45, 68, 90, 112, 135, 158, 180, 202, 225)
    assert max(planned(unit="sample", held_out=False).sizes) == 180
    assert max(planned(unit="placement", held_out=False).sizes) == 4


def test_sizes_that_are_all_too_large_are_refused() -> None:
    with pytest.raises(SamplesError, match=r"--sizes: found sizes from 16 for 15 sets.*up to 15"):
        planned(sizes=(16, 20))


def test_without_validation_data_the_sets_not_drawn_stand_in() -> None:
    plan = planned(sizes=(3, 14), trials=2, held_out=False)
    found = judge_sizes(plan, run_study(plan), 0.05)
    assert all(s.failed == 0 and s.mean > 0 for s in found.sizes)
    assert math.isnan(found.uncalibrated)
    assert "no validation data" in " ".join(found.assessment.notes)


def test_other_terms_are_kept_whole() -> None:
    plan = planned(suta_job("calibration_full"), sizes=(2,), trials=1)
    terms = plan.data.sets.take(plan.data.terms, [0, 1])
    assert [len(t.poses) for t in terms] == [30, 60]


# ── Spread ───────────────────────────────────────────────────────────────────────────────────
def spread(trials: int, **asked: object) -> SpreadStudy:
    plan = simulated_plan(trials=trials, **asked)
    return judge_spread(plan, run_study(plan))


def ratios(found: SpreadStudy) -> np.ndarray:
    return np.array([p.ratio for p in found.parameters.values() if math.isfinite(p.ratio)])


def test_simulated_noise_scatters_estimates_as_predicted() -> None:
    found = spread(60, kind="monte-carlo")
    assert len(ratios(found)) == 10
    assert 0.8 < np.sqrt(np.mean(ratios(found) ** 2)) < 1.25
    assert found.assessment.level == "good"
    silent = [n for n, p in found.parameters.items() if not math.isfinite(p.ratio)]
    assert silent == ["joint_1.offset", "joint_2.z", "tip.y"]
    assert all(not len(found.parameters[n].spread.values) for n in silent)


def test_a_bootstrap_of_placements_agrees_with_the_sandwich() -> None:
    """Nothing but noise here: either way of counting clusters must give its size."""
    found = spread(60, kind="bootstrap")
    assert 0.6 < np.sqrt(np.mean(ratios(found) ** 2)) < 1.5
    low, high = found.validation.interval
    assert low < found.full_rms * 1.1
    assert high > found.full_rms


def test_the_interval_and_the_spread_are_those_of_the_trials() -> None:
    plan = simulated_plan(kind="bootstrap", trials=101)
    values = np.linspace(-1.0, 1.0, 101)
    trials = [Trial(12, k, "", 1e-4, {"joint_2.offset": (v, 0.5)}) for k, v in enumerate(values)]
    found = judge_spread(plan, trials).parameters["joint_2.offset"]
    assert found.spread.interval == pytest.approx((-0.95, 0.95))
    assert found.spread.std == pytest.approx(np.std(values, ddof=1))
    assert found.predicted == plan.solution.estimates["joint_2.offset"].std
    assert not found.as_predicted


def test_a_value_relative_to_other_held_parameters_is_not_counted() -> None:
    plan = simulated_plan(kind="bootstrap", trials=1)
    reference = plan.data.reference
    other = FullDataFit(
        reference.values, reference.noise, {**reference.given, "joint_3.z": ("joint_9.z",)}
    )
    trial = run_trial(replace(plan.data, reference=other), 12, 0)
    assert "joint_3.z" not in trial.estimates
    assert "joint_3.offset" in trial.estimates


def test_a_prior_explains_a_small_spread_and_no_large_one() -> None:
    plan = simulated_plan(kind="bootstrap", trials=1)
    estimate, values = plan.solution.estimates["tip.z"], TrialScatter(np.linspace(-1.0, 1.0, 200))
    for predicted, alone, with_prior in ((2.0, False, True), (0.2, False, False)):
        assert ParameterSpread(estimate, values, predicted).as_predicted is alone
        assert ParameterSpread(estimate, values, predicted, 0, True).as_predicted is with_prior


def test_few_values_have_no_spread() -> None:
    plan = simulated_plan(kind="bootstrap", trials=3)
    found = judge_spread(plan, run_study(plan))
    assert all(math.isnan(p.spread.std) for p in found.parameters.values())
    assert not found.assessment.usable


@pytest.mark.slow
def test_each_parameter_scatters_as_predicted() -> None:
    found = spread(400, kind="monte-carlo")
    assert np.all(ratios(found) > 0.8)
    assert np.all(ratios(found) < 1.25)


def test_a_study_of_a_job_is_one_call(tmp_path: Path) -> None:
    job, request = suta_job(), Request("size", 2, (1, 3), tolerance=0.5)
    found = study_of_job(job, request)
    assert isinstance(found, SizeStudy)
    again = judge_sizes(found.plan, run_study(found.plan), 0.5)
    for mine, other in zip(found.sizes, again.sizes, strict=True):
        np.testing.assert_array_equal(mine.rms, other.rms)
    log = tmp_path / request.log_name
    resumed = study_of_job(job, request, log), study_of_job(job, request, log, resume=True)
    assert log.is_file()
    assert {study.recommended for study in resumed} == {found.recommended}
