"""What contradicts an answer, and which reading of the data explains them: on simulated lies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from simulated import Scene, Spread, arm_named, random_readings, tracked_scene

from suta_calib import (
    ArmModel,
    ArmPoses,
    Assessment,
    Noise,
    ParameterSet,
    Problem,
    Samples,
    Selection,
    SolverOptions,
    Term,
    assess,
    solve,
)
from suta_calib.diagnostics.assessment import assess_calibration
from suta_calib.diagnostics.causes import find_cause
from suta_calib.diagnostics.held_out import held_out_errors, median_squared, robust_level
from suta_calib.errors import SamplesError

Change = Callable[[Samples], Samples]
LEARNT = Noise()
NOISE = Spread(position=1e-4, rotation=1e-3)
ONCE = SolverOptions(starts=1, max_iterations=60)


def truth_of(arm: ArmModel) -> dict[str, float]:
    """An arm whose offsets are some tenths of a degree off."""
    rng = np.random.default_rng(8)
    return {f"{joint}.offset": 0.01 * rng.standard_normal() for joint in arm.joints}


@pytest.fixture(scope="module")
def scenes() -> tuple[Scene, Scene]:
    """The tip, seen with its orientation: to fit, and to hold out."""
    arm = arm_named("suta")
    fitted = tracked_scene(arm, truth_of(arm), 40, oriented=True)
    q = random_readings(arm, np.random.default_rng(99), 30)
    again = tracked_scene(arm, truth_of(arm), 30, oriented=True)
    R, p = fitted.arm.forward(q, truth_of(arm))
    first_R, first_p = arm.forward(fitted.q[:1], truth_of(arm))
    turn = fitted.rotation[0] @ first_R[0].T
    shift = fitted.position[0] - turn @ first_p[0]
    return fitted, replace(again, q=q, rotation=turn @ R, position=p @ turn.T + shift)


def unknowns(arm: ArmModel, *, priors: bool) -> ParameterSet:
    if priors:
        return arm.select(
            Selection(("geometric",), prior_m=1e-3, prior_rad=0.003),
            Selection(("*.offset",), prior_rad=0.013),
        )
    return arm.select(Selection(("*.offset",), bound_rad=0.26))


def judged(
    scenes: tuple[Scene, Scene],
    change: Change = lambda samples: samples,
    held_out: Change | None = None,
    *,
    priors: bool = True,
    noise: Noise = LEARNT,
    options: SolverOptions = ONCE,
) -> Assessment:
    """The assessment of a calibration whose samples were changed."""
    fitted, validation = (s.samples(NOISE, seed=k)[0] for k, s in enumerate(scenes))
    arm = scenes[0].arm
    terms = [scenes[0].term(change(fitted), noise)]
    validated = [scenes[1].term((held_out or change)(validation), noise)]
    solution = solve(Problem(terms, unknowns(arm, priors=priors)), options)
    return assess_calibration(solution, assess(solution, validated))


def joint(k: int, change: Callable[[Any], Any]) -> Change:
    def changed(samples: Samples) -> Samples:
        q = samples.q.copy()
        q[:, k] = change(q[:, k])
        return replace(samples, q=q)

    return changed


def seen(change: Callable[[Any], Any]) -> Change:
    def changed(samples: Samples) -> Samples:
        assert samples.position is not None
        return replace(samples, position=change(samples.position.copy()))

    return changed


def late(samples: Samples) -> Samples:
    kept = np.arange(len(samples) - 1)
    read, observed = samples.take(kept + 1), samples.take(kept)
    return replace(read, position=observed.position, rotation=observed.rotation)


def moved(position: Any) -> Any:
    position[len(position) // 2 :] += [0.05, 0.0, 0.0]
    return position


@pytest.mark.parametrize("priors", [True, False])
def test_honest_data_are_not_accused(scenes: tuple[Scene, Scene], priors: bool) -> None:
    found = judged(scenes, priors=priors)
    assert found.usable
    said = " ".join(found.notes)
    assert "far better" not in said
    assert "times what" not in said
    assert "standard deviations from" not in said


@pytest.mark.parametrize("priors", [True, False])
@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (joint(1, np.negative), "joint_2 counts the other way"),
        (joint(2, lambda q: q + np.pi / 2), "joint_3 reads 90° too much"),
        (late, "one row"),
        (seen(moved), "was moved"),
    ],
    ids=["sign", "quarter turn", "late", "moved"],
)
def test_a_lie_is_refused_and_its_cause_named(
    scenes: tuple[Scene, Scene], change: Change, cause: str, priors: bool
) -> None:
    found = judged(scenes, change, priors=priors)
    assert not found.usable
    assert cause in " ".join(found.notes)


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_another_unit_is_refused_before_anything_is_solved(
    scenes: tuple[Scene, Scene], factor: float
) -> None:
    with pytest.raises(SamplesError, match="is it another unit"):
        judged(scenes, seen(lambda p: factor * p))


def test_a_dead_encoder_is_refused_and_named(scenes: tuple[Scene, Scene]) -> None:
    few = replace(ONCE, max_iterations=10)
    found = judged(scenes, joint(3, lambda q: np.full_like(q, q.mean())), options=few)
    assert not found.usable
    assert "joint_4 reads the same in every row" in " ".join(found.notes)


def test_an_instrument_that_was_moved_before_the_held_out_rows_is_said(
    scenes: tuple[Scene, Scene],
) -> None:
    found = judged(scenes, held_out=seen(lambda p: p + np.array([0.05, 0.0, 0.0])))
    assert not found.usable
    assert "it was moved" in " ".join(found.notes)


def test_validation_that_repeats_the_calibration_is_no_validation(
    scenes: tuple[Scene, Scene],
) -> None:
    samples = scenes[0].samples(NOISE)[0]
    arm = scenes[0].arm
    term: Term = scenes[0].term(samples)
    solution = solve(Problem([term], unknowns(arm, priors=True)), ONCE)
    copy = term.over_poses(ArmPoses(arm, samples))
    found = assess_calibration(solution, assess(solution, [copy]))
    assert "nothing was held out" in " ".join(found.notes)


def test_noise_that_is_ten_times_the_stated_is_refused(scenes: tuple[Scene, Scene]) -> None:
    found = judged(scenes, noise=Noise(sigma=5e-6))
    assert not found.usable
    assert "that the job states" in " ".join(found.notes)


def test_held_out_errors_are_as_predicted(scenes: tuple[Scene, Scene]) -> None:
    fitted, validation = (s.samples(NOISE, seed=7 + k)[0] for k, s in enumerate(scenes))
    parameters = unknowns(scenes[0].arm, priors=False)
    solution = solve(Problem([scenes[0].term(fitted)], parameters), ONCE)
    position = held_out_errors(solution, [scenes[1].term(validation)])[0]
    assert 0.7 < position.ratio < 1.4
    assert position.coverage(0.68) == pytest.approx(0.68, abs=0.25)
    assert position.coverage(0.95) > 0.8


def test_a_robust_level_is_the_standard_deviation_of_normal_noise() -> None:
    rng = np.random.default_rng(0)
    for size in (1, 2, 3):
        residual = 2e-3 * rng.standard_normal((20_000, size))
        residual[:6000] += 1.0
        squared = np.sum(residual[6000:] ** 2, axis=1)
        assert np.median(squared) == pytest.approx(4e-6 * median_squared(size), rel=0.05)
        assert 2e-3 < robust_level(residual) < 4e-3
    assert np.isnan(robust_level(np.zeros((0, 3))))


def test_a_clean_problem_has_no_cause(scenes: tuple[Scene, Scene]) -> None:
    term = scenes[0].term(scenes[0].samples(NOISE)[0])
    parameters = unknowns(scenes[0].arm, priors=True)
    assert find_cause(solve(Problem([term], parameters), ONCE)) is None
