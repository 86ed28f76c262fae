"""Arms of wrong geometry: pictures left out, X near the truth, and honest standard deviations."""

from __future__ import annotations

import numpy as np
import pytest
from arm_scenes import BOARD, arm_pictures, truth
from camera_scenes import CAMERA, LENS, errors, pictures, solved
from cli_job import answer

from suta_calib.geometry import projected
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.measurements import Camera
from suta_calib.pose_calibration.correlation import shared_errors
from suta_calib.pose_calibration.picture_answer import PictureCalibration
from suta_calib.pose_calibration.picture_models import (
    AS_GOOD,
    AS_GOOD_AS_BENT,
    FOLDS,
    MODELS,
    SEED,
)
from suta_calib.pose_calibration.picture_rows import picture_errors
from suta_calib.report.document import Text
from suta_calib.report.pictures import picture_document
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms.external_frame import pose_named
from suta_calib.terms.hand_eye_start import Poses, inverse_poses

EXACT = MODELS[-1]


def plain(found: PictureCalibration) -> tuple[Poses, Poses]:
    """X and Z of least squares of the reprojection errors, the hand where it says."""
    (term,) = found.solution.problem.terms
    eye, board, _ = term.owners
    return pose_named(found.solution.values, eye), pose_named(found.solution.values, board)


def off(found: Poses, true: Poses) -> np.ndarray:
    """Displacement, m, and turn, rad, of a pose against the truth, (6,)."""
    return np.concatenate([found[1] - true[1], vector_from_rotation(true[0].T @ found[0])])


@pytest.mark.parametrize("wrong", ["geometry", "eccentric"])
def test_an_arm_of_wrong_geometry_is_calibrated_nearer_to_the_truth(wrong: str) -> None:
    """And pictures left out are foretold as well as by least squares."""
    ours, least_squares = [], []
    for seed in (1, 3):
        found = solved(arm_pictures(seed, **{wrong: 1.0}), intrinsics="fixed")
        assert found.left_out is not None
        assert found.left_out <= AS_GOOD * found.errors[EXACT].left_out
        true, _ = truth("eye-in-hand")
        ours.append(errors(found.cameras[0], *truth("eye-in-hand"))[:6])
        least_squares.append(off(plain(found)[0], true))
        assert not found.outliers
    squares = [np.square(each) for each in (ours, least_squares)]
    shift, turn = (
        np.sqrt(np.mean(squares[0][:, part]) / np.mean(squares[1][:, part]))
        for part in (slice(0, 3), slice(3, 6))
    )
    assert shift < 0.9
    assert turn < 0.95


def test_pictures_left_out_are_foretold_as_if_they_had_never_been() -> None:
    """One linearisation serves all folds; here each is solved anew by least squares."""
    scene = arm_pictures(2, count=15, geometry=1.0)
    whole = solved(scene, intrinsics="fixed", robust=False)
    (term,) = whole.solution.problem.terms
    fold = np.empty(15)
    fold[np.random.default_rng(SEED).permutation(15)] = np.arange(15) % FOLDS
    points, squares = np.array(list(BOARD.points.values())), []
    for k in range(FOLDS):
        rest = solve(Problem([term.take(np.flatnonzero(fold != k))])).values
        X, Z = (pose_named(rest, owner) for owner in term.owners[:2])
        for row in np.flatnonzero(fold == k):
            R, p = (part[row] for part in scene.hand.pose)
            eye = R @ X[0], R @ X[1] + p
            turn, shift = inverse_poses(eye)
            seen = projected((points @ Z[0].T + Z[1]) @ turn.T + shift, LENS)
            mine = scene.views[0].corners.image == scene.hand.image[row]
            squares.append(np.sum((seen - scene.views[0].corners.pixel[mine]) ** 2, axis=1))
    assert whole.errors[EXACT].left_out == pytest.approx(np.sqrt(np.mean(squares)), rel=0.02)
    residual = picture_errors(term, whole.solution.values).residual
    rms = np.sqrt(np.mean(np.sum(residual**2, axis=1)))
    assert whole.errors[EXACT].fitted == pytest.approx(rms, rel=0.01)


def test_intrinsics_that_are_fixed_follow_no_pixels() -> None:
    found = solved(arm_pictures(2, geometry=1.0), intrinsics="fixed")
    held, *bent = (e.left_out for model, e in found.errors.items() if model.share == 1.0)
    assert len(bent) == 4
    assert bent == pytest.approx([held] * 4)
    assert not found.error_model.camera_share


@pytest.mark.slow
def test_intrinsics_that_take_up_the_errors_of_an_arm_are_told() -> None:
    """Only where they predict pictures left out better than any frames do."""
    scene = arm_pictures(4, setup="eye-to-hand", geometry=1.0)
    found = solved(scene, setup="eye-to-hand")
    assert 0.0 < found.error_model.camera_share < 1.0
    assert found.left_out is not None
    limit = AS_GOOD_AS_BENT * found.errors[EXACT].left_out
    frames = [e.left_out for model, e in found.errors.items() if not model.camera_share]
    assert found.left_out <= limit < min(frames)
    said = [
        part.text for part in picture_document(found, scene.hand).parts if isinstance(part, Text)
    ]
    assert any("the intrinsics take up what is an error of the arm" in text for text in said)


def test_hands_that_err_each_for_itself_share_nothing() -> None:
    """What they share is no evidence then, and pictures are weighed as before."""
    found = solved(pictures(24, pixel=0.1, robot=(3e-4, 5e-4), seed=2))
    assert found.noise.shared == (0.0, 0.0)
    assert found.error_model.name == "hand-errors"
    wrong = solved(arm_pictures(0, geometry=1.0), intrinsics="fixed")
    assert wrong.noise.shared[0] > 3e-4


def test_shared_errors_are_about_as_large_as_their_coefficients() -> None:
    """In every direction; few poses share nothing that could be told."""
    R, p = arm_pictures(0).hand.pose
    every = shared_errors(R, p)
    smooth = every[:, :, :-12]
    assert np.allclose(np.sum(smooth**2, axis=2), 1.0, atol=0.1)
    assert shared_errors(R[:5], p[:5]).shape == (5, 6, 0)


def ratios(setup: str, trials: int, **wrong: float) -> float:
    """Mean square of the errors of X in their standard deviations."""
    found = []
    for seed in range(trials):
        (seen,) = solved(
            arm_pictures(seed, setup=setup, **wrong), setup=setup, intrinsics="fixed"
        ).cameras
        found.append(errors(seen, *truth(setup))[:6] / seen.std["X"])
    return float(np.mean(np.square(found)))


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("wrong", ["geometry", "eccentric"])
def test_standard_deviations_hold_for_arms_of_wrong_geometry(setup: str, wrong: str) -> None:
    """Errors of one arm are all of a kind: a third to three times what is stated."""
    assert 0.3 < ratios(setup, 40, **{wrong: 1.0}) < 3.0


def test_what_held_intrinsics_would_give_is_told(tmp_path) -> None:
    """As `--intrinsics fixed` gives it, where the file's own ± is next to nothing."""
    sure = Camera(1280, 960, LENS, np.diag([0.05, 0.05, 0.05, 0.05, *[1e-5] * 5]) ** 2)
    scene = pictures(20, pixel=0.1, robot=(2e-4, 3e-4), given=sure)
    free, fixed = (solved(scene, intrinsics=how).cameras[0] for how in ("free", "fixed"))
    held = free.if_held
    assert held.std == pytest.approx(fixed.std["X"], rel=0.2)
    assert np.abs(held.X - fixed.X).max() < 0.3 * fixed.std["X"][:3].max()
    assert fixed.if_held is None
    assert solved(pictures(12, pixel=0.1, given=CAMERA)).cameras[0].if_held is None
    record = answer("hand-eye", *scene.written(tmp_path))
    assert set(record["intrinsics_held"]) == {"X", "std"}
    assert record["reprojection_left_out_rms_px"] > 0.1
    assert record["hand_noise"]["model"] == "hand-errors"
