"""Pictures of a depth camera on a hand or beside it: a table, balls, or a board on the table."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_vector
from suta_calib.measurements import Chessboard
from suta_calib.measurements.seen_points import SeenPoints
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EyeSetup, after, inverse_poses

# The camera: in the hand, and beside the arm; and what it looks at, on a table at the height 0.
IN_HAND = rotation_from_vector([0.05, -0.1, 0.6]), np.array([0.03, -0.06, 0.07])
BESIDE = rotation_from_vector([2.2, 0.3, -0.4]), np.array([1.0, 0.1, 0.6])
TARGET = np.array([0.45, 0.1, 0.0])
BALLS = {"A": (0.07, 0.05, 0.05), "B": (-0.08, 0.02, 0.06), "C": (0.0, -0.06, 0.03)}
BOARD = Chessboard(5, 4, 0.03)
LEANING = rotation_from_vector([0.1, 0.2, 0.4])


@dataclass
class DepthScene:
    """What was recorded: poses of the hand as its controller has them, and what was seen."""

    rotation: FloatArray
    position: FloatArray
    images: list[str]
    seen: SeenPoints
    camera: tuple[FloatArray, FloatArray]

    @property
    def hand(self) -> tuple[FloatArray, FloatArray]:
        """Its poses."""
        return self.rotation, self.position

    def larger(self, factor: float | FloatArray) -> DepthScene:
        """The same with all that was seen multiplied."""
        return replace(self, seen=replace(self.seen, position=self.seen.position * factor))

    def poses_csv(self) -> str:
        """A file of the poses."""
        numbers = np.hstack([self.position, quaternion_from_rotation(self.rotation)])
        rows = [
            ",".join([name, *map(repr, row)])
            for name, row in zip(self.images, numbers.tolist(), strict=True)
        ]
        return "\n".join(["image,x,y,z,qx,qy,qz,qw", *rows]) + "\n"


def depth_scene(
    seed: int,
    what: str = "table",
    setup: EyeSetup = EYE_IN_HAND,
    *,
    count: int = 20,
    tilt: float = 0.5,
    hand: float = 2e-4,
    camera: float = 2e-4,
) -> DepthScene:
    """Pictures of a table, of a table and a wall, of balls or of a board.

    Args:
        seed: of everything.
        what: ``table``, ``room``, ``balls``, ``ball`` or ``board``.
        setup: where the camera is; what it sees is then on the hand.
        count: of the pictures.
        tilt: of the camera, rad.
        hand: standard deviation of the hand's position per axis, m; of its turn twice that in rad
            per m.
        camera: of a point, or of a height over a plane, m.
    """
    random = np.random.default_rng(seed)
    about, leaning = random.uniform(-1.2, 1.2, count), random.uniform(-tilt, tilt, (count, 2))
    R = (
        np.diag([1.0, -1.0, -1.0])
        @ rotation_from_vector(np.column_stack([0 * about, 0 * about, about]))
        @ rotation_from_vector(np.column_stack([leaning, 0 * about]))
    )
    away = 0.5 * random.uniform(0.75, 1.25, count)
    looked = TARGET + np.column_stack([random.uniform(-0.08, 0.08, (count, 2)), 0 * about])
    p = looked - R[:, :, 2] * away[:, None]
    parts = [_seen(R[k], p[k], what, camera, random) for k in range(count)]
    # What is looked at is in the base, or in the hand, as the camera is in the other one.
    X = IN_HAND if setup == EYE_IN_HAND else BESIDE
    eye_to_carrier = inverse_poses(X)
    poses = after((R, p), eye_to_carrier)
    rotation, position = poses if setup == EYE_IN_HAND else inverse_poses(poses)
    turn = 2.0 * hand * random.standard_normal((count, 3))
    images = [f"c{k:02d}.ply" for k in range(count)]
    names = np.array([name for part in parts for name in part])
    seen = SeenPoints(
        np.repeat(images, [len(part) for part in parts]),
        np.array([name.split("/")[0] for name in names.tolist()]),
        np.array([at for part in parts for at in part.values()]),
        np.full((len(names), 3), camera),
    )
    return DepthScene(
        rotation_from_vector(turn) @ rotation,
        position + hand * random.standard_normal((count, 3)),
        images,
        seen,
        X,
    )


def _seen(
    R: FloatArray, p: FloatArray, what: str, noise: float, random: np.random.Generator
) -> dict[str, FloatArray]:
    """Points in the camera, by name; three of each plane, of which one height errs."""
    if what in ("table", "room"):
        rays = np.column_stack([random.uniform(-0.3, 0.3, (3, 2)), np.ones(3)]) @ R.T
        places = {"table": p - rays * (p[2] / rays[:, 2])[:, None]}
        if what == "room":
            corner = np.array([0.8, 0.1, 0.15])
            wall = np.column_stack([np.zeros(3), random.uniform(-0.15, 0.15, (3, 2))])
            places["wall"] = corner + wall
        normals = {"table": np.array([0.0, 0.0, 1.0]), "wall": np.array([-1.0, 0.0, 0.0])}
        return {
            f"{name}/{k}": (at[k] - p + noise * random.standard_normal() * normals[name]) @ R
            for name, at in places.items()
            for k in range(3)
        }
    if what == "board":
        marks = {str(k): at @ LEANING.T for k, at in BOARD.points.items()}
    else:
        marks = {k: np.array(at) for k, at in BALLS.items() if what == "balls" or k == "A"}
    return {k: (TARGET + at - p) @ R + noise * random.standard_normal(3) for k, at in marks.items()}
