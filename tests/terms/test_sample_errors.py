"""Errors that the rows of a sample share: whitened as generalised least squares has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import Spread, arm_named, camera_scene

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms.block import Noise
from suta_calib.terms.sample_errors import HandError, SampleErrors

# Length that a pixel covers in the scene, m.
PIXEL = 5e-4


def test_rows_are_white_once_what_they_share_is_taken_out() -> None:
    """W (I + G Gᵀ) Wᵀ = I, sample by sample, whatever the number of its rows and the rank of G."""
    random = np.random.default_rng(0)
    sample = np.repeat([0, 2, 5], [4, 1, 7])
    by_error = random.standard_normal((12, 2, 6)) * [1e-3, 1, 10, 100, 1, 1]
    by_error[5:, :, 4] = by_error[5:, :, 3]
    shared = SampleErrors.of(by_error, sample)
    flat = by_error.reshape(24, 6)
    alike = np.equal.outer(np.repeat(sample, 2), np.repeat(sample, 2))
    covariance = np.eye(24) + flat @ flat.T * alike
    whitener = shared.whitened(np.eye(24).reshape(12, 2, 24)).reshape(24, 24)
    np.testing.assert_allclose(whitener @ covariance @ whitener.T, np.eye(24), atol=1e-9)
    with pytest.raises(SamplesError, match="one after the other"):
        SampleErrors.of(by_error, random.permutation(sample))


def test_a_camera_on_a_hand_with_play_is_found_better_and_as_well_as_it_says() -> None:
    """Joints 0.1° off in every picture, corners found to 0.1 px; twelve sets of thirty pictures."""
    arm, random = arm_named("suta"), np.random.default_rng(4)
    errors, deviations = dict[bool, list[FloatArray]](), list[FloatArray]()
    for stated in (False, True):
        play = HandError(5e-4, np.radians(0.1)) if stated else None
        scene = camera_scene(arm, {}, 30, hand_error=play)
        for samples in scene.samples(Spread(0.1 * PIXEL), seed=1, trials=12):
            q = samples.q + np.radians(0.1) * random.standard_normal(samples.q.shape)
            term = scene.term(replace(samples, q=q), Noise())
            problem = Problem([term], arm.select("joint_3.offset", "joint_5.offset"))
            solution = solve(problem, SolverOptions(confirm=False))
            found = [solution.estimates[f"hand_eye.{axis}"] for axis in "xyz"]
            off = np.array([e.value for e in found]) - [0.02, -0.05, 0.08]
            errors.setdefault(stated, []).append(off)
            if stated:
                deviations.append(off / [e.std for e in found])
    rms = {stated: np.sqrt(np.mean(np.square(of))) for stated, of in errors.items()}
    assert rms[True] < 0.6 * rms[False]
    assert 0.7 < np.sqrt(np.mean(np.square(deviations))) < 1.3
