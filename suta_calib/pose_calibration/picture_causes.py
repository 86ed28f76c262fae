"""Why pictures and poses agree with no X: another size, a mirror, a camera of another file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from suta_calib.arrays import BoolArray
from suta_calib.errors import InputError, SamplesError
from suta_calib.measurements import Camera, Corners
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration, calibrate_hand_eye
from suta_calib.pose_calibration.hand_eye_causes import SUSPICIOUS, TURNED
from suta_calib.pose_calibration.robust_answer import MANY_OUTLIERS
from suta_calib.terms import CameraView
from suta_calib.terms.hand_eye_start import (
    EyeSetup,
    Poses,
    as_eye_in_hand,
    motion_scale,
    some_poses,
)
from suta_calib.terms.lens_choice import camera_alone
from suta_calib.trust.hypotheses.moved_at_a_row import Moved, moved_text


def cause_of_disagreement(
    term: CameraView, corners: Corners, given: Camera | None, seed: int
) -> tuple[str, str]:
    """What is wrong with pictures that agree with no X, and what to do; empty if unknown."""
    _, hand, board = usable_poses(term)
    scale, _ = motion_scale(as_eye_in_hand(hand, term.setup), board)
    # Ratio of two sizes that no measuring error explains.
    if scale > 0 and abs(np.log(scale)) > np.log(1.3):
        larger = (hand, (board[0], board[1] * scale))
        if _agrees(*larger, term.setup, seed):
            return (
                f"a hand that moves {scale:.{0 if scale > 5 else 2}f} times as far as the "
                "pictures show with the size of the board",
                "columns a_x, a_y, a_z are in m (a_x_mm: mm), and lengths in board.yaml in mm",
            )
    for sentence, read in term.misread:
        if _agrees(*usable_poses(read)[1:], term.setup, seed):
            return (
                f"pictures that agree with the poses if {sentence}",
                "u counts from the left and v from the top of pictures that are not mirrored",
            )
    if given is None:
        return "", ""
    try:
        estimated, _ = camera_alone(corners, term.board, given.lens)
    except InputError:
        return "", ""
        return "", ""
    before, after = given.values["fx"], estimated.values["fx"]
    # Of two focal lengths of one camera, another focus.
    if abs(np.log(after / before)) < np.log(1.1):
        return "", ""
    if _agrees(*usable_poses(replace(term, camera=estimated))[1:], term.setup, seed):
        return (
            f"pictures with a focal length of about {after:.0f} px, where the camera's file "
            f"states {before:.0f} px",
            "the file must be for this camera, this focus and this size of picture",
        )
    return "", ""


def moved_between_pictures(term: CameraView, good: BoolArray) -> str:
    """What was moved while pictures (n,) were taken, in a sentence; empty if nothing was.

    By the board's pose in each picture, with the camera as it was found.
    """
    term = term.take(good)
    posed, hand, board = usable_poses(term)
    try:
        found = calibrate_hand_eye(hand, board, setup=term.setup).finding(Moved.name)
    except SamplesError:
        return ""
    images = term.poses.samples.labels["image"][posed].tolist()
    return moved_text(found.evidence, "pictures", images) if found else ""


def loose(answer: HandEyeCalibration) -> bool:
    """Whether pairs agree so badly that pictures which are read wrongly are more likely."""
    scatter = answer.rms / np.sqrt(3.0) / answer.length
    return bool(scatter > SUSPICIOUS and answer.rms_angle / np.sqrt(3.0) > TURNED)


def usable_poses(term: CameraView) -> tuple[BoolArray, Poses, Poses]:
    """(n,) pictures that tell where the board is, and poses of the hand and the board there."""
    posed = np.isfinite(term.seen_poses[1][:, 0])
    return posed, some_poses(term.poses.at({}), posed), some_poses(term.seen_poses, posed)


def _agrees(hand: Poses, eye: Poses, setup: EyeSetup, seed: int) -> bool:
    """Whether poses determine an X that most of them agree with."""
    if not (np.isfinite(hand[1]).all() and np.isfinite(eye[1]).all()):
        return False
    try:
        answer = calibrate_hand_eye(hand, eye, setup=setup, seed=seed)
    except SamplesError:
        return False
    return bool(answer.inliers.mean() > 1.0 - MANY_OUTLIERS) and not loose(answer)
