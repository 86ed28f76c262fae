"""Hand-eye calibration in closed form, exact on exact data."""

from __future__ import annotations

import numpy as np
import pytest
from hand_eye_scenes import NOISE, angle, noisy, simulate
from studies import first_of

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.terms import HandEye
from suta_calib.terms.hand_eye_start import (
    Poses,
    close_the_loop,
    inverse_poses,
    quaternion_hand_eye,
)
from suta_calib.terms.synthetic import Simulated


def motions_of(turns: FloatArray, data: Simulated[HandEye]) -> tuple[Poses, Poses]:
    """Poses of hand and eye where each turn (n, 3), rad, follows the one before."""
    X, Z = data.true_pose("hand_eye"), data.true_pose("target")
    R = [np.eye(3)]
    for turn in rotation_from_vector(turns):
        R.append(R[-1] @ turn)
    hand = np.array(R), np.random.default_rng(0).uniform(-0.3, 0.3, (len(R), 3))
    eye = hand[0] @ X[0], hand[0] @ X[1] + hand[1]
    back = inverse_poses(eye)
    return hand, (back[0] @ Z[0], back[0] @ Z[1] + back[1])


HALF_TURN = np.pi * np.array([[1.0, 0, 0], [0, 1.0, 0], [0.6, 0, 0.8], [0, 0, 1.0]])
TURNS = {
    "ordinary": np.random.default_rng(1).uniform(-1.0, 1.0, (6, 3)),
    "half a turn": HALF_TURN,
    "nearly half a turn": HALF_TURN * (1.0 - 1e-9 * np.array([[1.0], [-1.0], [1.0], [-1.0]])),
    "a little more or less": HALF_TURN * (1.0 + 1e-3 * np.array([[1.0], [-1.0], [1.0], [1.0]])),
    "half a turn among others": np.vstack([HALF_TURN[:1], [[0.3, 0.4, -0.2], [0.1, -0.8, 0.3]]]),
    "two motions only": np.array([[0.5, 0.0, 0.0], [0.0, 0.0, -0.4]]),
    "quarter turns": HALF_TURN / 2.0,
    "small turns": np.random.default_rng(2).uniform(-0.03, 0.03, (6, 3)),
}


@pytest.mark.parametrize("which", TURNS)
def test_the_closed_form_is_exact_on_exact_data(which: str) -> None:
    data = simulate(3)
    hand, seen = motions_of(TURNS[which], data)
    X = quaternion_hand_eye(hand, seen)
    for found, true in zip(X, data.true_pose("hand_eye"), strict=True):
        np.testing.assert_allclose(found, true, atol=1e-9)
    Z = close_the_loop(hand, X, seen)
    for found, true in zip(Z, data.true_pose("target"), strict=True):
        np.testing.assert_allclose(found, true, atol=1e-9)


@pytest.mark.parametrize("seed", first_of(range(4)))
def test_half_turns_with_noise_do_not_confuse_the_quaternions_signs(seed: int) -> None:
    """Noise decides on which side of half a turn a motion lies, for hand and eye separately.

    The other motions tell the sign, though they be the fewer.
    """
    data, random = simulate(3), np.random.default_rng(seed)
    about = random.standard_normal((12, 3))
    turns = about / np.linalg.norm(about, axis=1, keepdims=True)
    turns[:8] *= np.pi
    hand, seen = motions_of(random.permutation(turns), data)
    X = quaternion_hand_eye(NOISE.scattered(random, hand), NOISE.scattered(random, seen))
    assert angle(X[0], data.true_pose("hand_eye")[0]) < np.radians(0.5)
    assert np.linalg.norm(X[1] - data.true_pose("hand_eye")[1]) < 3e-3


def test_many_sets_at_once_are_solved_like_each_alone() -> None:
    sets = [noisy(6, seed=seed) for seed in range(5)]
    hand, seen = (
        tuple(np.stack(part) for part in zip(*poses, strict=True))
        for poses in ([d.poses for d in sets], [d.seen for d in sets])
    )
    R, p = quaternion_hand_eye(hand, seen)  # type: ignore[arg-type]
    for k, data in enumerate(sets):
        alone = quaternion_hand_eye(data.poses, data.seen)
        np.testing.assert_allclose(R[k], alone[0], atol=1e-12)
        np.testing.assert_allclose(p[k], alone[1], atol=1e-12)
