"""A note on what the model lacks appears only where estimating it predicts left-out rows better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import Scene, Spread, arm_named, tracked_scene

from suta_calib.model.parameters import ParameterSet, Selection
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import Noise, Term
from suta_calib.trust.accuracy import assess
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.linearised import LinearModels, best_extension


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


def parts(eccentricity: float) -> tuple[Scene, Scene]:
    """Postures to fit, and others to validate on."""
    whole = tracked_scene(arm_named("suta"), {"joint_3.ecc_c1": eccentricity}, 90)
    ways = (slice(0, 60), slice(60, None))
    fitted, held_out = (
        replace(whole, q=whole.q[k], position=whole.position[k], rotation=whole.rotation[k])
        for k in ways
    )
    return fitted, held_out


def calibrated(eccentricity: float) -> tuple[Solution, Term]:
    fitted, held_out = parts(eccentricity)
    spread = Spread(position=1e-4)
    terms = [
        scene.term(scene.samples(spread, seed)[0], Noise())
        for seed, scene in enumerate((fitted, held_out))
    ]
    return solve(Problem(terms[:1], unknowns()), SolverOptions(confirm=False)), terms[1]


def test_an_eccentric_encoder_is_worth_a_note() -> None:
    solution, held_out = calibrated(5e-3)
    gain = best_extension(linear(solution), assess(solution, [held_out]).validation, [ECCENTRIC])
    assert gain is not None
    assert set(gain.names) == set(ECCENTRIC)
    assert gain.after < 0.6 * gain.before


def test_an_error_that_is_not_there_is_worth_none() -> None:
    solution, held_out = calibrated(0.0)
    assert (
        best_extension(linear(solution), assess(solution, [held_out]).validation, [ECCENTRIC])
        is None
    )


def test_validation_rows_that_do_not_gain_forbid_the_note() -> None:
    """The encoder of the arm that is validated was mended: what the fitted rows show is gone."""
    solution, _ = calibrated(5e-3)
    _, mended = calibrated(0.0)
    assert (
        best_extension(linear(solution), assess(solution, [mended]).validation, [ECCENTRIC]) is None
    )


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
