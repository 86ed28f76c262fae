"""Eyes that share a hand's errors, and see unequally well: noise of each, and its ±."""

from __future__ import annotations

import numpy as np
import pytest
from many_eyes import EYES, FINE, TARGETS, Scene, pose_errors, scene

from suta_calib.arrays import FloatArray
from suta_calib.pose_calibration import shared_hand
from suta_calib.pose_calibration.many_eyes import ManyEyesCalibration, calibrate_many_eyes
from suta_calib.terms.hand_eye_start import some_poses
from suta_calib.terms.synthetic import EXACT, PoseNoise

# A good eye, a fair one, and one that is twenty times worse than the first.
UNEQUAL = [
    PoseNoise(1e-4, float(np.radians(0.03))),
    FINE,
    PoseNoise(2e-3, float(np.radians(0.6))),
]


def calibrate(data: Scene) -> ManyEyesCalibration:
    return calibrate_many_eyes(data.hand, data.seen, eye=data.eye, target=data.target)


def errors_over_std(found: ManyEyesCalibration, data: Scene) -> FloatArray:
    """(eyes + targets, 6) in the order of their names."""
    parts = []
    for poses, names, truth in ((found.eyes, EYES, data.X), (found.targets, TARGETS, data.Z)):
        by_name = sorted(poses, key=lambda one: names.tolist().index(one.name))
        off = pose_errors(np.array([one.pose for one in by_name]), truth)
        parts.append(off / np.array([one.std6 for one in by_name]))
    return np.vstack(parts)


def test_the_noise_of_the_hand_and_of_each_eye_is_found() -> None:
    data = scene(3, 2, 40, seed=3, eye=UNEQUAL)
    found = calibrate(data)
    assert found.noise is not None
    hand, *eyes = found.noise
    # Every variance is asked of some 120 numbers, less what the unknowns and the hand took.
    np.testing.assert_allclose(hand, [FINE.position, FINE.rotation], rtol=0.35)
    by_name = {one.name: noise for one, noise in zip(found.eyes, eyes, strict=True)}
    for name, true in zip(EYES[1:3], UNEQUAL[1:], strict=True):
        np.testing.assert_allclose(by_name[name], [true.position, true.rotation], rtol=0.35)
    # Beside a hand that errs ten times as much, little is left of the good eye.
    assert by_name["left"][0] < 0.7 * FINE.position
    assert (np.abs(errors_over_std(found, data)) < 4.0).all()
    assert found.inliers.all()


def test_a_bad_eye_does_not_spoil_a_good_one() -> None:
    data = scene(3, 1, 40, seed=5, eye=UNEQUAL)
    good = np.flatnonzero(data.eye != "top")
    hand, seen = (some_poses(poses, good) for poses in (data.hand, data.seen))
    without = calibrate_many_eyes(hand, seen, eye=data.eye[good], target=data.target[good])
    found = calibrate(data)
    for name in EYES[:2]:
        with_bad, alone = (
            next(one for one in answer.eyes if one.name == name) for answer in (found, without)
        )
        assert np.linalg.norm(with_bad.std6[:3]) < 1.15 * np.linalg.norm(alone.std6[:3])
        assert np.abs(with_bad.pose[:3, 3] - alone.pose[:3, 3]).max() < 0.1e-3


def test_errors_of_the_hand_that_eyes_share_leave_the_poses() -> None:
    """Eyes that are exact: what the hand errs by is seen by all of them, and taken out."""
    data = scene(3, 1, 30, seed=2, eye=PoseNoise(1e-5, 1e-5))
    found = calibrate(data)
    T, std = found.relative("left", "right")
    left, right = (some_poses(data.X, np.array([k])) for k in range(2))
    R = left[0][0].T @ right[0][0]
    p = left[0][0].T @ (right[1][0] - left[1][0])
    off = pose_errors(T[None], (R[None], p[None]))[0]
    assert np.abs(off[:3]).max() < 2e-5
    assert (np.abs(off) < 4.0 * std).all()


def test_an_eye_of_few_rows_errs_as_the_others_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """The variances are asked of part of the rests, in which the third eye has no row."""
    monkeypatch.setattr(shared_hand, "ENOUGH", 20)
    data = scene(3, 1, 30, seed=6)
    kept = (data.eye != "top") | np.isin(np.arange(90) // 3, [4, 5, 6])
    hand, seen = (some_poses(poses, kept) for poses in (data.hand, data.seen))
    found = calibrate_many_eyes(hand, seen, eye=data.eye[kept], target=data.target[kept])
    (top,) = (eye for eye in found.eyes if eye.name == "top")
    assert top.noise is not None
    assert 0.4 * FINE.position < top.noise[0] < 2.5 * FINE.position
    off = pose_errors(top.pose[None], some_poses(data.X, np.array([2])))[0]
    assert (np.abs(off / top.std6) < 4.0).all()


def test_rows_of_eyes_that_never_look_from_one_rest_tell_nothing_of_the_hand() -> None:
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert calibrate(scene(2, 1, 30, axes=axes, hand=EXACT)).noise is None


@pytest.mark.slow
@pytest.mark.parametrize("eye", [FINE, UNEQUAL])
def test_standard_deviations_are_true(eye: PoseNoise | list[PoseNoise]) -> None:
    """Forty sets: rms of errors over ±, displacements and turns of each eye and target."""
    ratios, levels = [], []
    for seed in range(40):
        data = scene(3, 2, 30, seed=seed, eye=eye)
        found = calibrate(data)
        ratios.append(errors_over_std(found, data).reshape(5, 2, 3))
        levels.append(found.assessment.level)
    rms = np.sqrt(np.mean(np.square(ratios), axis=(0, 3)))
    # Of 120 numbers each, of which eyes that share a hand have much in common.
    assert (rms > 0.8).all()
    assert (rms < 1.2).all()
    assert levels.count("good") >= 38
