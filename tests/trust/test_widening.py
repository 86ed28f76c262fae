"""Held-out errors that the fitted rows do not explain make every standard deviation wider."""

from __future__ import annotations

import numpy as np
from judging import watched
from simulated import arm_named

from suta_calib import ParameterSet, Problem, Selection, Solution, SolverOptions, Term, solve
from suta_calib.arrays import FloatArray
from suta_calib.trust.calibration_examination import CalibrationExamination

NOISE = 5e-5  # m
ECCENTRIC = ("joint_2.ecc_c1", "joint_3.ecc_s1", "joint_4.ecc_c1", "joint_5.ecc_s1")


def unknowns() -> ParameterSet:
    return arm_named("suta").select(
        Selection(("geometric",), prior_m=1e-3, prior_rad=2e-3),
        Selection(("*.offset",), prior_rad=1e-2),
    )


def seen(q: FloatArray, truth: dict[str, float], noise: float, seed: int) -> Term:
    """An instrument sees the tip at these postures (n, joints)."""
    scatter = np.random.default_rng(seed).standard_normal((len(q), 3))
    return watched(arm_named("suta"), q, truth, noise * scatter)


def calibrated(eccentricity: float, seed: int = 0) -> tuple[CalibrationExamination, Term]:
    """Fitted to 60 postures near one another and held against 40 from a wider space.

    Returns:
        The answer, and exact rows at 100 further postures.
    """
    rng = np.random.default_rng(seed)
    truth = {name: eccentricity * rng.choice([-1.0, 1.0]) for name in ECCENTRIC}
    centre = rng.uniform(-0.8, 0.8, 6)
    near = centre + rng.uniform(-0.35, 0.35, (60, 6))
    wide = centre + rng.uniform(-1.0, 1.0, (140, 6))
    fitted, held_out = seen(near, truth, NOISE, seed), seen(wide[:40], truth, NOISE, seed + 100)
    solution = solve(Problem([fitted], unknowns()), SolverOptions(confirm=False))
    return CalibrationExamination.of(solution, [held_out]), seen(wide[40:], truth, 0.0, 0)


def ratio_beyond(solution: Solution, further: Term) -> float:
    """Errors at further postures over what is predicted there."""
    (errors,) = CalibrationExamination.of(solution, [further]).held_out
    return errors.ratio


def test_an_arm_that_its_model_describes_keeps_its_standard_deviations() -> None:
    for seed in range(5):
        examined, _ = calibrated(0.0, seed)
        assert examined.widened is examined


def test_what_the_model_lacks_widens_them_to_what_further_postures_show() -> None:
    """The factor comes from the held-out rows, and holds at postures that nobody looked at."""
    ratios = []
    for seed in range(4):
        examined, further = calibrated(3e-3, seed)
        solution, wide = examined.solution, examined.widened.solution
        assert 1.5 < wide.widening < 5.0
        # The instrument's scale is as well known as before.
        by_scale = solution.covariance - solution.covariance_within_scale
        expected = wide.widening**2 * solution.covariance_within_scale + by_scale
        np.testing.assert_allclose(wide.covariance, expected, 1e-9, 1e-24)
        ratios.append((ratio_beyond(solution, further), ratio_beyond(wide, further)))
    before, after = np.exp(np.mean(np.log(ratios), axis=0))
    assert before > 1.5
    assert 0.8 < after < 1.25
