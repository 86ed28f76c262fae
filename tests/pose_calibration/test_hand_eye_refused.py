"""Pairs of poses that hand-eye calibration refuses, and what it says of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hand_eye_scenes import (
    NATURES,
    NOISE,
    SKEW_AXIS,
    calibrate,
    errors,
    noisy,
    rows_of,
    simulate,
    slides,
)
from scipy.spatial.transform import Rotation
from studies import first_of

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.pose_calibration.hand_eye import calibrate_hand_eye
from suta_calib.pose_calibration.hand_eye_causes import refuse_constant
from suta_calib.terms import HandEye
from suta_calib.terms.hand_eye_start import Poses, inverse_poses
from suta_calib.terms.synthetic import EXACT, OutlierModel, PoseNoise, Simulated
from suta_calib.units import mm


@pytest.mark.parametrize(
    ("spread", "share"), [(EXACT, 0.0), (NOISE, 0.3)], ids=["exact", "noisy and wrong"]
)
@pytest.mark.parametrize(
    ("axis", "turn"), [(np.eye(3)[2], np.pi / 2), (SKEW_AXIS, np.pi / 4)], ids=["z", "skew"]
)
def test_parallel_axes_are_refused_and_the_axis_is_named_in_the_hand(
    turn: float, axis: FloatArray, spread: PoseNoise, share: float
) -> None:
    more: dict[str, Any] = {"turn": turn, "axes": axis, "gross": OutlierModel(share)}
    with pytest.raises(SamplesError, match="do not determine X") as problem:
        calibrate(simulate(30, hand=spread, eye=spread, **more))
    named = slides(problem.value)
    assert len(named) == 1
    assert abs(named[0] @ axis) == pytest.approx(1.0, abs=0.01)
    assert "turn about" not in str(problem.value)
    assert "two axes that are not parallel" in str(problem.value)


@pytest.mark.parametrize(
    ("spread", "share"), [(EXACT, 0.0), (NOISE, 0.2)], ids=["exact", "noisy and wrong"]
)
def test_pure_translation_is_refused_in_every_direction(spread: PoseNoise, share: float) -> None:
    with pytest.raises(SamplesError, match="do not determine X") as problem:
        calibrate(simulate(30, hand=spread, eye=spread, turn=0.0, gross=OutlierModel(share)))
    assert np.linalg.matrix_rank(slides(problem.value)) == 3


def test_a_hand_that_did_not_move_is_refused() -> None:
    still = np.tile(np.eye(3), (10, 1, 1)), np.zeros((10, 3))
    with pytest.raises(SamplesError, match="turn about any axis and be anywhere"):
        calibrate_hand_eye(still, still)


@pytest.mark.parametrize("seed", first_of(range(3)))
def test_nearly_parallel_axes_are_refused_or_honestly_uncertain(seed: int) -> None:
    """Axes some degrees apart: what is answered lies within what is claimed."""
    side = np.array([2.0, 1.0, 2.0]) / 3.0
    for degrees in (1.0, 6.0, 12.0):
        other = rotation_from_vector(np.radians(degrees) * side) @ SKEW_AXIS
        data = noisy(30, seed=seed, axes=np.array([SKEW_AXIS, other]))
        if degrees < 2.0:
            with pytest.raises(SamplesError, match="slide along") as problem:
                calibrate(data)
            assert abs(slides(problem.value)[0] @ SKEW_AXIS) > 0.98
            continue
        found = calibrate(data)
        claimed = float(np.linalg.norm(found.std["X"][:3]))
        assert errors(found, data)[1] < 4.0 * claimed
        assert claimed < 2e-3 or found.assessment.level == "care"


def test_too_few_pairs_are_refused() -> None:
    data = simulate(5)
    for count in (0, 1, 2):
        rows = np.arange(count)
        with pytest.raises(SamplesError, match=f"{count} pairs of poses; expected at least 3"):
            calibrate_hand_eye(rows_of(data.poses, rows), rows_of(data.seen, rows))
    with pytest.raises(SamplesError, match="5 poses of the hand and 4 of the target"):
        calibrate_hand_eye(data.poses, rows_of(data.seen, np.arange(4)))


def test_pairs_that_do_not_belong_together_are_called_so() -> None:
    rng = np.random.default_rng(0)
    A, B = (
        (rotation_from_vector(rng.uniform(-2, 2, (20, 3))), rng.uniform(-0.3, 0.3, (20, 3)))
        for _ in range(2)
    )
    with pytest.raises(SamplesError, match="pair by pair"):
        calibrate_hand_eye(A, B)


# ── Poses that are read in the wrong way ─────────────────────────────────────────────────────
def w_first(poses: Poses) -> Poses:
    """Poses whose quaternions were written w x y z and are read x y z w."""
    quaternion = Rotation.from_matrix(poses[0].copy()).as_quat()
    return Rotation.from_quat(np.roll(quaternion, 1, axis=1)).as_matrix(), poses[1]


def same(poses: Poses) -> Poses:
    return poses


OTHER_SETUP = "if setup is eye-to-hand, or if the poses of the hand or of the camera are inverted"
Change = Callable[[Poses], Poses]
MISREAD: dict[str, tuple[Change, Change, str]] = {
    "hand inverted, or the other setup": (inverse_poses, same, OTHER_SETUP),
    "eye inverted": (same, inverse_poses, OTHER_SETUP),
    "hand w x y z": (w_first, same, "if the hand's quaternions are in the order w x y z"),
    "eye w x y z": (same, w_first, "if the camera's quaternions are in the order w x y z"),
    "both w x y z": (w_first, w_first, "if all quaternions are in the order w x y z"),
}


def misread(which: str, hand: Poses, seen: Poses) -> tuple[Poses, Poses, str]:
    of_hand, of_eye, says = MISREAD[which]
    return of_hand(hand), of_eye(seen), says


def agreeing_if(says: str, hand: Poses, seen: Poses) -> tuple[float, float]:
    """To how many mm and degrees pairs are said to agree if they are read in another way."""
    with pytest.raises(SamplesError, match="do not agree with any X") as problem:
        calibrate_hand_eye(hand, seen)
    said = str(problem.value)
    assert said.endswith(says)
    assert "turn the hand" not in said
    slid, turned = re.search(r"they agree to ([\d.]+) mm and ([\d.]+)°", said).groups()
    return float(slid), float(turned)


@pytest.mark.parametrize(("seed", "share"), [(0, 0.0), (1, 0.3)])
@pytest.mark.parametrize("which", MISREAD)
def test_poses_read_in_the_wrong_way_are_told_so(which: str, seed: int, share: float) -> None:
    data = noisy(20, seed=seed, gross=OutlierModel(share))
    hand, seen, says = misread(which, data.poses, data.seen)
    slid, turned = agreeing_if(says, hand, seen)
    assert slid < 4.0
    assert turned < 0.5


@pytest.mark.parametrize("which", MISREAD)
def test_five_pairs_are_enough_to_tell(which: str) -> None:
    data = noisy(5, seed=2)
    hand, seen, says = misread(which, data.poses, data.seen)
    with pytest.raises(SamplesError, match=says):
        calibrate_hand_eye(hand, seen)


def test_an_eye_beside_the_robot_is_told_the_other_setup() -> None:
    data = noisy(20)
    with pytest.raises(SamplesError, match="if setup is eye-in-hand"):
        calibrate_hand_eye(data.poses, data.seen, setup="eye-to-hand")


def transposed(poses: Poses) -> Poses:
    return np.swapaxes(poses[0], 1, 2), poses[1]


def with_signs(poses: Poses, *signs: float) -> Poses:
    return poses[0], poses[1] * np.array(signs)


def in_unit(poses: Poses, unit: float) -> Poses:
    return poses[0], poses[1] / unit


def mirrored(poses: Poses) -> Poses:
    """As a game engine writes them: y has the other sense."""
    M = np.diag([1.0, -1.0, 1.0])
    return M @ poses[0] @ M, poses[1] @ M


def rows_later(poses: Poses, rows: int) -> Poses:
    return rows_of(poses, np.roll(np.arange(len(poses[1])), rows))


WRITTEN: dict[str, tuple[Change, Change]] = {
    "if the hand's rotations are transposed, its positions not": (transposed, same),
    "if the camera's rotations are transposed, its positions not": (same, transposed),
    "if y, z of the camera's positions have the wrong sign, its rotations not": (
        same,
        lambda poses: with_signs(poses, 1.0, -1.0, -1.0),
    ),
    "if the hand's or the camera's frame is left-handed": (mirrored, same),
    "if the hand's positions are in mm, the camera's in m": (
        lambda poses: in_unit(poses, 1e-3),
        same,
    ),
    "if the camera's positions are in mm, the hand's in m": (
        same,
        lambda poses: in_unit(poses, 1e-3),
    ),
    "if the camera's positions are in inches, the hand's in m": (
        same,
        lambda poses: in_unit(poses, 0.0254),
    ),
    "if the target poses are a row late": (same, lambda poses: rows_later(poses, 1)),
    "if the target poses are 4 rows early": (same, lambda poses: rows_later(poses, -4)),
    "if the target poses are in the opposite order": (
        same,
        lambda poses: rows_of(poses, np.arange(len(poses[1]))[::-1]),
    ),
}


@pytest.mark.parametrize(
    ("says", "count"),
    [*((says, 20) for says in WRITTEN), ("if the target poses are a row late", 300)],
)
def test_poses_written_in_another_way_are_told_so(says: str, count: int) -> None:
    data = noisy(count, seed=3)
    of_hand, of_eye = WRITTEN[says]
    slid, _ = agreeing_if(says, of_hand(data.poses), of_eye(data.seen))
    assert slid < 20.0 * mm(NOISE.position)


def test_positions_that_no_unit_mends_are_not_blamed_on_how_the_hand_turned() -> None:
    data = noisy(20, seed=3)
    exchanged = data.poses[0], data.poses[1][:, [0, 2, 1]]
    with pytest.raises(SamplesError, match="columns in the order x y z") as problem:
        calibrate_hand_eye(exchanged, data.seen)
    assert "turn the hand" not in str(problem.value)


@pytest.mark.parametrize("noise", [NOISE, PoseNoise(5e-3, 0.02)], ids=["fine", "coarse"])
@pytest.mark.parametrize("count", [4, 6, 15])
def test_poses_read_rightly_are_never_told_another_way(count: int, noise: PoseNoise) -> None:
    wrong = OutlierModel(0.3, NATURES[count % 3])  # type: ignore[arg-type]
    for seed, gross in enumerate((OutlierModel(), wrong)):
        data = simulate(count, hand=noise, eye=noise, seed=seed, gross=gross)
        assert "they agree to" not in said_of(data)


def said_of(data: Simulated[HandEye]) -> str:
    """What is said against the pairs; nothing where they are calibrated with."""
    try:
        calibrate(data)
    except SamplesError as problem:
        return str(problem)
    return ""


@pytest.mark.parametrize(("count", "seed"), [(5, 3), (8, 2), (12, 0), (30, 1)])
def test_shuffled_pairs_are_not_blamed_on_how_the_hand_turned(count: int, seed: int) -> None:
    data = noisy(count, seed=seed)
    mixed = np.random.default_rng(seed).permutation(count)
    with pytest.raises(SamplesError, match="do the rows belong together") as problem:
        calibrate_hand_eye(data.poses, rows_of(data.seen, mixed))
    assert "turn the hand" not in str(problem.value)


# ── A side that stands still ─────────────────────────────────────────────────────────────────
def repeating(poses: Poses, rows: FloatArray) -> Poses:
    """Poses of a program that wrote the first one again in these rows."""
    R, p = poses[0].copy(), poses[1].copy()
    R[rows], p[rows] = R[0], p[0]
    return R, p


@pytest.mark.parametrize(("same", "which"), [(12, "all 12 rows"), (10, "10 of 12 rows")])
@pytest.mark.parametrize("side", [0, 1])
def test_a_side_whose_pose_does_not_change_is_named(side: int, same: int, which: str) -> None:
    data = noisy(12)
    sides = [data.poses, data.seen]
    sides[side] = repeating(sides[side], np.arange(same))
    whose = (r"a pose of the hand \(a_\)", r"a pose of the target \(b_\)")
    said = f"{whose[side]} that is the same in {which}, while {whose[1 - side]} changes by"
    with pytest.raises(SamplesError, match=said) as problem:
        calibrate_hand_eye(*sides)
    assert "read this pose only once" in str(problem.value)
    assert "setup" not in str(problem.value)


def test_a_target_that_is_seen_many_times_from_one_pose_is_no_fault() -> None:
    """40 pictures at rest, and ten poses beside them: the eye's noise does not move the target."""
    data = noisy(50, seed=4)
    rest = np.concatenate([np.zeros(40, dtype=int), np.arange(1, 11)])
    R, p = rows_of(data.seen, rest)
    p = p + 3e-3 * np.random.default_rng(0).standard_normal((50, 3))
    refuse_constant(rows_of(data.poses, rest), (R, p))
