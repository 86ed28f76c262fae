"""By default each step leaves rows out only where that predicts left-out frames better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stereotactic_scenes import TRIANGLE, distance, spoilt
from studies import first_of

from suta_calib.geometry.numbers import random_rotations, register_points
from suta_calib.stereotactic.cis_files import StereotacticData
from suta_calib.stereotactic.cis_simulation import SimulatedSet, simulate_stereotactic
from suta_calib.stereotactic.left_out import (
    left_out_of_pivot,
    left_out_of_registration,
    robust_predicts_better,
)
from suta_calib.stereotactic.marker_cloud import MarkerCloud
from suta_calib.stereotactic.solve import solve_stereotactic


def test_a_left_out_frame_is_predicted_by_a_fit_without_it() -> None:
    random = np.random.default_rng(0)
    R, tip, post = random_rotations(random, 8), np.array([0.02, -0.03, 0.2]), np.array([1.0, 2, 3])
    p = post - R @ tip + 1e-3 * random.standard_normal((8, 3))
    used = np.arange(8) != 5
    expected = []
    for k in range(8):
        rows = np.flatnonzero(used & (np.arange(8) != k))
        A = np.vstack([np.hstack([R[i], -np.eye(3)]) for i in rows])
        solved = np.linalg.lstsq(A, -p[rows].reshape(-1), rcond=None)[0]
        expected.append(np.linalg.norm(R[k] @ solved[:3] + p[k] - solved[3:]))
    assert left_out_of_pivot(R, p, used) == pytest.approx(expected, rel=1e-6)


def test_a_left_out_point_is_predicted_by_a_registration_without_it() -> None:
    random = np.random.default_rng(1)
    a = random.uniform(-0.1, 0.1, (6, 3))
    b = a @ random_rotations(random, 1)[0].T + [1.0, 2.0, 3.0] + random.normal(0, 1e-3, (6, 3))
    found = left_out_of_registration(a, b, np.ones(6, dtype=bool))
    R, p = register_points(a[1:], b[1:])
    assert found[0] == pytest.approx(float(np.linalg.norm(R @ a[0] + p - b[0])))


def test_chance_proves_no_row_wrong() -> None:
    random = np.random.default_rng(2)
    taken = 0
    for _ in range(200):
        plain = np.abs(random.normal(0, 1e-3, 12))
        taken += robust_predicts_better(plain, plain * random.uniform(0.9, 1.1, 12))
    assert taken < 20
    # One frame in twelve is wrong itself, and spoils all others.
    right = np.abs(random.normal(0, 1e-4, 12))
    assert robust_predicts_better(right + 1e-3, np.where(np.arange(12) == 3, 1e-2, right))
    assert not robust_predicts_better(right, right)


def test_a_marker_is_left_out_of_the_frame_where_it_is_wrong() -> None:
    random = np.random.default_rng(3)
    turned = TRIANGLE @ np.swapaxes(random_rotations(random, 200), 1, 2)
    frames = turned + random.normal(0, 1e-4, turned.shape)
    often = MarkerCloud(TRIANGLE).poses(frames, robust=True)
    proven = MarkerCloud(TRIANGLE).poses(frames, robust=None)
    assert proven.outliers <= often.outliers
    assert proven.outliers == 0
    frames[7, 2] += [0.0, 3e-3, 0.0]
    found = MarkerCloud(TRIANGLE).poses(frames, robust=None)
    assert [tuple(map(int, each)) for each in np.argwhere(~found.used)] == [(7, 2)]


def contaminated(made: SimulatedSet) -> StereotacticData:
    """Single markers of every file read centimetres elsewhere."""
    given = made.data
    assert given.navigation is not None
    return replace(
        given,
        em_pivot=spoilt(given.em_pivot, 3, 0.02),
        readings=replace(
            given.readings,
            em=spoilt(given.readings.em, 60, 0.05),
            base=spoilt(given.readings.base, 20, 0.02),
        ),
        navigation=replace(
            given.navigation, em_fiducials=spoilt(given.navigation.em_fiducials, 2, 0.02)
        ),
    )


@pytest.mark.parametrize("seed", first_of(range(2)))
def test_good_sets_are_solved_as_if_all_were_believed(seed: int) -> None:
    made = simulate_stereotactic(seed=seed, distortion=3e-3, em_noise=0.2e-3, grid=3)
    default, plain = (solve_stereotactic(made.data, dewarp=True, robust=r) for r in (None, False))
    np.testing.assert_array_equal(default.em_pivot.post, plain.em_pivot.post)
    np.testing.assert_array_equal(default.optical_pivot.post, plain.optical_pivot.post)
    np.testing.assert_array_equal(default.navigation.ct, plain.navigation.ct)
    assert set(default.outliers.values()) == {0}


@pytest.mark.parametrize("distortion", [0.0, 3e-3])
def test_wrong_markers_are_left_out_unasked(distortion: float) -> None:
    made = simulate_stereotactic(seed=4, distortion=distortion, em_noise=0.05e-3, grid=4)
    data, truth = contaminated(made), made.truth
    found, plain = (solve_stereotactic(data, dewarp=True, robust=r) for r in (None, False))
    assert distance(plain.em_pivot.post, truth.em_post) > 0.5
    assert distance(found.em_pivot.post, truth.em_post) < 0.2
    assert distance(found.navigation.ct, truth.navigation) < 0.3
    assert found.outliers["calreadings"] >= 70
    assert 1e3 * found.navigation.target_error.max() < 1.0
