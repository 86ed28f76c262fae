"""Whether pictures of a board will tell a camera: where they have it, and how it is turned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.geometry.lens import PLUMB_BOB
from suta_calib.measurements.board import Board
from suta_calib.measurements.camera import Camera
from suta_calib.measurements.corners import corners_of
from suta_calib.units import deg, from_deg
from suta_calib.vision.camera_fit import view_poses
from suta_calib.vision.finder import DetectedBoard

# Parts of the picture along its sides.
PARTS: Final = (6, 4)
# A board is facing the camera up to here, and tilted from there on; between it is both, rad.
FACING: Final = from_deg(10.0)
TILTED: Final = from_deg(15.0)
# As usual for calibrations: fewer leave the distortion to chance.
ENOUGH: Final = 12
_SIDES: Final = ("left", "right", "top", "bottom")


@dataclass(frozen=True, eq=False)
class SeenBoard(Displayable):
    """A board as far as coverage is concerned.

    Attributes:
        parts: (rows, columns) which parts of the picture it has corners in.
        tilt: (2,) how far its normal leans to the right and down, rad; NaN where that is not told.
    """

    parts: BoolArray
    tilt: FloatArray

    @classmethod
    def of(cls, detected: DetectedBoard, board: Board, size: tuple[int, int]) -> SeenBoard:
        """Of a board that was found in a picture of this width and height, px.

        The camera is not known yet: it is taken for one without distortion that sees some 60°.
        """
        width, height = size
        columns, rows = PARTS
        column = np.clip(detected.pixel[:, 0] * columns / width, 0, columns - 1).astype(int)
        row = np.clip(detected.pixel[:, 1] * rows / height, 0, rows - 1).astype(int)
        parts = np.zeros((rows, columns), dtype=np.bool_)
        parts[row, column] = True
        focal = 0.9 * max(size)
        lens = [focal, focal, (width - 1) / 2, (height - 1) / 2]
        camera = Camera(width, height, np.array([*lens, *[0.0] * (len(PLUMB_BOB.names) - 4)]))
        corners = corners_of(np.full(len(detected.point), "it"), detected.point, detected.pixel)
        poses, _ = view_poses(corners, board, camera)
        tilt = np.full(2, np.nan)
        if "it" in poses:
            normal, place = poses["it"][:3, 2], poses["it"][:3, 3]
            # Towards the camera, and as seen along the ray to it.
            normal = -normal * np.sign(normal @ place)
            tilt = np.arctan2(normal[:2], -normal[2])
        return cls(parts, tilt)


@dataclass(frozen=True)
class BoardCoverage(Displayable):
    """What the pictures taken so far cover.

    Attributes:
        taken: the board in each.
    """

    taken: tuple[SeenBoard, ...] = ()

    def __add__(self, view: SeenBoard) -> BoardCoverage:
        return BoardCoverage((*self.taken, view))

    @property
    def parts(self) -> FloatArray:
        """(rows, columns) in how many pictures corners are in each part."""
        none = np.zeros(PARTS[::-1])
        return np.asarray(np.sum([none, *(view.parts for view in self.taken)], axis=0))

    @property
    def tilts(self) -> FloatArray:
        """(n, 2) of the boards whose tilt is told, rad."""
        tilts = [view.tilt for view in self.taken if np.isfinite(view.tilt).all()]
        return np.array(tilts).reshape(-1, 2)

    def is_new(self, view: SeenBoard) -> bool:
        """Whether a picture of it tells more: a part of the picture, or another tilt."""
        if bool((view.parts & (self.parts == 0)).any()):
            return True
        if not np.isfinite(view.tilt).all():
            return False
        away = np.linalg.norm(self.tilts - view.tilt, axis=1)
        # By so much a board is turned otherwise than in another picture, rad, or else it tells
        # nothing new.
        return not len(away) or bool(away.min() > from_deg(10.0))

    @property
    def missing_tilts(self) -> tuple[str, ...]:
        """Ways in which no board was turned yet: ``facing``, and the sides that it leans to."""
        tilts = self.tilts
        if not len(tilts):
            return ("facing", *_SIDES)
        right, down = tilts.T
        there = {
            "facing": np.linalg.norm(tilts, axis=1) < FACING,
            "left": right < -TILTED,
            "right": right > TILTED,
            "top": down < -TILTED,
            "bottom": down > TILTED,
        }
        return tuple(way for way, boards in there.items() if not boards.any())

    @property
    def enough(self) -> bool:
        """Whether all is covered."""
        few = len(self.taken) < ENOUGH
        return not few and not self.missing_tilts and self._share >= 1.0

    @property
    def _share(self) -> float:
        """Of the parts that must have corners, how many do; a corner of the picture may be free."""
        counts = self.parts > 0
        least = counts.size - 2
        return float(counts.sum()) / least

    @property
    def advice(self) -> str:
        """What the next picture should show."""
        empty = np.argwhere(self.parts == 0)
        if not self.taken:
            return "Hold the board in front of the camera"
        if self._share < 1.0:
            columns, rows = PARTS
            # The emptiest quarter first.
            middle = (np.array([rows, columns]) - 1) / 2
            side = np.sign(empty - middle)
            ways = [tuple(way) for way in side.tolist()]
            down, right = max(dict.fromkeys(ways), key=ways.count)
            where = " ".join([_vertical(down), _horizontal(right)]).strip()
            return f"Bring the board to the {where} of the picture"
        if turns := self.missing_tilts:
            if turns[0] == "facing":
                return "Turn the board so that it faces the camera"
            return f"Turn the {_opposite(turns[0])} edge of the board towards the camera, by 30°"
        if len(self.taken) < ENOUGH:
            return f"{ENOUGH - len(self.taken)} more pictures: nearer, farther, otherwise turned"
        return "Enough: all of the picture and all directions are covered"


def _vertical(down: float) -> str:
    return "top" if down < 0 else "bottom"


def _horizontal(right: float) -> str:
    return "left" if right < 0 else "right"


def _opposite(side: str) -> str:
    """A board that leans to one side has its other edge nearer to the camera."""
    return {"left": "right", "right": "left", "top": "bottom", "bottom": "top"}[side]


def moved(before: DetectedBoard, now: DetectedBoard) -> float:
    """How far corners that both have moved, px, RMS; infinite where they share none."""
    _, first, second = np.intersect1d(before.point, now.point, return_indices=True)
    if not len(first):
        return np.inf
    step = now.pixel[second] - before.pixel[first]
    return float(np.sqrt(np.mean(np.sum(step**2, axis=1))))


def degrees(tilts: FloatArray) -> list[list[float]]:
    """(n, 2) tilts in whole degrees, for a page."""
    return [[round(float(x)) for x in row] for row in deg(tilts)]
