"""Errors that were held out, against what the covariance says of them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from offset_arm import NOISE, ONCE, fitted_and_held_out, truth_of, unknowns
from simulated import arm_named, tracked_scene

from suta_calib import Problem, assess, solve
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.held_out import PROBABILITIES, held_out_errors, normal_squared, robust_level


def test_held_out_errors_are_as_predicted() -> None:
    scenes = fitted_and_held_out()
    fitted, validation = (s.samples(NOISE, seed=7 + k)[0] for k, s in enumerate(scenes))
    parameters = unknowns(scenes[0].arm, priors=False)
    solution = solve(Problem([scenes[0].term(fitted)], parameters), ONCE)
    accuracy = assess(solution, [scenes[1].term(validation)])
    position = held_out_errors(solution, accuracy)[0]
    assert 0.7 < position.ratio < 1.4
    for probability in (0.68, 0.95):
        found = position.coverage(probability)
        assert found.std == pytest.approx(math.sqrt(probability * (1 - probability) / 30), rel=0.3)
        assert abs(found.share - probability) < 3 * found.std


def test_held_out_intervals_cover_what_they_should() -> None:
    """Twelve calibrations and their held-out errors, with a new place for the instrument."""
    arm = arm_named("suta")
    unknown = unknowns(arm, priors=False)
    within: dict[float, list[float]] = {p: [] for p in PROBABILITIES}
    first, second = (tracked_scene(arm, truth_of(arm), n) for n in (25, 40))
    for seed in range(12):
        term = first.term(first.samples(NOISE, seed)[0])
        solution = solve(Problem([term], unknown), ONCE)
        held_out: Any = second.term(second.samples(NOISE, 100 + seed)[0])
        accuracy = assess(solution, [replace(held_out, label="elsewhere")])
        (found,) = held_out_errors(solution, accuracy)
        for probability, shares in within.items():
            shares.append(found.coverage(probability).share)
    for probability, shares in within.items():
        # What the fit has wrong is common to all rows of one calibration.
        std = np.std(shares, ddof=1) / math.sqrt(len(shares))
        assert abs(np.mean(shares) - probability) < 3.5 * std
        assert std < 0.05


def test_a_robust_level_is_the_standard_deviation_of_normal_noise() -> None:
    rng = np.random.default_rng(0)
    for size in (1, 2, 3):
        residual = 2e-3 * rng.standard_normal((20_000, size))
        residual[:6000] += 1.0
        squared = np.sum(residual[6000:] ** 2, axis=1)
        assert np.median(squared) == pytest.approx(4e-6 * normal_squared(size), rel=0.05)
        assert 2e-3 < robust_level(residual) < 4e-3
    assert np.isnan(robust_level(np.zeros((0, 3))))


def test_rows_that_are_wrong_in_the_fitted_files_alone_are_told() -> None:
    """Fitted positions are centimetres off; what was held out is not, and errs by less."""
    scenes = fitted_and_held_out()
    fitted, validation = (s.samples(NOISE, seed=7 + k)[0] for k, s in enumerate(scenes))
    assert fitted.position is not None
    parameters, random = unknowns(scenes[0].arm, priors=False), np.random.default_rng(0)
    told = []
    for off in (0.0, 0.03):
        wrong = off * random.standard_normal(fitted.position.shape)
        spoilt = replace(fitted, position=fitted.position + wrong)
        solution = solve(Problem([scenes[0].term(spoilt)], parameters), ONCE)
        found = CalibrationExamination.of(solution, [scenes[1].term(validation)]).contradictions
        told.append(any("smaller than the fitted rows predict" in f.sentence for f in found))
    assert told == [False, True]
