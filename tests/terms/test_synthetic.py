"""Simulated poses: exact ones satisfy their equation, and noise and gross errors are as asked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.solver.compiled_residual import term_residuals
from suta_calib.terms import FixedPoint, HandEye, TrackedPoint
from suta_calib.terms.synthetic import SLIP, OutlierModel, PoseNoise, Simulated, random_turns

Maker = Callable[..., Simulated[Any]]
MAKERS: dict[str, Maker] = {
    "fixed_point": lambda count, **more: FixedPoint.simulate(count, **more),
    "hand_eye": lambda count, **more: HandEye.simulate(count, **more),
    "tracked_point": lambda count, **more: TrackedPoint.simulate(count, **more),
}
each_maker = pytest.mark.parametrize("name", MAKERS)


def measured(data: Simulated[Any]) -> list[np.ndarray]:
    """All that noise and gross errors can change."""
    return [*data.poses, *data.seen]


def changed_rows(first: Simulated[Any], second: Simulated[Any]) -> set[int]:
    rows = set[int]()
    for a, b in zip(measured(first), measured(second), strict=True):
        rows |= set(np.flatnonzero(np.any((a != b).reshape(len(a), -1), axis=1)).tolist())
    return rows


@each_maker
def test_exact_measurements_have_no_residual_at_the_truth(name: str) -> None:
    data = MAKERS[name](20, seed=3)
    residuals = term_residuals(data.term, data.truth)
    assert max(np.abs(r).max() for r in residuals) < 1e-12
    elsewhere = {key: value + 0.01 for key, value in data.truth.items()}
    assert max(np.abs(r).max() for r in term_residuals(data.term, elsewhere)) > 1e-3


@each_maker
def test_the_start_is_the_truth_where_data_are_exact(name: str) -> None:
    data = MAKERS[name](20, seed=3)
    started = data.term.start(*data.poses)
    np.testing.assert_allclose(started, list(data.truth.values()), atol=1e-9)


@each_maker
def test_a_seed_gives_the_same_data_and_another_one_others(name: str) -> None:
    assert not changed_rows(MAKERS[name](20, seed=3), MAKERS[name](20, seed=3))
    assert len(changed_rows(MAKERS[name](20, seed=3), MAKERS[name](20, seed=4))) == 20


@each_maker
@pytest.mark.parametrize("nature", ["wrong", "slipped", "swapped"])
def test_gross_errors_change_the_rows_that_are_listed_and_no_others(name: str, nature: Any) -> None:
    clean, spoiled = (
        MAKERS[name](20, seed=5, gross=g) for g in (OutlierModel(), OutlierModel(0.3, nature))
    )
    assert len(spoiled.outliers) == 6
    assert changed_rows(clean, spoiled) == set(spoiled.outliers)
    assert set(spoiled.inliers) == set(range(20)) - set(spoiled.outliers)
    assert clean.outliers == ()


@each_maker
def test_slips_are_as_long_as_said(name: str) -> None:
    clean, slipped = (
        MAKERS[name](40, seed=5, gross=g) for g in (OutlierModel(), OutlierModel(0.5, "slipped"))
    )
    rows = list(slipped.outliers)
    pairs = zip((clean.poses, clean.seen), (slipped.poses, slipped.seen), strict=True)
    length = sum(np.linalg.norm(b[1][rows] - a[1][rows], axis=1) for a, b in pairs)
    assert SLIP[0] <= length.min() <= length.max() <= SLIP[1]
    assert np.ptp(length) > 5e-3


def test_swapped_pairs_are_other_pairs_measurements() -> None:
    clean, swapped = (
        HandEye.simulate(20, seed=5, gross=g)
        for g in (OutlierModel(), OutlierModel(0.3, "swapped"))
    )
    rows = list(swapped.outliers)
    for a, b in zip(clean.seen, swapped.seen, strict=True):
        assert {row.tobytes() for row in a[rows]} == {row.tobytes() for row in b[rows]}


def test_a_pose_whose_place_alone_is_swapped_misses_the_post() -> None:
    """Whole poses could be swapped unnoticed: both touch the post."""
    data = FixedPoint.simulate(20, seed=5, gross=OutlierModel(0.3, "swapped"))
    error = np.linalg.norm(term_residuals(data.term, data.truth)[0], axis=1)
    assert error[list(data.outliers)].min() > 1e-3
    assert error[data.inliers].max() < 1e-12


def test_noise_has_the_spread_that_was_asked_for() -> None:
    """3,000 numbers each: a standard deviation scatters by 1.3 %."""
    hand, eye = PoseNoise(1e-3, 2e-3), PoseNoise(3e-3, 4e-3)
    exact, noisy = (
        HandEye.simulate(1000, seed=1),
        HandEye.simulate(1000, seed=1, hand=hand, eye=eye),
    )
    for a, b, spread in ((exact.poses, noisy.poses, hand), (exact.seen, noisy.seen, eye)):
        turn = vector_from_rotation(np.swapaxes(a[0], 1, 2) @ b[0])
        assert np.std(b[1] - a[1]) == pytest.approx(spread.position, rel=0.05)
        assert np.std(turn) == pytest.approx(spread.rotation, rel=0.05)


def test_noise_is_on_the_hand_or_on_the_eye_as_asked() -> None:
    exact = HandEye.simulate(20, seed=1)
    on_hand = HandEye.simulate(20, seed=1, hand=PoseNoise(1e-3, 1e-3))
    on_eye = HandEye.simulate(20, seed=1, eye=PoseNoise(1e-3, 1e-3))
    for k in range(2):
        np.testing.assert_array_equal(on_hand.seen[k], exact.seen[k])
        np.testing.assert_array_equal(on_eye.poses[k], exact.poses[k])
        assert np.abs(on_hand.poses[k] - exact.poses[k]).max() > 1e-4
        assert np.abs(on_eye.seen[k] - exact.seen[k]).max() > 1e-4


def test_turns_are_about_the_axes_and_within_the_limit() -> None:
    axes = np.array([[1.0, 2.0, 2.0], [0.0, 3.0, -4.0]]) / [[3.0], [5.0]]
    R = random_turns(np.random.default_rng(0), 200, 0.4, axes[:1])
    np.testing.assert_allclose(R @ axes[0], np.tile(R[0] @ axes[0], (200, 1)), atol=1e-12)
    about_two = random_turns(np.random.default_rng(0), 200, 0.4, axes)
    begun = random_turns(np.random.default_rng(0), 1, 0.0)[0]
    turned = vector_from_rotation(begun.T @ about_two)
    length = np.linalg.norm(turned, axis=1)
    assert 0.38 < length.max() <= 0.4
    overlap = np.abs(turned @ axes.T) / length[:, None]
    np.testing.assert_allclose(overlap.max(axis=1), 1.0)
    assert (overlap.argmax(axis=1) == 0).sum() in range(70, 130)


def test_posts_are_touched_one_after_the_other() -> None:
    posts = np.array([[0.1, 0.2, -1.0], [0.3, 0.0, -0.9], [0.0, 0.0, -1.1]])
    data = FixedPoint.simulate(5, posts=posts, tip=(0.01, 0.02, 0.3))
    R, p = data.poses
    np.testing.assert_allclose(R @ data.true_point("tip") + p, np.repeat(posts, 5, axis=0))
    np.testing.assert_array_equal(data.true_point("tip"), (0.01, 0.02, 0.3))
    np.testing.assert_array_equal(data.true_point("fixed_point[post_2]"), posts[1])


@pytest.mark.parametrize("share", [-0.1, 1.1, np.nan])
def test_a_share_that_is_none_is_refused(share: float) -> None:
    with pytest.raises(SamplesError, match="a share from 0 to 1"):
        OutlierModel(share)


def test_one_row_cannot_be_swapped() -> None:
    with pytest.raises(SamplesError, match="one row of 10 to swap"):
        HandEye.simulate(10, gross=OutlierModel(0.1, "swapped"))
