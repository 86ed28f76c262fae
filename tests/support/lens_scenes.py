"""Cameras of every lens, and what they see of a board."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from camera_scenes import X, Z
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.geometry.lens import EQUIDISTANT, PLUMB_BOB, RATIONAL, Lens
from suta_calib.geometry.numbers import (
    homogeneous,
    rotation_from_vector,
    vector_turning_z_to,
)
from suta_calib.measurements import Camera, Chessboard
from suta_calib.measurements.board import Board
from suta_calib.measurements.corners import Corners, corners_of
from suta_calib.measurements.pose_files import HandPoses
from suta_calib.pose_calibration.pictures import View
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EyeSetup

BOARD = Chessboard(9, 6, 0.03)
SIZE = (1280, 960)
# A usual lens; the colour camera of a depth camera, which has all eight numbers; a lens that is
# 100° wide, and one of 190°.
TRUE: dict[str, tuple[Lens, list[float]]] = {
    "plumb_bob": (PLUMB_BOB, [900, 905, 640, 480, -0.25, 0.08, 1e-3, -2e-3, 0.01]),
    "rational_polynomial": (
        RATIONAL,
        [610, 610, 640, 480, 0.45, -2.5, 5e-4, -3e-4, 1.45, 0.33, -2.33, 1.38],
    ),
    "equidistant": (EQUIDISTANT, [700, 702, 640, 480, 0.02, -0.01, 0.003, -0.0005]),
    "fisheye of 190 deg": (EQUIDISTANT, [390, 392, 640, 480, -0.02, 0.003, -0.001, 0.0001]),
}
each_camera = pytest.mark.parametrize("name", TRUE)


def camera(name: str, width: int = SIZE[0]) -> Camera:
    """Such a camera, with pictures of another size if asked."""
    lens, values = TRUE[name]
    times = width / SIZE[0]
    intrinsics = np.array(values, dtype=float)
    intrinsics[:4] *= times
    return Camera(width, round(times * SIZE[1]), intrinsics, lens=lens)


def before(
    taken_by: Camera, board: Board, rng: np.random.Generator, room: int, tilt: float
) -> FloatArray:
    """``T_camera_board`` (4, 4) of a board that faces the camera anywhere in its picture."""
    size = np.array([taken_by.width, taken_by.height])
    pixel = rng.uniform([room, room], size - room)
    ahead = taken_by.directions(pixel)
    pose = np.eye(4)
    turn = rotation_from_vector(tilt * rng.uniform(-1, 1, 3))
    pose[:3, :3] = rotation_from_vector(vector_turning_z_to(ahead)) @ turn
    middle = np.mean(list(board.points.values()), axis=0)
    pose[:3, 3] = rng.uniform(0.25, 0.5) * ahead - pose[:3, :3] @ middle
    return pose


@dataclass(frozen=True, eq=False)
class Seen:
    """Boards before a camera: ``T_camera_board`` (n, 4, 4), and the corners in its pictures."""

    poses: FloatArray
    corners: Corners


def boards_seen(
    taken_by: Camera,
    seed: int,
    pictures: int = 20,
    sigma: float = 0.1,
    roll: float = 0.0,
    least: int = 30,
) -> Seen:
    """Boards that are mostly in the picture, their corners with normal errors, px.

    Args:
        taken_by: the camera.
        seed: of the boards and of the errors.
        pictures: how many there are.
        sigma: standard deviation of a corner, px.
        roll: largest turn of the camera about its axis, rad.
        least: corners of each picture.
    """
    rng, points = np.random.default_rng(seed), np.array(list(BOARD.points.values()))
    numbers, images, number = np.array([*BOARD.points]), list[str](), []
    pixels, poses = list[FloatArray](), list[FloatArray]()
    while len(pixels) < pictures:
        pose = before(taken_by, BOARD, rng, round(150 * taken_by.width / SIZE[0]), 0.7)
        if roll:
            turn = rotation_from_vector([0.0, 0.0, rng.uniform(-roll, roll)])
            pose[:3] = turn @ pose[:3]
        there = points @ pose[:3, :3].T + pose[:3, 3]
        if not taken_by.lens.ahead(there).all():
            continue
        pixel = taken_by.project(there)
        unit = there / np.linalg.norm(there, axis=1, keepdims=True)
        # Not what a polynomial folds back into the picture, nor what noise puts beside it.
        seen = taken_by.inside(pixel)
        seen &= np.abs(taken_by.directions(pixel) - unit).max(axis=1) < 1e-3
        if seen.sum() < least:
            continue
        measured = pixel[seen] + sigma * rng.standard_normal((int(seen.sum()), 2))
        images += [f"{len(pixels):02d}.png"] * int(seen.sum())
        number.append(numbers[seen])
        pixels.append(measured)
        poses.append(pose)
    corners = corners_of(np.array(images), np.concatenate(number), np.concatenate(pixels))
    return Seen(np.array(poses), corners)


def corners_seen(taken_by: Camera, seed: int, pictures: int = 20, sigma: float = 0.1) -> Corners:
    """Corners with normal errors, px, of boards that are mostly in the picture."""
    return boards_seen(taken_by, seed, pictures, sigma).corners


def hand_of(
    seen: FloatArray,
    X: FloatArray,
    Z: FloatArray,
    setup: EyeSetup,
    off: ArrayLike,
    rng: np.random.Generator,
) -> FloatArray:
    """``T_base_hand`` (n, 4, 4) of a robot whose poses err by ``off`` (2,) or (n, 2), m and rad.

    Args:
        seen: (n, 4, 4) boards in the camera.
        X: (4, 4) the camera on the hand, or beside the robot.
        Z: (4, 4) the board beside the robot, or on the hand.
        setup: which of both.
        off: standard deviations.
        rng: the errors are drawn from.
    """
    there = X @ seen
    hand = Z @ np.linalg.inv(there) if setup == EYE_IN_HAND else there @ np.linalg.inv(Z)
    shift, turn = np.broadcast_to(off, (len(hand), 2)).T[..., None]
    hand[:, :3, :3] @= rotation_from_vector(turn * rng.standard_normal((len(hand), 3)))
    hand[:, :3, 3] += shift * rng.standard_normal((len(hand), 3))
    return hand


def poses_of(hand: FloatArray) -> HandPoses:
    """As a file has them: the pictures are named by their numbers."""
    images = np.array([f"{k:02d}.png" for k in range(len(hand))])
    lines = tuple(range(2, len(hand) + 2))
    pose = hand[:, :3, :3], hand[:, :3, 3]
    return HandPoses(pose=pose, image=images, path=Path("poses.csv"), lines=lines)


def anywhere(place: ArrayLike, rng: np.random.Generator) -> FloatArray:
    """A pose (4, 4) at a place, m, that is turned somehow."""
    return homogeneous(rotation_from_vector(rng.uniform(-1.5, 1.5, 3)), np.asarray(place))


def on_a_hand(
    taken_by: Camera, seed: int, robot: tuple[float, float] = (3e-4, 5e-4)
) -> tuple[HandPoses, View]:
    """Such a camera on the hand of a robot whose poses err by so much, m and rad."""
    seen = boards_seen(taken_by, seed, 16, roll=1.2)
    inside = taken_by.inside(seen.corners.pixel)
    rng = np.random.default_rng([seed, 5])
    hand = hand_of(seen.poses, homogeneous(*X), homogeneous(*Z), EYE_IN_HAND, robot, rng)
    return poses_of(hand), View("default", seen.corners.take(inside), BOARD, taken_by)
