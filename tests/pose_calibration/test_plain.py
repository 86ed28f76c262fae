"""Plain least squares believes every row, and says which of them the others contradict."""

from __future__ import annotations

import numpy as np
import pytest
from studies import of_size

from suta_calib.geometry.numbers import random_rotations
from suta_calib.pose_calibration.hand_eye import calibrate_hand_eye
from suta_calib.pose_calibration.pivot import calibrate_pivot
from suta_calib.pose_calibration.registration import register
from suta_calib.pose_calibration.robust_answer import RobustAnswer

NOISE = 2e-4
ROWS = 24
WRONG = [3, 17]


def pivoted(random: np.random.Generator, wrong: float, *, robust: bool) -> RobustAnswer:
    R = random_rotations(random, ROWS)
    p = np.array([0.3, 0.1, 0.2]) - R @ [0.0, 0.02, 0.15]
    p += NOISE * random.standard_normal(p.shape)
    p[WRONG] += [0.0, wrong, 0.0]
    return calibrate_pivot(R, p, robust=robust)


def registered(random: np.random.Generator, wrong: float, *, robust: bool) -> RobustAnswer:
    a = random.uniform(-0.2, 0.2, (ROWS, 3))
    b = a @ random_rotations(random, 1)[0].T + 0.3 + NOISE * random.standard_normal(a.shape)
    b[WRONG] += [0.0, wrong, 0.0]
    return register(a, b, robust=robust)


def seen_by_a_hand(random: np.random.Generator, wrong: float, *, robust: bool) -> RobustAnswer:
    A, X, Z = (random_rotations(random, n) for n in (ROWS, 1, 1))
    at = random.uniform(-0.4, 0.4, (ROWS, 3))
    # A X B = Z with X and Z at 5 cm and 1 m.
    x, z = np.array([0.05, 0.0, 0.02]), np.array([0.9, 0.2, 0.1])
    AX, ax = A @ X[0], at + A @ x
    B = np.swapaxes(AX, 1, 2) @ Z[0]
    b = np.einsum("nji,nj->ni", AX, z - ax) + NOISE * random.standard_normal(at.shape)
    b[WRONG] += [0.0, wrong, 0.0]
    return calibrate_hand_eye((A, at), (B, b), robust=robust)


SOLVED = {"pivot": pivoted, "registration": registered, "hand-eye": seen_by_a_hand}


@pytest.mark.parametrize("which", SOLVED)
def test_rows_that_the_others_contradict_are_named(which: str) -> None:
    for seed in range(2):
        found = SOLVED[which](np.random.default_rng(seed), 20 * NOISE, robust=False)
        assert found.inliers.all()
        assert np.flatnonzero(found.suspects).tolist() == WRONG
        (note,) = (n for n in found.assessment.notes if "contradict the others" in n)
        assert "3, 17 (rows from 0)" in note
        robust = SOLVED[which](np.random.default_rng(seed), 20 * NOISE, robust=True)
        assert robust.outliers == tuple(WRONG)
        assert not any("uses all rows" in n for n in robust.assessment.notes)


@pytest.mark.parametrize("seeds", of_size(3, 8))
@pytest.mark.parametrize("which", SOLVED)
def test_rows_that_agree_are_not_accused(which: str, seeds: int) -> None:
    for seed in range(seeds):
        found = SOLVED[which](np.random.default_rng(100 + seed), 0.0, robust=False)
        assert not found.suspects.any()
