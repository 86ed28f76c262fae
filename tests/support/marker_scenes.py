"""Markers on walls that nobody measured, and a camera on a hand that saw them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from camera_scenes import X, Z, after

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Camera, Corners, corners_of
from suta_calib.measurements.board import Marker, Markers
from suta_calib.measurements.pose_files import HandPoses
from suta_calib.pose_calibration.pictures import View
from suta_calib.terms.hand_eye_start import inverse_poses

CAMERA = Camera(1280, 960, np.array([900.0, 902.0, 641.0, 478.0, -0.1, 0.03, 4e-4, -3e-4, 0.0]))
DICTIONARY = "DICT_APRILTAG_36h11"


def wall(count: int = 6, seed: int = 1) -> dict[int, Marker]:
    """Markers on two walls that meet, as they are; the first one is the frame."""
    random = np.random.default_rng(seed)
    markers = {}
    for k in range(count):
        size = 0.06 + 0.04 * random.random()
        across = 0.16 * (k % 3) + 0.02 * random.standard_normal()
        down = 0.15 * (k // 3) + 0.02 * random.standard_normal()
        turn = rotation_from_vector([0, 0, random.uniform(-0.4, 0.4)])
        place = np.array([across, down, 0.0])
        if k % 3 == 2:
            corner = rotation_from_vector([0.0, 0.8, 0.0])
            turn, place = corner @ turn, np.array([0.3, down, -0.08])
        markers[k + 3] = Marker(place, size, turn)
    first = markers[3]
    R, p = first.rotation, first.position
    return {n: Marker(R.T @ (m.position - p), m.size, R.T @ m.rotation) for n, m in markers.items()}


@dataclass(frozen=True, eq=False)
class MarkerScene:
    """Poses of a hand, what its camera saw, and the truth."""

    hand: HandPoses
    corners: Corners
    true: Mapping[int, Marker]

    def views(self, sought: Mapping[int, Marker]) -> tuple[View, ...]:
        """The view, with the markers as their file has them."""
        return (View("default", self.corners, Markers(DICTIONARY, sought), CAMERA),)


def sought(true: Mapping[int, Marker], sizes: tuple[int, ...] | None = None) -> dict[int, Marker]:
    """Markers of unknown places, of which some sizes are stated; of all by default."""
    return {
        n: Marker(size=m.size if sizes is None or n in sizes else np.nan) for n, m in true.items()
    }


def marker_scene(
    count: int = 20,
    *,
    true: Mapping[int, Marker] | None = None,
    later: Mapping[int, Marker] | None = None,
    pixel: float = 0.1,
    robot: tuple[float, float] = (1e-4, 2e-4),
    seed: int = 0,
    setup: str = "eye-in-hand",
    still: bool = False,
) -> MarkerScene:
    """A camera looks at markers from all sides.

    Args:
        count: of pictures.
        true: markers as they are.
        later: the same in the second half of the pictures.
        pixel: scatter of a corner, px.
        robot: scatter of a reported pose, m and rad.
        seed: of everything random.
        setup: where the camera is.
        still: whether all pictures are taken from one place.
    """
    random, noise, arm = np.random.default_rng(seed).spawn(3)
    true = wall() if true is None else true
    markers = Markers(DICTIONARY, true), Markers(DICTIONARY, later or true)
    middle = np.mean([m.position for m in true.values()], axis=0)
    lean = random.uniform(-0.5, 0.5, (count, 3)) * [1.0, 1.0, 2.0]
    ahead = np.column_stack(
        [random.uniform(-0.1, 0.1, (count, 2)), random.uniform(0.5, 0.9, count)]
    )
    turn = rotation_from_vector(lean)
    if still:
        turn, ahead = np.tile(turn[:1], (count, 1, 1)), np.tile(ahead[:1], (count, 1))
    seen = turn, ahead - turn @ middle
    if setup == "eye-in-hand":
        hand = after(Z, inverse_poses(after(X, seen)))
    else:
        hand = after(after(Z, seen), inverse_poses(X))
    points = [np.array([*board.points.values()]) for board in markers]
    at: FloatArray = np.array([points[2 * k >= count] for k in range(count)])
    places = np.einsum("nij,nkj->nki", seen[0], at) + seen[1][:, None]
    pixels = CAMERA.project(places) + pixel * noise.standard_normal((*places.shape[:2], 2))
    whole = CAMERA.inside(pixels).reshape(count, -1, 4).all(axis=2)
    facing = np.array(
        [
            [
                (turn[k] @ m.rotation)[:, 2] @ places[k, 4 * j] > 0
                for j, m in enumerate(true.values())
            ]
            for k in range(count)
        ]
    )
    image, point = np.nonzero(np.repeat(whole & facing, 4, axis=1))
    names = np.array([f"{k:03d}.png" for k in range(count)])
    numbers = np.array([*markers[0].points])
    corners = corners_of(names[image], numbers[point], pixels[image, point])
    R, p = hand
    R = R @ rotation_from_vector(robot[1] * arm.standard_normal(p.shape))
    p = p + robot[0] * arm.standard_normal(p.shape)
    poses = HandPoses(
        path=Path("poses.csv"), lines=tuple(range(2, count + 2)), pose=(R, p), image=names
    )
    return MarkerScene(poses, corners, true)
