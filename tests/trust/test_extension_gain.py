"""A note on what the model lacks appears only where estimating it predicts left-out rows better."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import Spread, arm_named, tracked_scene

from suta_calib import (
    Noise,
    ParameterSet,
    Problem,
    Selection,
    Solution,
    SolverOptions,
    Term,
    assess,
    solve,
)
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.linearised import ExtensionGain, LinearModels, best_extension


def linear(solution: Solution) -> LinearModels:
    models = CalibrationExamination.of(solution).linearised
    assert models is not None
    return models


ECCENTRIC = ("joint_3.ecc_c1", "joint_3.ecc_s1")


def unknowns() -> ParameterSet:
    return arm_named("suta").select(
        Selection(("geometric",), prior_m=1e-3, prior_rad=2e-3),
        Selection(("*.offset",), prior_rad=1e-2),
    )


def calibrated(eccentricity: float) -> tuple[Solution, Term]:
    """Sixty postures fitted, thirty others to validate on."""
    whole = tracked_scene(arm_named("suta"), {"joint_3.ecc_c1": eccentricity}, 90)
    term = whole.term(whole.samples(Spread(position=1e-4), 0)[0], Noise())
    fitted, held_out = term.take(np.arange(60)), term.take(np.arange(60, 90))
    return solve(Problem([fitted], unknowns()), SolverOptions(confirm=False)), held_out


def gain_of(fitted: Solution, held_out: Term) -> ExtensionGain | None:
    return best_extension(linear(fitted), assess(fitted, [held_out]).validation, [ECCENTRIC])


def test_an_eccentric_encoder_is_worth_a_note() -> None:
    gain = gain_of(*calibrated(5e-3))
    assert gain is not None
    assert set(gain.names) == set(ECCENTRIC)
    assert gain.after < 0.6 * gain.before


def test_an_error_that_is_not_there_or_was_mended_is_worth_none() -> None:
    """Of a mended encoder the fitted rows show an error, and the validation rows none."""
    assert gain_of(*calibrated(0.0)) is None
    assert gain_of(calibrated(5e-3)[0], calibrated(0.0)[1]) is None


def test_linear_prediction_equals_a_refit() -> None:
    """The held-out error that is promised is the one that a fit with the term has."""
    solution, held_out = calibrated(5e-3)
    gain = best_extension(linear(solution), (), [ECCENTRIC])
    assert gain is not None
    more = arm_named("suta").select(Selection(ECCENTRIC, bound_rad=0.05))
    wide = ParameterSet([*unknowns().values(), *more.values()])
    again = solve(Problem(solution.problem.terms, wide), SolverOptions(confirm=False))
    refitted = assess(again, [held_out]).validation[0].after.rms
    assert refitted == pytest.approx(gain.after, rel=0.15)
    assert np.isclose(again.values["joint_3.ecc_c1"], 5e-3, atol=5e-4)
