"""Simulated pictures of a board: hands that carry a camera about it, or it before a camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry import projected
from suta_calib.geometry.numbers import (
    quaternion_from_rotation,
    rotation_from_vector,
    vector_from_rotation,
)
from suta_calib.measurements import (
    Board,
    Camera,
    Chessboard,
    Corners,
    corners_of,
    write_board,
    write_camera,
    write_corners,
)
from suta_calib.measurements.pose_files import HandPoses
from suta_calib.pose_calibration.picture_answer import CameraEstimate, PictureCalibration
from suta_calib.pose_calibration.pictures import View, hand_eye_from_pictures
from suta_calib.terms.hand_eye_start import Poses, inverse_poses

BOARD = Chessboard(6, 5, 0.03)
LENS = np.array([1000.0, 1004.0, 642.0, 476.0, -0.1, 0.03, 4e-4, -3e-4, 0.0])
CAMERA = Camera(1280, 960, LENS)
X = rotation_from_vector([0.1, 0.2, -1.5]), np.array([0.02, -0.05, 0.08])
SECOND = rotation_from_vector([0.0, -0.3, 0.4]), np.array([-0.06, 0.04, 0.05])
Z = rotation_from_vector([2.8, 0.3, 0.2]), np.array([0.6, 0.2, -0.1])


@dataclass(frozen=True, eq=False)
class Pictures:
    """Poses of the hand, and what cameras saw."""

    hand: HandPoses
    views: tuple[View, ...]

    def written(self, folder: Path) -> list[object]:
        """Files of one camera, and the options that name them."""
        (view,) = self.views
        write_hand(folder / "poses.csv", self.hand)
        write_corners(folder / "corners.csv", view.corners)
        write_board(folder / "board.yaml", view.board)
        options: list[object] = [folder / "poses.csv", "--corners", folder / "corners.csv"]
        options += ["--board", folder / "board.yaml"]
        if view.camera is not None:
            write_camera(folder / "camera.yaml", view.camera)
            options += ["--camera", folder / "camera.yaml"]
        return options


def write_hand(path: Path, hand: HandPoses) -> None:
    rotation, position = hand.pose
    numbers = np.hstack([position, quaternion_from_rotation(rotation)])
    rows = [
        ",".join([name, *map(repr, row)])
        for name, row in zip(hand.image.tolist(), numbers.tolist(), strict=True)
    ]
    path.write_text("\n".join(["image,a_x,a_y,a_z,a_qx,a_qy,a_qz,a_qw", *rows]) + "\n")


def pictures(
    count: int = 16,
    *,
    setup: str = "eye-in-hand",
    pixel: float = 0.0,
    robot: tuple[float, float] = (0.0, 0.0),
    seed: int = 0,
    eyes: tuple[Poses, ...] = (X,),
    board: Board = BOARD,
    given: Camera | None = CAMERA,
    lens: FloatArray = LENS,
) -> Pictures:
    """A camera looks at a board from all sides, half a metre away.

    Args:
        count: of pictures.
        setup: where the cameras are.
        pixel: scatter of a corner, px.
        robot: scatter of a reported pose, m and rad.
        seed: of everything random.
        eyes: ``T_hand_eye`` of every camera, the first of which sees the board well; beside the
            robot one stands where the board would, and holds the board where it would be.
        board: that is seen.
        given: the camera as it is said to be.
        lens: its true intrinsics.
    """
    random, noise, arm = np.random.default_rng(seed).spawn(3)
    points = np.array(list(board.points.values()))
    lean = random.uniform(-0.6, 0.6, (count, 3)) * [1.0, 1.0, 2.0]
    ahead = np.column_stack(
        [random.uniform(-0.06, 0.06, (count, 2)), random.uniform(0.4, 0.7, count)]
    )
    seen = rotation_from_vector(lean), ahead
    seen = seen[0], ahead - seen[0] @ points.mean(axis=0)
    first = eyes[0]
    if setup == "eye-in-hand":
        # T_base_hand = Z (X T_eye_board)⁻¹.
        hand = after(Z, inverse_poses(after(first, seen)))
    else:
        hand = after(after(Z, seen), inverse_poses(X))
    names = np.array([f"{k:03d}.png" for k in range(count)])
    views = []
    for k, eye in enumerate(eyes):
        moving = after(hand, eye) if setup == "eye-in-hand" else Z
        there = Z if setup == "eye-in-hand" else after(hand, X)
        R, p = after(inverse_poses(moving), there)
        pixels = projected(np.einsum("nij,kj->nki", R, points) + p[:, None], lens)
        pixels = pixels + pixel * noise.standard_normal(pixels.shape)
        image, point = np.nonzero(CAMERA.inside(pixels))
        numbers = np.array(list(board.points))
        corners = corners_of(names[image], numbers[point], pixels[image, point])
        views.append(View("default" if len(eyes) == 1 else str(k), corners, board, given))
    R, p = hand
    R = R @ rotation_from_vector(robot[1] * arm.standard_normal(p.shape))
    p = p + robot[0] * arm.standard_normal(p.shape)
    lines = tuple(range(2, count + 2))
    poses = HandPoses(path=Path("poses.csv"), lines=lines, pose=(R, p), image=names)
    return Pictures(poses, tuple(views))


def after(outer: Poses, inner: Poses) -> Poses:
    """``T_a_c = T_a_b T_b_c``, of one pose or of many."""
    (R, p), (turn, shift) = outer, inner
    return R @ turn, np.einsum("...ij,...j->...i", R, shift) + p


def changed(corners: Corners, **arrays: FloatArray) -> Corners:
    """Corners with other points, pixels or images."""
    return replace(corners, **arrays)


def solved(scene: Pictures, **more: Any) -> PictureCalibration:
    """The calibration of X and Z, the eye on the hand unless something else is said."""
    options: dict[str, Any] = {"setup": "eye-in-hand", "model": "AX=ZB"}
    return hand_eye_from_pictures(scene.hand, scene.views, **options | more)


def errors(seen: CameraEstimate, eye: Any = X, board: Any = Z) -> np.ndarray:
    """Displacement, m, and turn, rad, of X and of Z against the truth, (12,)."""
    found = []
    for T, (R, p) in ((seen.X, eye), (seen.Z, board)):
        found += [T[:3, 3] - p, vector_from_rotation(R.T @ T[:3, :3])]
    return np.concatenate(found)
