"""Pictures of one board by one camera: its pose in each, and the numbering of its corners.

A hand and the eye on it, or the board on it, turn by the same angle between two pictures, whatever
X and Z are. So every pair of pictures of a board that looks the same after half a turn says whether
both are numbered from the same end, the louder the more the two angles differ; the signs that most
of what is said agrees with are those of the leading eigenvector (Singer 2011,
doi:10.1016/j.acha.2010.02.001, for two elements).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.assessment import Level
from suta_calib.errors import SutaCalibWarning
from suta_calib.geometry.lens_slopes import pixel_slopes
from suta_calib.geometry.numbers import quaternion_from_rotation, skew, vector_from_rotation
from suta_calib.measurements import Board, Camera, Markers
from suta_calib.measurements.board import CORNERS
from suta_calib.measurements.marker_axes import counter_clockwise
from suta_calib.terms.camera_start import poses_in_camera
from suta_calib.terms.hand_eye_start import (
    FEWEST,
    HALF_TURN,
    Poses,
    agreeing_hand_eye,
    loop_closures,
    some_poses,
)
from suta_calib.words import listed

# Pictures that are held against each other; the rest are held against these.
COMPARED: Final = 300


def half_turned(hand: FloatArray, target: FloatArray, otherwise: FloatArray) -> BoolArray:
    """(n,) which boards agree with most of the others once they are turned by half a turn.

    None where hand and pictures do not move alike even so: something else is wrong. Rotations are
    of the hand in the base, or of the base in it, of the board in the eye, and of the board
    numbered from its other end (n, 3, 3).
    """
    n = len(hand)
    if n < 2:
        return np.zeros(n, dtype=np.bool_)
    chosen = np.unique(np.linspace(0, n - 1, min(n, COMPARED)).astype(np.intp))
    moved = _angles(hand, hand[chosen])
    same = np.abs(_angles(target, target[chosen]) - moved)
    other = np.abs(_angles(otherwise, target[chosen]) - moved)
    evidence = other - same
    # A picture says nothing of itself.
    evidence[chosen, np.arange(len(chosen))] = 0.0
    vector = np.linalg.eigh(evidence[chosen])[1][:, -1]
    signs = np.where(vector < 0.0, -1.0, 1.0)
    sign = np.where(evidence @ signs < 0.0, -1.0, 1.0)
    left = np.where(sign[:, None] * signs > 0.0, same, other)
    # From such a middle difference of the angles on hand and pictures belong to other motions.
    if np.median(left) > np.radians(10.0):
        return np.zeros(n, dtype=np.bool_)
    turned = sign < 0.0
    return turned if 2 * turned.sum() <= n else ~turned


def from_other_end(
    hand: Poses, target: Poses, first: tuple[Poses, Poses], *, same_eye: bool
) -> BoolArray:
    """(n,) which boards are numbered from the other end than in the ``first`` pictures.

    None where these or the others tell no X, or agree neither way: something else is wrong. The
    hand is ``T_base_hand`` of an eye on it, ``T_hand_base`` of one beside it, the target
    ``T_eye_board``. Where one camera took both (``same_eye``), its X is that of the first ones, and
    every other picture is judged by itself.
    """
    n = len(hand[1])
    if len(first[0][1]) < FEWEST or (n < FEWEST and not same_eye):
        return np.zeros(n, dtype=np.bool_)
    X, there = agreeing_hand_eye(*first)
    board: FloatArray
    if same_eye:
        board = loop_closures(hand, X, target)[0]
    else:
        board = agreeing_hand_eye(hand, target)[1][0][None]
    off = np.stack([_angles(side, there[0][None])[:, 0] for side in (board, board @ HALF_TURN)])
    # Turned by so much between one row of a job and another, it is another board.
    if np.median(off.min(axis=0)) > np.radians(45.0):
        return np.zeros(n, dtype=np.bool_)
    return np.broadcast_to(off[1] < off[0], n)


def _angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (n, m) of the turns between rotations (n, 3, 3) and (m, 3, 3), rad."""
    cosine = np.abs(quaternion_from_rotation(a) @ quaternion_from_rotation(b).T)
    return np.asarray(2.0 * np.arccos(np.minimum(cosine, 1.0)))


# What the numbering of corners does to the board's frame, where it is not the usual one.
UNTOUCHED: Final = "The pose of the camera does not depend on it; that of the board does."
OUTWARDS: Final = (
    "The corners are numbered so that z of the board's frame points out of its face, as with y "
    f"upwards or columns and rows exchanged; usually z points into it. {UNTOUCHED}"
)
COUNTER_CLOCKWISE: Final = (
    "The corners of the markers are listed counter-clockwise, and expected clockwise: top left, "
    "top right, bottom right, bottom left. A program that finds markers may list them so. "
    f"{UNTOUCHED} The axes of the markers turn with it."
)
# Pictures that a sentence names.
QUOTED: Final = 5
# Relative difference that is none.
ROUNDING: Final = 1e-9
# By what is turned: how pictures are told of which the others say that they are upside down.
TURNED: Final = {
    "board": "the board is turned by half a turn: its corners are numbered from the opposite end.",
    "picture": "the picture is turned by half a turn: the camera was, or the program that "
    "wrote the file turned it.",
    "mirror": "the picture is mirrored: left and right, or top and bottom, are exchanged in it.",
}


@dataclass(frozen=True, eq=False)
class BoardPictures:
    """Corners of a board in pictures.

    Attributes:
        board: that is seen.
        camera: that sees it.
        pixels: (n, points, 2) px; NaN where a corner was not found.
        from_file: whether a file has the camera, not these pictures with a model of the lens.
    """

    board: Board
    camera: Camera
    pixels: FloatArray
    from_file: bool = True

    @cached_property
    def points(self) -> FloatArray:
        """(points, 3) of the board, m."""
        return np.array(list(self.board.points.values()))

    @cached_property
    def poses(self) -> Poses:
        """``T_eye_board`` of every picture, by its own corners; NaN where they do not tell it."""
        return poses_in_camera(self.points, self.pixels, self.camera)

    def poses_near(self, expected: Poses) -> Poses:
        """`poses`, those that look alike from two sides as they are expected."""
        return poses_in_camera(self.points, self.pixels, self.camera, expected)

    @property
    def pixel(self) -> float | None:
        """Length, m, that a pixel covers where the board typically is; None if nothing tells."""
        _, position = self.poses
        located = position[self.posed]
        sees = self.camera.lens.ahead(located)
        behind = self.camera.lens.sees_behind
        depths = (np.linalg.norm(located, axis=1) if behind else located[:, 2])[sees]
        focal = float(np.sqrt(self.camera.intrinsics[0] * self.camera.intrinsics[1]))
        return float(np.median(depths)) / focal if len(depths) else None

    @property
    def posed(self) -> BoolArray:
        """(n,) pictures that tell where the board is."""
        return np.isfinite(self.poses[1][:, 0])

    @property
    def numbered_otherwise(self) -> tuple[str, Level]:
        """How the corners are numbered if not as usual, and what an answer is worth for it.

        No camera sees a board from behind: a frame that seems to be is that of another numbering.
        """
        if isinstance(self.board, Markers):
            backwards = counter_clockwise(self.pixels.reshape(-1, CORNERS, 2))
            return (COUNTER_CLOCKWISE, "care") if backwards else ("", "good")
        if not self.board.flat:
            return "", "good"
        rotation, position = some_poses(self.poses, self.posed)
        facing = np.einsum("ni,ni->n", rotation[:, :, 2], position)
        return (OUTWARDS if len(facing) and np.median(facing) < 0 else ""), "good"

    @cached_property
    def errors(self) -> FloatArray:
        """(n, points, 2) of the corners about their picture's own pose of the board, px.

        NaN where a corner was not found, and in pictures that tell no pose before the camera.
        """
        rotation, position = self.poses
        points = np.einsum("nij,kj->nki", rotation, self.points) + position[:, None]
        visible = np.asarray(np.isfinite(self.pixels).all(axis=2))
        ahead = np.asarray((self.camera.lens.ahead(points) | ~visible).all(axis=1))
        points[~(ahead[:, None] & visible)] = [0.0, 0.0, 1.0]
        off = self.camera.project(points) - self.pixels
        off[~ahead] = np.nan
        return np.asarray(off)

    @property
    def rms(self) -> FloatArray:
        """(n,) root mean square of the errors of each picture, px; NaN where there are none."""
        squared = np.sum(self.errors**2, axis=2)
        count = np.isfinite(squared).sum(axis=1)
        return np.asarray(np.sqrt(np.nansum(squared, axis=1) / np.where(count > 0, count, np.nan)))

    @property
    def scatter(self) -> float:
        """Standard deviation of a corner about its picture's own pose of the board, px.

        Of one coordinate, of the middle one of the pictures; at least a thousandth.
        """
        count = np.isfinite(self.errors).all(axis=2).sum(axis=1)
        # Six numbers of each picture are its pose.
        freedom = np.maximum(2.0 * count - 6.0, 1.0)
        level = np.sqrt(np.nansum(self.errors**2, axis=(1, 2)) / freedom)[count > 0]
        return max(float(np.median(level)), 1e-3) if len(level) else 1.0

    def by_motion(self, about: FloatArray | float) -> FloatArray:
        """(n, points, 2, 6) how corners move, px, with the board before the camera, m and rad.

        It is shifted along the camera's axes, and turned about a point (3,) of the board, or about
        the camera's origin for 0. Zero in pictures that tell no pose of the board.
        """
        rotation, position = self.poses
        points = np.einsum("nij,kj->nki", rotation, self.points) + position[:, None]
        ahead = self.camera.lens.ahead(points).all(axis=1)
        points[~ahead] = [0.0, 0.0, 1.0]
        by_place, _ = pixel_slopes(self.camera.lens, points, self.camera.intrinsics)
        arm = points
        if not isinstance(about, float):
            arm = np.einsum("nij,kj->nki", rotation, self.points - about)
        moved = np.concatenate([by_place, -by_place @ skew(arm)], axis=-1)
        moved[~ahead] = 0.0
        return np.asarray(moved)

    @cached_property
    def misfit(self) -> float:
        """Error of the corners about their picture's own pose of the board, part of its extent.

        Root mean squares; of the middle one of the pictures. Infinite where half of the
        poses have corners behind the camera.
        """
        ahead = np.isfinite(self.errors).any(axis=(1, 2))
        if 2 * ahead.sum() <= self.posed.sum():
            return np.inf
        pixels = self.pixels[ahead]
        spread = pixels - np.nanmean(pixels, axis=1, keepdims=True)
        squares = (np.nansum(offsets**2, axis=(1, 2)) for offsets in (self.errors[ahead], spread))
        return float(np.sqrt(np.median(np.divide(*squares))))

    @property
    def middles(self) -> FloatArray:
        """(n, 2) where the middle of the board is seen; the corners' mean where no pose has it."""
        rotation, position = self.poses
        there = rotation @ self.points.mean(axis=0) + position
        located = self.camera.lens.ahead(there)
        there[~located] = [0.0, 0.0, 1.0]
        mean = np.nanmean(self.pixels, axis=1)
        return np.where(located[:, None], self.camera.project(there), mean)

    def numbered_alike(self, hand: Poses, names: Sequence[str], source: Path | None) -> FloatArray:
        """The pixels, a board that looks the same after half a turn numbered from one end in all.

        The hand is ``T_base_hand``, (n, 3, 3) and (n, 3), or its inverses. It is warned of pictures
        that were numbered from the other end.
        """
        if not self.board.symmetric:
            return self.pixels

        orientation = self.poses[0][self.posed]
        turned = np.zeros(len(self.pixels), dtype=np.bool_)
        turned[self.posed] = half_turned(hand[0][self.posed], orientation, orientation @ HALF_TURN)
        most = "most pictures, judged by the rotations of the hand between them"
        return self._the_other_way(turned, names, source, most)

    def numbered_as(
        self, first: BoardPictures, hands: tuple[Poses, Poses], names: Sequence[str], *, same: bool
    ) -> FloatArray:
        """The pixels, a board that looks the same after half a turn numbered as in other pictures.

        Those come ``first``, of the same board at the same place; ``hands`` are of both, as
        `from_other_end` has them; ``same`` says whether one camera took both. It is warned of
        pictures that were numbered from the other end.
        """
        turned = np.zeros(len(self.pixels), dtype=np.bool_)
        mine, theirs = (
            (some_poses(hand, pictures.posed), some_poses(pictures.poses, pictures.posed))
            for hand, pictures in zip(hands, (self, first), strict=True)
        )
        turned[self.posed] = from_other_end(*mine, theirs, same_eye=same)
        return self._the_other_way(
            turned, names, None, "the pictures of an earlier row, judged by their place"
        )

    def _the_other_way(
        self, turned: BoolArray, names: Sequence[str], source: Path | None, than: str
    ) -> FloatArray:
        """The pixels, some (n,) pictures numbered from the other end, which is warned of."""
        if not turned.any():
            return self.pixels
        warnings.warn(
            f"{source or 'corners'}: the board looks the same after half a turn. In "
            f"{listed(np.array(names)[turned].tolist(), QUOTED)} its corners are numbered from "
            f"the other end than in {than}. They are renumbered there",
            SutaCalibWarning,
            stacklevel=2,
        )
        # Half a turn brings the first point onto the last.
        return np.where(turned[:, None, None], self.pixels[:, ::-1], self.pixels)

    def upside_down(self, hand: Poses) -> dict[str, BoolArray]:
        """Pictures (n,) that agree with the others once they are turned half a turn, or mirrored.

        By what is turned: ``board``, whose corners are numbered from the other end, or ``picture``;
        or by ``mirror``. Those that agree as they are, or not even then, are in none.

        Args:
            hand: ``T_base_hand`` of an eye on the hand, ``T_hand_base`` of one beside it.
        """
        turned_over = {what: np.zeros(len(self.pixels), dtype=np.bool_) for what in TURNED}
        rows = np.flatnonzero(self.posed)
        if not self.board.flat or len(rows) < 2:
            return turned_over
        A, B = some_poses(hand, self.posed), some_poses(self.poses, self.posed)
        X, Z = agreeing_hand_eye(A, B)

        def off(target: Poses) -> tuple[FloatArray, FloatArray]:
            """(n,) turns of loops against Z, rad, and how far they end from it, in distances."""
            R, p = loop_closures(A, X, target)
            turned = np.linalg.norm(vector_from_rotation(Z[0].T @ R), axis=1)
            return turned, np.linalg.norm(p - Z[1], axis=1) / np.linalg.norm(B[1], axis=1)

        # About the board's middle, and about the camera's axis.
        middle = self.points.mean(axis=0)
        board = off((B[0] @ HALF_TURN, B[1] + B[0] @ (middle - HALF_TURN @ middle)))
        picture = off((HALF_TURN @ B[0], B[1] @ HALF_TURN))
        as_it_is = off(B)
        # Turn of a loop of a picture that is read upside down, and of one that is read well.
        strange, upright = as_it_is[0] > np.radians(120.0), np.radians(30.0)
        # Of a board straight ahead of the camera the two are one, but for rounding.
        nearer = sum(board) <= (1.0 + ROUNDING) * sum(picture)
        for name, (turned, _), mine in (("board", board, nearer), ("picture", picture, ~nearer)):
            turned_over[name][rows[strange & mine & (turned < upright)]] = True
        if (as_it_is[0] > upright).any():
            mirrored = [off(some_poses(target, self.posed)) for target in self._mirrored()]
            turned, away = (np.min(parts, axis=0) for parts in zip(*mirrored, strict=True))
            # A picture is mirrored that agrees with the others then, as one in a thousand does by
            # chance (turn of its loop, rad, and how far it ends, in distances), and far better than
            # if anything were turned.
            agrees = (turned < np.radians(10.0)) & (away < 0.1) & (as_it_is[0] > upright)
            agrees &= 2.0 * (turned + away) < np.minimum(sum(board), sum(picture))
            for name, named in turned_over.items():
                named[rows[agrees]] = name == "mirror"
        return turned_over

    def _mirrored(self) -> Iterator[Poses]:
        """``T_eye_board`` of every picture, were it mirrored, as the corners may be numbered then.

        Who numbers a board's corners in a mirrored picture has one side of it run the other way.
        """
        right = np.array([self.camera.width - 1.0, 0.0])
        pixels = right + self.pixels * [-1.0, 1.0]
        rotation, position = replace(self, pixels=pixels).poses
        middle = self.points.mean(axis=0)
        for side in ([1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]):
            turn = np.diag(side)
            for half in (np.eye(3), HALF_TURN):
                there = rotation @ turn, position + rotation @ (middle - turn @ middle)
                yield half @ there[0], there[1] @ half
