"""Make the simulated workcell again: ``python data/workcell/make.py``; needs the extra vision."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib import ArmModel
from suta_calib.geometry import projected, quaternion_from_rotation
from suta_calib.measurements import (
    Camera,
    Chessboard,
    LengthScale,
    Samples,
    write_board,
    write_camera,
    write_corners,
    write_samples,
    write_text,
)
from suta_calib.vision import RenderOptions, detect, find_pictures, rendered

FOLDER = Path(__file__).resolve().parent
PICTURES, HELD_OUT = 18, 10
HOME = np.radians([0.0, 30.0, 80.0, 0.0, 70.0, 0.0])
REACH = np.radians([22.0, 14.0, 14.0, 45.0, 30.0, 100.0])
# The arm as it is; what is not here is as in arm.urdf.
ARM = {
    **{"joint_2.offset": 0.0052, "joint_3.offset": -0.0068, "joint_4.offset": 0.0041},
    **{"joint_5.offset": -0.0057, "joint_3.z": 0.4009, "joint_5.z": 0.1494},
}
CAMERA = Camera(640, 480, np.array([612.4, 612.9, 324.8, 236.1, -0.112, 0.087, 0.0006, -0.0004, 0]))
BOARD = Chessboard(9, 6, 0.025, scale=LengthScale(1e-4))
ENCODER = 2e-5  # rad
# Standard deviations of a calibration of the camera on another day, of which camera.yaml is one.
KNOWN = np.array([0.5, 0.5, 0.8, 0.7, 0.003, 0.02, 0.0003, 0.0003, 0.0])


def pose(position_mm: list[float], rpy_deg: list[float]) -> np.ndarray:
    """A pose (4, 4), m."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix()
    T[:3, 3] = np.array(position_mm) / 1000
    return T


HAND_CAMERA = pose([32.0, -58.0, 41.0], [2.0, -3.0, 91.0])
BASE_BOARD = pose([455.0, 115.0, 12.0], [180.8, 0.6, 12.0])


def main() -> None:
    """Write all files."""
    random = np.random.default_rng(8)
    arm = ArmModel.from_urdf(FOLDER / "arm.urdf", "hand")
    q, seen = [], []
    while len(q) < PICTURES + HELD_OUT:
        tried = HOME + REACH * random.uniform(-1.0, 1.0, 6)
        T_camera_board = np.linalg.inv(hand(arm, tried, ARM) @ HAND_CAMERA) @ BASE_BOARD
        if is_seen(T_camera_board):
            q.append(tried)
            seen.append(T_camera_board)
    folder = FOLDER / "pictures"
    folder.mkdir(exist_ok=True)
    names = [f"{k:02d}.jpg" for k in range(len(q))]
    for name, T_camera_board in zip(names, seen, strict=True):
        take(folder / name, T_camera_board, random)
    readings = np.array(q) + ENCODER * random.standard_normal((len(q), 6))
    for file, rows in (
        ("samples.csv", slice(PICTURES)),
        ("held_out.csv", slice(PICTURES, None)),
    ):
        chosen = {"image": np.array(names[rows])}
        write_samples(FOLDER / file, Samples(arm.joints, np.round(readings[rows], 6), chosen))
    write_poses(arm, readings, names)
    known = CAMERA.intrinsics + KNOWN * random.standard_normal(9)
    camera = Camera(CAMERA.width, CAMERA.height, np.round(known, 6), np.diag(KNOWN**2))
    write_camera(FOLDER / "camera.yaml", camera)
    write_board(FOLDER / "board.yaml", BOARD)
    write_corners(FOLDER / "corners.csv", detect(find_pictures([folder]), BOARD, camera).corners)
    write_truth()


def hand(arm: ArmModel, q: np.ndarray, values: dict[str, float]) -> np.ndarray:
    """``T_base_hand`` (4, 4), m."""
    rotation, position = arm.forward(q[None], values)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation[0], position[0]
    return T


def is_seen(T_camera_board: np.ndarray) -> bool:
    """Whether the whole board, with its rim, is in the picture, large enough and not too tilted."""
    corners = np.array([[x, y, 0.0] for x in (-1.3, 9.3) for y in (-1.3, 6.3)]) * BOARD.square
    points = corners @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
    if points[:, 2].min() < 0.15 or T_camera_board[2, 2] < 0.6:
        return False
    pixels = projected(points, CAMERA.intrinsics)
    return bool(CAMERA.inside(pixels).all() and np.ptp(pixels, axis=0).max() > 250)


def take(path: Path, T_camera_board: np.ndarray, random: np.random.Generator) -> None:
    """A picture, lit a little differently each time."""
    import cv2

    light = random.uniform(0.85, 1.1)
    how = RenderOptions(
        black=28 * light, white=205 * light, background=95 * light, blur=0.8, noise=1.2
    )
    picture = rendered(BOARD, CAMERA, T_camera_board, random, how)
    path.write_bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes())


def write_poses(arm: ArmModel, readings: np.ndarray, names: list[str]) -> None:
    """What the controller says: ``T_base_hand`` of the arm as its drawing has it."""
    rows = ["image,a_x,a_y,a_z,a_qx,a_qy,a_qz,a_qw"]
    for name, q in zip(names, readings, strict=True):
        T = hand(arm, q, {})
        numbers = [*T[:3, 3], *quaternion_from_rotation(T[:3, :3])]
        rows.append(",".join([name, *(f"{number:.7f}" for number in numbers)]))
    write_text(FOLDER / "poses.csv", "\n".join(rows) + "\n")


def write_truth() -> None:
    """Everything that the files were made from."""
    rows = [
        "# Simulated: what the pictures and samples in this folder were made from.",
        "simulated: true",
        "parameters:  # of the arm, rad and m; what is not here is as in arm.urdf",
        *(f"  {name}: {value}" for name, value in ARM.items()),
        "camera:  # fx fy cx cy k1 k2 p1 p2 k3",
        f"  intrinsics: {CAMERA.intrinsics.tolist()}",
        f"T_hand_camera: {HAND_CAMERA.round(9).tolist()}",
        f"T_base_board: {BASE_BOARD.round(9).tolist()}",
    ]
    write_text(FOLDER / "truth.yaml", "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
