"""Large residuals of a job that states no noise are held against what its rows scatter."""

from __future__ import annotations

import numpy as np
import pytest
from judging import assessed, notes_on, watched
from scipy.spatial.transform import Rotation
from simulated import arm_named

from suta_calib import (
    Calibration,
    Noise,
    ParameterSet,
    Problem,
    Selection,
    Solution,
    SolverOptions,
    TrackedPoint,
    calibrate,
    solve,
)
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.trust.priors import judge_priors
from suta_calib.trust.repeats import noise_of_rows

ONCE, UNSTATED = SolverOptions(confirm=False), Noise()


def postures(count: int, apart: float) -> FloatArray:
    """(2 count, joints) of which each stands twice, so far apart in every joint, rad."""
    q = np.random.default_rng(3).uniform(-1.2, 1.2, (count, 6))
    return np.vstack([q, q + apart])


def solved(
    noise: float,
    stated: Noise = UNSTATED,
    truth: dict[str, float] | None = None,
    unknowns: ParameterSet | None = None,
    wrong: FloatArray | float = 0.0,
    apart: float = 3e-3,
) -> Solution:
    """An instrument saw the tip of an arm whose offsets are unknown.

    Args:
        noise: of what it saw, per axis, m.
        wrong: (n, 3) what is added to what it saw, m.
    """
    arm, q = arm_named("suta"), postures(60, apart)
    error = noise * np.random.default_rng(4).standard_normal((len(q), 3)) + wrong
    term = watched(arm, q, truth or {"joint_2.offset": 0.01}, error, stated=stated)
    offsets = arm.select(Selection(("joint_[2-6].offset",), bound_rad=0.2))
    return solve(Problem([term], unknowns or offsets), ONCE)


@pytest.mark.parametrize("noise", [5e-4, 3e-3])
def test_neighbours_tell_the_noise(noise: float) -> None:
    rows = noise_of_rows(solved(noise))[0]
    assert rows.source == "neighbours"
    assert rows.noise == pytest.approx(noise, rel=0.25)
    assert rows.ratio == pytest.approx(1.0, abs=0.3)


def test_neighbours_do_not_take_the_models_error_for_noise() -> None:
    """A link 15 mm off that the job holds: residuals are its, neighbours scatter by the noise."""
    rows = noise_of_rows(solved(2e-4, truth={"joint_4.z": 0.015 + 0.571}))[0]
    assert rows.level > 2e-3
    assert rows.noise < 1e-3
    assert rows.ratio > 5.0


def test_a_coarse_instrument_is_asked_to_be_stated() -> None:
    said = notes_on(solved(3e-3))
    assert "neighbours differ by as much" in said
    assert "sigma_mm" in said
    assert "residuals are" not in notes_on(solved(3e-3, Noise(3e-3)))


def test_rows_shifted_at_random_are_not_good() -> None:
    """Half of the rows 10 mm off, at random: residuals of 5 mm passed as noise."""
    half = np.random.default_rng(5).random(120) < 0.5
    shifted = assessed(solved(1e-4, wrong=np.outer(half, [0.01, 0.0, 0.0])))
    assert shifted.level != "good"


def test_small_residuals_are_asked_nothing() -> None:
    assert "per axis" not in notes_on(solved(5e-4))


@pytest.mark.parametrize(("times", "level"), [(1.0, ""), (50.0, "bad")])
def test_held_priors_that_are_too_narrow_are_named(times: float, level: str) -> None:
    """Priors fifty times too narrow, fixed, passed at 20 to 35 times the ±."""
    arm = arm_named("suta")
    sizes = {"m": 2e-3, "rad": 4e-3}
    rows = [
        Selection(("geometric",), prior_m=sizes["m"] / times, prior_rad=sizes["rad"] / times),
        Selection(("*.offset",), prior_rad=sizes["rad"] / times),
    ]
    held = arm.select(*(Selection(**{**vars(row), "fixed": True}) for row in rows))
    rng = np.random.default_rng(6)
    truth = {p.name: p.nominal + sizes[p.unit] * rng.standard_normal() for p in held.values()}
    notes = judge_priors(solved(2e-4, truth=truth, unknowns=held, apart=0.3))
    assert ("fixed: true" in " ".join(notes.bad)) == (level == "bad")
    assert not notes.care


def poses_seen(unknowns: Selection, turned: float = 0.0) -> Calibration:
    """Positions to 0.1 mm and orientations to 1.1 deg, of the tip or of a body turned on it."""
    arm, random = arm_named("suta"), np.random.default_rng(6)
    q = postures(60, 3e-3)
    rotation, position = arm.forward(q, {"joint_2.offset": 0.01})
    rough = Rotation.from_rotvec(random.normal(0.0, 0.02, (len(q), 3))).as_matrix()
    term = TrackedPoint.from_arrays(
        arm,
        q,
        position=position + random.normal(0.0, 1e-4, (len(q), 3)),
        orientation=rotation @ rotation_from_vector([turned, 0.0, 0.0]) @ rough,
    )
    return calibrate(arm, term, free=[Selection(("joint_[2-6].offset",), bound_rad=0.2), unknowns])


def test_orientations_of_a_small_marker_are_noise_where_positions_fit() -> None:
    judged = poses_seen(Selection(("tip.r?",), bound_rad=3.2)).assessment
    assert judged.level == "care"
    assert any("neighbours differ by as much" in sentence for sentence in judged.notes)


def test_a_body_turned_on_the_tip_is_guessed_where_its_prior_is_left() -> None:
    judged = poses_seen(Selection(("tip.r?",), prior_rad=5e-3), turned=1.2).assessment
    assert any("body that is fixed to the tip's link" in sentence for sentence in judged.notes)
