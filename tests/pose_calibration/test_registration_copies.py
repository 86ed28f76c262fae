"""Fiducials that occur more than once: rows that are copies, points that were touched again."""

from __future__ import annotations

import numpy as np
import pytest
from registration_scenes import NOISE, at_points, simulate
from studies import first_of, of_size

from suta_calib.arrays import FloatArray
from suta_calib.pose_calibration.registration import register
from suta_calib.pose_calibration.rigid_fit import determining_rows, distinct_rows
from suta_calib.terms.synthetic import OutlierModel


@pytest.mark.parametrize("seed", first_of(range(4)))
@pytest.mark.parametrize("copies", [(3, 3, 3), (20, 20, 20, 1), (9, 9, 1, 1, 1), (1, 1, 1, 5)])
def test_copies_count_once(copies: tuple[int, ...], seed: int) -> None:
    _, a, b = simulate(len(copies), spread=NOISE, seed=seed)
    rows = np.random.default_rng(seed).permutation(np.repeat(np.arange(len(copies)), copies))
    found, once = register(a[rows], b[rows]), register(a, b)
    np.testing.assert_allclose(found.rotation, once.rotation, atol=1e-9)
    np.testing.assert_allclose(found.position, once.position, atol=1e-9)
    np.testing.assert_allclose(found.covariance, once.covariance, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(found.residuals, once.residuals[rows], atol=1e-9)
    np.testing.assert_array_equal(found.inliers, once.inliers[rows])
    assert found.distinct.sum() == len(copies)
    more = len(rows) - len(copies)
    assert f"{more} rows repeat another exactly" in found.assessment.notes[0]
    assert found.assessment.notes[1:] == once.assessment.notes


def test_a_copy_of_an_outlier_is_one_too() -> None:
    data, a, b = simulate(12, spread=NOISE, gross=OutlierModel(0.1, "wrong"))
    (bad,) = data.outliers
    rows = [*range(12), bad, bad]
    assert register(a[rows], b[rows]).outliers == (bad, 12, 13)


def test_least_squares_weighs_copies_as_they_are() -> None:
    _, a, b = simulate(6, spread=NOISE)
    rows = np.repeat(np.arange(6), (5, 1, 1, 1, 1, 1))
    found, once = register(a[rows], b[rows], robust=False), register(a, b, robust=False)
    assert np.linalg.norm(found.residuals[0]) < np.linalg.norm(once.residuals[0])
    assert len(found.residuals) == 10


@pytest.mark.parametrize("seed", first_of(range(6)))
@pytest.mark.parametrize("touches", [(3, 3, 3), (10, 10, 1, 1, 1), (8, 8, 8)])
def test_no_fiducial_is_lost_for_others_touched_more_often(
    touches: tuple[int, ...], seed: int
) -> None:
    """Two fiducials fit each other about any axis through them, however often they are touched."""
    data, a, _ = simulate(len(touches), seed=seed)
    R, p = data.true_pose("base")
    rows = np.repeat(np.arange(len(touches)), touches)
    noise = NOISE.position * np.random.default_rng(seed).standard_normal((len(rows), 3))
    found = register(a[rows], a[rows] @ R.T + p + noise)
    assert set(rows[found.inliers]) == set(range(len(touches)))
    assert at_points(found, data) < 8 * NOISE.position
    back = register(a[rows] @ R.T + p + noise, a[rows])
    assert set(rows[back.inliers]) == set(range(len(touches)))


def touched(
    count: int, times: int, shared: float, own: float, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Points that are touched again and again, with what all touches of one share, m."""
    _, a, _ = simulate(count, seed=seed)
    random, rows = np.random.default_rng(seed), np.tile(np.arange(count), times)
    err = shared * random.standard_normal((count, 3))[rows]
    return a[rows], a[rows] + err + own * random.standard_normal((len(rows), 3))


@pytest.mark.parametrize("seed", first_of(range(4)))
@pytest.mark.parametrize("swapped", [False, True])
def test_copies_with_other_digits_at_their_end_count_once(seed: int, swapped: bool) -> None:
    a, b = touched(6, 4, NOISE.position, 1e-7, seed)
    a = a + 1e-7 * np.random.default_rng(9).standard_normal(a.shape)
    a, b = (b, a) if swapped else (a, b)
    found, once = register(a, b), register(a[:6], b[:6])
    np.testing.assert_allclose(found.covariance, once.covariance, rtol=0.02, atol=1e-12)
    assert found.distinct.tolist() == [*[True] * 6, *[False] * 18]
    assert found.assessment.level == "care"
    assert "18 rows repeat another but for 0.0001 mm" in found.assessment.notes[0]
    assert len(found.residuals) == len(found.inliers) == 24


@pytest.mark.parametrize("seeds", of_size(15, 40))
def test_what_touches_of_one_point_share_does_not_average(seeds: int) -> None:
    """The standard deviations are true; were every touch a cluster, half as large."""
    squares = list[float]()
    for seed in range(seeds):
        a, b = touched(8, 4, 3e-4, 1e-4, seed)
        found = register(a, b)
        assert found.repeats.note == ""
        assert "counted as 8" in found.assessment.sentence
        off = found.act(np.zeros(3))
        squares.append(float(off @ off / np.trace(found.target_covariance(np.zeros(3))[0])))
    assert 0.6 < np.mean(squares) < 1.5


def test_touches_that_err_each_for_itself_all_count() -> None:
    told = [register(*touched(8, 4, 0.0, 3e-4, seed)).repeats for seed in range(40)]
    assert sum(again is not None for again in told) <= 4


def test_a_wrong_touch_of_a_point_is_none_of_its_middle() -> None:
    a, b = touched(8, 4, 3e-4, 1e-5, 0)
    b[11] += [0.0, 0.05, 0.0]
    found = register(a, b)
    assert found.outliers == (11,)
    np.testing.assert_array_equal(np.flatnonzero(found.distinct), range(8))
    b[3] += [0.0, 0.05, 0.0]
    assert np.flatnonzero(register(a, b).distinct).tolist() == [0, 1, 2, 4, 5, 6, 7, 19]


def test_distinct_rows_keep_their_order() -> None:
    a = np.array([[2.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0], [2, 0, 0]])
    b = np.array([[5.0, 0, 0], [4, 0, 0], [5, 0, 0], [3, 0, 0], [5, 0, 0]])
    first, copies = distinct_rows(a, b)
    assert first.tolist() == [0, 1, 3]
    assert copies.tolist() == [0, 1, 0, 2, 0]
    assert determining_rows(a, b) == 6
    assert determining_rows(np.eye(3), np.eye(3)) == 3
