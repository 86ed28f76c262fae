"""Something that was moved between poses is named; noise, and a hand that is bent, are not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hand_eye_scenes import bent_hand, noisy, simulate
from studies import of_size

from suta_calib.geometry.numbers import rotation_from_vector, vector_from_rotation
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration, calibrate_hand_eye
from suta_calib.pose_calibration.pivot import PivotCalibration, calibrate_pivot
from suta_calib.pose_calibration.registration import Registration, register
from suta_calib.terms.hand_eye_start import (
    EYE_IN_HAND,
    EYE_TO_HAND,
    EyeSetup,
    Poses,
    inverse_poses,
    some_poses,
)
from suta_calib.trust.hypotheses.moved_at_a_row import TIMES, Moved, sizes
from suta_calib.trust.hypotheses.outlier_block import OutlierBlock
from suta_calib.trust.rule import Rule

BY = np.array([2e-3, -3e-3, 6e-3])


@dataclass(frozen=True)
class Change:
    """What is said to have been moved; NaN where it was not fitted."""

    what: str
    since: int
    by: float
    by_std: float
    turn: float
    turn_std: float
    drifts: bool
    sentence: str


def change(found: HandEyeCalibration | PivotCalibration | Registration) -> Change | None:
    if found.moved is None:
        return None
    evidence, nan = found.moved.evidence, (np.nan, np.nan)
    about, sentence = evidence.effect.about, found.moved.sentence
    if found.moved.hypothesis.name == OutlierBlock.name:
        what, border, _ = about
        return Change(what, border, *nan, *nan, False, sentence)
    shift, turn = [*sizes(evidence), nan][:2]
    since = about.since(evidence)
    return Change(about.what, since or 0, *shift, *turn, since is None, sentence)


def displaced(poses: Poses, since: int, turn: float = 0.0) -> Poses:
    """``T_i D`` from a row on: what the second frame is fixed to was moved in it."""
    R, p = poses[0].copy(), poses[1].copy()
    p[since:] += R[since:] @ BY
    R[since:] = R[since:] @ rotation_from_vector([0.0, 0.0, turn])
    return R, p


def with_eye_moved(setup: EyeSetup) -> HandEyeCalibration:
    """A X D B = Z: the hand's poses as if their frame were another one."""
    data = noisy(40, seed=5)
    hand = displaced(data.poses, 25)
    if setup == EYE_TO_HAND:
        hand = inverse_poses(hand)
    return calibrate_hand_eye(hand, data.seen, setup=setup)


@pytest.mark.parametrize(
    ("setup", "what"),
    [(EYE_IN_HAND, "the camera on the hand"), (EYE_TO_HAND, "the camera (or the base)")],
)
def test_an_eye_that_was_bumped_is_named(setup: EyeSetup, what: str) -> None:
    found = with_eye_moved(setup)
    moved = change(found)
    assert moved.what.startswith(what)
    assert abs(moved.since - 25) <= 1
    assert abs(moved.by - 7e-3) < 3 * moved.by_std
    assert moved.turn < 3 * moved.turn_std
    assert found.assessment.level == "care"
    assert not any("Add poses" in note for note in found.assessment.notes)


def test_a_target_that_was_turned_is_named() -> None:
    data = noisy(40, seed=6)
    seen = displaced(data.seen, 20, turn=0.02)
    found = calibrate_hand_eye(data.poses, seen)
    moved = change(found)
    assert moved.what.startswith("the target")
    assert abs(moved.since - 20) <= 1
    assert abs(moved.turn - 0.02) < 3 * moved.turn_std


@pytest.mark.parametrize("since", [24, 6])
def test_a_change_early_or_late_leaves_a_run_of_rows_that_disagree(since: int) -> None:
    data = noisy(30, seed=7)
    hand = displaced(data.poses, since)
    hand = hand[0], np.where(np.arange(30)[:, None] >= since, hand[1] + 0.1, hand[1])
    moved = change(calibrate_hand_eye(hand, data.seen))
    assert moved.since == since
    assert np.isnan(moved.by)
    assert "all before row" in moved.sentence


@pytest.mark.parametrize("seeds", of_size(2, 5))
@pytest.mark.parametrize("count", [8, 12, 40, 120])
def test_noise_moves_nothing(count: int, seeds: int) -> None:
    for seed in range(seeds):
        data = noisy(count, seed=seed)
        assert calibrate_hand_eye(data.poses, data.seen).moved is None


def bent(count: int, seed: int) -> HandEyeCalibration:
    """A hand that errs by 4 mm and 0.4°, alike in like poses, and goes from one to the next."""
    data = simulate(count, seed=seed)
    where = np.hstack([data.poses[1], vector_from_rotation(data.poses[0])])
    way = [0]
    while len(way) < count:
        far = np.linalg.norm(where - where[way[-1]], axis=1)
        far[way] = np.inf
        way.append(int(np.argmin(far)))
    order = np.array(way)
    return calibrate_hand_eye(
        some_poses(bent_hand(data, seed), order), some_poses(data.seen, order)
    )


@pytest.mark.parametrize("seeds", of_size(3, 6))
def test_a_hand_that_is_bent_is_not_called_moved(seeds: int) -> None:
    assert not any(bent(15, seed).moved for seed in range(seeds))


@pytest.mark.slow
@pytest.mark.parametrize("count", [15, 30, 60])
def test_a_hand_that_is_bent_is_hardly_ever_called_moved(count: int) -> None:
    """If half of the squares were enough it would be some in a hundred."""
    assert sum(bent(count, seed).moved is not None for seed in range(100)) <= 2


# ── Pivot ────────────────────────────────────────────────────────────────────────────────────
def pivoted(count: int, seed: int = 0, noise: float = 2e-4, **changed: Any) -> PivotCalibration:
    """A tool that pivots; its tip or the post another from a row on."""
    random = np.random.default_rng(seed)
    R = rotation_from_vector(random.uniform(-0.7, 0.7, (count, 3)))
    tip, post = np.tile([0.01, 0.02, 0.16], (count, 1)), np.tile([0.1, -0.06, -1.4], (count, 1))
    tip[count // 2 :] += changed.get("tip", 0.0)
    post[count // 2 :] += changed.get("post", 0.0)
    p = post - np.einsum("nij,nj->ni", R, tip) + noise * random.standard_normal((count, 3))
    return calibrate_pivot(R, p)


@pytest.mark.parametrize("count", [20, 60, 1000])
@pytest.mark.parametrize(("which", "what"), [("tip", "the tip on"), ("post", "the post")])
def test_a_tip_that_bent_is_told_from_a_post_that_slid(which: str, what: str, count: int) -> None:
    found = pivoted(count, **{which: np.array([0.0, 1e-3, 1e-3])})
    moved = change(found)
    assert moved.what.startswith(what)
    assert abs(moved.since - count // 2) <= max(1, count // TIMES)
    assert abs(moved.by - np.sqrt(2.0) * 1e-3) < 3 * moved.by_std
    assert np.isnan(moved.turn)
    assert "is at another place" in " ".join(found.assessment.notes)
    assert replace(found, weighed=()).assessment != found.assessment


@pytest.mark.parametrize("count", [10, 60, 600])
def test_a_steady_pivot_moved_nowhere(count: int) -> None:
    assert not any(pivoted(count, seed).moved for seed in range(5))


def test_a_rule_decides_what_is_reported() -> None:
    random = np.random.default_rng(0)
    R = rotation_from_vector(random.uniform(-0.7, 0.7, (40, 3)))
    p = 0.3 - R @ [0.01, 0.02, 0.16] + 2e-4 * random.standard_normal((40, 3))
    p[20:] += 5e-3
    assert [f.hypothesis.name for f in calibrate_pivot(R, p).findings] == [Moved.name]
    assert not calibrate_pivot(R, p, rule=Rule(false_alarm=0.0)).findings


def test_exact_poses_tell_a_change_exactly() -> None:
    found = change(pivoted(40, noise=0.0, tip=np.array([0.0, 0.0, 2e-3])))
    assert found.since == 20
    assert found.by == pytest.approx(2e-3, abs=1e-9)
    assert pivoted(40, noise=0.0).moved is None


# ── Registration ─────────────────────────────────────────────────────────────────────────────
def registered(count: int, seed: int, by: float, again: int = 1) -> Registration:
    """Points of a body that is displaced after half of them; each read ``again`` times."""
    random = np.random.default_rng(seed)
    a = random.uniform(-0.1, 0.1, (count, 3))
    b = a + 2e-4 * random.standard_normal((count, 3))
    b[count // 2 :] += [0.0, by, 0.0]
    return register(np.repeat(a, again, axis=0), np.repeat(b, again, axis=0))


@pytest.mark.parametrize(("count", "again"), [(12, 1), (12, 3), (30, 1), (600, 1)])
def test_a_body_that_was_moved_between_points_is_named(count: int, again: int) -> None:
    found = registered(count, 0, 3e-3, again)
    moved = change(found)
    assert abs(moved.since - again * count // 2) <= again * max(1, count // TIMES)
    assert abs(moved.by - 3e-3) < 3 * moved.by_std
    assert moved.turn < 3 * moved.turn_std
    assert any("one of the two sets is at another place" in n for n in found.assessment.notes)
    assert found.assessment.level == "care"


@pytest.mark.parametrize("count", [100, 300])
def test_of_many_rows_a_change_is_told_that_explains_little(count: int) -> None:
    """Half a millimetre of 0.2 mm noise: it was lost among many rows, and the ± exceeded."""
    for seed in range(4):
        for found in (
            registered(count, seed, 5e-4),
            pivoted(count, seed, tip=np.array([0.0, 0.0, 5e-4])),
        ):
            moved = change(found)
            assert not moved.drifts
            assert abs(moved.since - count // 2) <= count // 10
            assert abs(moved.by - 5e-4) < 4 * moved.by_std
            assert found.assessment.level == "care"


@pytest.mark.parametrize(("count", "by"), [(30, 2e-3), (100, 1e-3), (300, 1e-3)])
def test_a_slow_drift_is_told(count: int, by: float) -> None:
    for seed in range(4):
        random = np.random.default_rng(seed)
        a = random.uniform(-0.1, 0.1, (count, 3))
        b = a + 2e-4 * random.standard_normal((count, 3))
        b[:, 1] += np.linspace(0.0, by, count)
        found = register(a, b)
        moved = change(found)
        assert moved.drifts
        assert abs(moved.by - by) < 4 * moved.by_std
        assert any("drifts, by" in note for note in found.assessment.notes)


@pytest.mark.parametrize("moved", ["P1", "P2", "P3"])
def test_of_several_posts_the_one_that_moved_is_named(moved: str) -> None:
    random = np.random.default_rng(0)
    names = np.array(["P1", "P2", "P3"])[np.arange(90) % 3]
    posts = {"P1": [0.0, 0.0, 1.0], "P2": [0.2, 0.0, 1.0], "P3": [0.0, 0.2, 1.1]}
    at = np.array([posts[name] for name in names])
    at[(names == moved) & (np.arange(90) >= 45)] += [0.0, 1.5e-3, 0.0]
    R = rotation_from_vector(random.uniform(-0.7, 0.7, (90, 3)))
    p = at - R @ [0.01, 0.02, 0.16] + 2e-4 * random.standard_normal((90, 3))
    found = change(calibrate_pivot(R, p, names))
    assert found.what == f"the post {moved}"
    assert abs(found.since - 45) <= 4
    # Where its rows are left out nothing tells by how much.
    assert np.isnan(found.by) or abs(found.by - 1.5e-3) < 4 * found.by_std
    assert np.isnan(found.turn)


def test_a_run_that_disagrees_is_one_with_a_stray_row_beside_it() -> None:
    random = np.random.default_rng(1)
    R = rotation_from_vector(random.uniform(-0.7, 0.7, (120, 3)))
    tip = np.tile([0.01, 0.02, 0.16], (120, 1))
    tip[:40] += [0.0, 0.0, 4e-3]
    p = 0.3 - np.einsum("nij,nj->ni", R, tip) + 5e-5 * random.standard_normal((120, 3))
    p[90] += 5e-3
    found = calibrate_pivot(R, p)
    moved = change(found)
    assert moved.since == 40
    notes = found.assessment.notes
    assert any("nearly all before row 40" in note for note in notes)
    assert any("41 of 120 poses do not agree with the others" in note for note in notes)


@pytest.mark.parametrize("seeds", of_size(7, 20))
@pytest.mark.parametrize("count", [8, 12, 30])
def test_points_of_a_body_that_rests_move_nothing(count: int, seeds: int) -> None:
    assert not any(registered(count, seed, 0.0).moved for seed in range(seeds))
