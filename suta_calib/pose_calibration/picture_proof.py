"""What is proven of an answer from pictures: its start, and that it is reached from there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import attempt
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.model.parameters import PLACEMENT
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration, calibrate_hand_eye
from suta_calib.pose_calibration.optimality import PictureOptimality
from suta_calib.pose_calibration.picture_answer import PictureCalibration
from suta_calib.pose_calibration.picture_causes import usable_poses
from suta_calib.pose_calibration.proof import leads_to, with_proof
from suta_calib.terms import CameraView


def pictures_with_proof(answer: PictureCalibration) -> PictureCalibration:
    """The same answer with what is proven of it.

    Reprojection errors have no convex bound. The closed problem on the board's pose by every
    picture has one; the reprojection errors, followed downhill from its minimum, must end in the
    answer.
    """
    failed = list[str]()
    start = attempt("proven: where the answer started", lambda: _proof(answer), None, failed)
    notes = [] if start is None or start.good else [start.sentence]
    return replace(answer, optimality=start, notes=(*answer.notes, *notes, *failed))


def _proof(answer: PictureCalibration) -> PictureOptimality:
    solution, start = answer.solution, answer.solution.x.copy()
    proven, placed = list[HandEyeCalibration](), set[str]()
    for term, camera in zip(solution.problem.terms, answer.cameras, strict=True):
        assert isinstance(term, CameraView)
        _, hand, board = usable_poses(replace(term, camera=camera.camera))
        by_poses = with_proof(calibrate_hand_eye(hand, board, setup=answer.setup))
        proven.append(by_poses)
        eye, target, _ = term.owners
        for owner, pose in ((eye, by_poses.X), (target, by_poses.Z)):
            # Cameras that share a board have one Z: that of the first.
            if owner not in placed:
                names = solution.problem.names
                start[[names.index(f"{owner}.{key}") for key in PLACEMENT]] = _six(pose)
                placed.add(owner)
    optima = [a.optimality for a in proven if a.optimality is not None]
    return PictureOptimality(
        poses_certified=len(optima) == len(proven) and all(o.certified for o in optima),
        poses_gap=max((o.gap for o in optima), default=float("inf")),
        reached=leads_to(solution, start),
    )


def _six(pose: FloatArray) -> FloatArray:
    return np.concatenate([pose[:3, 3], vector_from_rotation(pose[:3, :3])])
