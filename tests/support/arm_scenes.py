"""Simulated arms of wrong geometry, with a camera on the hand or a board before a camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from camera_scenes import CAMERA, LENS, Pictures, after
from camera_scenes import X as EYE

from suta_calib.arrays import FloatArray
from suta_calib.geometry import projected
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Chessboard, corners_of
from suta_calib.measurements.pose_files import HandPoses
from suta_calib.pose_calibration.pictures import View
from suta_calib.terms.hand_eye_start import Poses, inverse_poses

# Denavit and Hartenberg's d, a (m) and alpha (rad) of an arm as large as a UR5.
LINKS = np.array(
    [
        [0.089159, 0.0, np.pi / 2],
        [0.0, -0.425, 0.0],
        [0.0, -0.39225, 0.0],
        [0.10915, 0.0, np.pi / 2],
        [0.09465, 0.0, -np.pi / 2],
        [0.0823, 0.0, 0.0],
    ]
)
READY = np.array([0.2, -1.4, 1.8, -2.0, -1.57, 0.0])
BOARD = Chessboard(9, 6, 0.025)
# Where the board is seen from the posture above, from its front, half a metre away.
AHEAD = rotation_from_vector([0.1, -0.1, 0.2]), np.array([-0.1, -0.06, 0.5])


def hands(q: FloatArray, links: FloatArray = LINKS) -> Poses:
    """``T_base_hand`` of joint angles (n, 6)."""
    R, p = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
    for angle, (d, a, alpha) in zip(q.T, links, strict=True):
        turn = rotation_from_vector(angle[:, None] * [0.0, 0.0, 1.0])
        link = np.column_stack([a * np.cos(angle), a * np.sin(angle), np.full(len(q), d)])
        R, p = after((R, p), (turn @ rotation_from_vector([alpha, 0.0, 0.0]), link))
    return R, p


def truth(setup: str) -> tuple[Poses, Poses]:
    """X and Z of `arm_pictures`."""
    (R,), (p,) = hands(READY[None])
    there = after((R, p), EYE)
    if setup == "eye-in-hand":
        return EYE, after(there, AHEAD)
    return there, after(EYE, AHEAD)


def arm_pictures(
    seed: int,
    *,
    count: int = 28,
    setup: str = "eye-in-hand",
    geometry: float = 0.0,
    eccentric: float = 0.0,
    pixel: float = 0.15,
) -> Pictures:
    """Pictures by an arm whose poses are reported as its nominal geometry has them.

    Args:
        seed: of everything random.
        count: of pictures.
        setup: where the camera is.
        geometry: errors of lengths and angles, in 0.5 mm and 0.13°.
        eccentric: amplitude of every joint's error, once a turn, in 0.15°.
        pixel: scatter of a corner, px.
    """
    random = np.random.default_rng(seed)
    scale = geometry * np.array([5e-4, 5e-4, np.radians(0.13)])
    links = LINKS + scale * random.normal(size=LINKS.shape)
    zero = geometry * np.radians(0.13) * random.normal(size=6)
    amplitude = eccentric * np.radians(0.15) * random.normal(size=6)
    phase = random.uniform(0.0, 2.0 * np.pi, 6)
    X, Z = truth(setup)
    points = np.array(list(BOARD.points.values()))
    kept, pixels = list[FloatArray](), list[FloatArray]()
    while len(kept) < count:
        q = READY + random.uniform(-0.25, 0.25, 6) * [1.0, 0.6, 0.8, 1.5, 1.5, 4.0]
        hand = hands((q + zero + amplitude * np.sin(q + phase))[None], links)
        if setup == "eye-in-hand":
            R, p = after(inverse_poses(after(hand, X)), Z)
        else:
            R, p = after(inverse_poses(X), after(hand, Z))
        seen = points @ R[0].T + p[0]
        corners = projected(seen, LENS) + pixel * random.normal(size=(len(points), 2))
        if (seen[:, 2] > 0.2).all() and CAMERA.inside(corners).all():
            kept.append(q)
            pixels.append(corners)
    names = np.array([f"{k:03d}.png" for k in range(count)])
    found = corners_of(
        np.repeat(names, len(points)), np.tile(list(BOARD.points), count), np.concatenate(pixels)
    )
    poses = HandPoses(
        path=Path("poses.csv"),
        lines=tuple(range(2, count + 2)),
        pose=hands(np.array(kept)),
        image=names,
    )
    return Pictures(poses, (View("default", found, BOARD, CAMERA),))
