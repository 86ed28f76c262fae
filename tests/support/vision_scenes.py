"""Boards in front of a small camera, with known truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.geometry import projected
from suta_calib.measurements import Board, Camera, Charuco, Chessboard, Marker, Markers
from suta_calib.vision import RenderOptions, rendered

CAMERA = Camera(320, 240, np.array([310.0, 312.0, 161.0, 118.0, -0.1, 0.05, 0.001, -0.001, 0.0]))
CHESSBOARD = Chessboard(6, 5, 0.03)
CHARUCO = Charuco(5, 6, 0.04, 0.028, "DICT_4X4_50")
MARKERS = Markers(
    "DICT_APRILTAG_36h11",
    {7: Marker(np.zeros(3), 0.08), 3: Marker(np.array([0.11, 0.05, 0.0]), 0.06)},
)
OPTIONS = RenderOptions(samples=6, noise=1.0)


def facing(
    board: Board, tilt_deg: tuple[float, float, float] = (20, -15, 10), depth: float = 0.42
) -> np.ndarray:
    """``T_camera_board`` (4, 4) of a board whose middle is ahead."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", tilt_deg, degrees=True).as_matrix()
    middle = np.mean(list(board.points.values()), axis=0)
    T[:3, 3] = np.array([0.005, 0.0, depth]) - T[:3, :3] @ middle
    return T


def taken(
    board: Board, T: np.ndarray | None = None, options: RenderOptions = OPTIONS, seed: int = 0
) -> np.ndarray:
    """A picture of it."""
    T = facing(board) if T is None else T
    return rendered(board, CAMERA, T, np.random.default_rng(seed), options)


def truth(board: Board, point: np.ndarray, T: np.ndarray | None = None) -> np.ndarray:
    """Pixels (n, 2) where points of the board are."""
    T = facing(board) if T is None else T
    return projected(board.positions(point) @ T[:3, :3].T + T[:3, 3], CAMERA.intrinsics)


def write_picture(path: Path, grey: np.ndarray) -> Path:
    """A file of the kind that its name ends with."""
    import cv2

    path.write_bytes(cv2.imencode(path.suffix, grey)[1].tobytes())
    return path
