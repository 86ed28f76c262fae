"""Pictures of one board by one camera: where it is in each, and whether they can be of the two."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.geometry.pinhole import projected, undistorted
from suta_calib.measurements import Board, Camera
from suta_calib.measurements.csv_table import SutaCalibWarning
from suta_calib.terms.camera_start import PLANAR, board_poses, columns_exchanged
from suta_calib.terms.hand_eye_start import (
    HALF_TURN,
    Poses,
    agreeing_hand_eye,
    loop_closures,
    some_poses,
)
from suta_calib.words import listed

# Corners that are off by this part of the board's extent in a picture are of no such board.
NO_BOARD: Final = 0.1
# Another board or camera is the cause where it leaves so many times less.
FAR_BETTER: Final = 2.0
# Misfit, part of the board's extent, that any camera leaves: nothing is asked below it.
FINE: Final = 1e-3
# Pictures of which it is asked: what is wrong with the files is wrong with all.
ENOUGH: Final = 8
# Sizes of a picture against the one that the camera's file is of.
RESIZED: Final = (1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 2.0, 3.0, 4.0)
# Sizes of markers against those that a board's file has.
MARKERS: Final = (0.6, 1.6)
# Part of a picture's size up to which twice its principal point comes near it in any camera.
CENTRED: Final = 0.8
# Turn of a loop, rad, of a picture that is read upside down, and of one that is read well.
HALF_TURNED: Final = np.radians(120.0)
UPRIGHT: Final = np.radians(30.0)
MIRRORED: Final = (
    "The board is seen from behind: its corners are numbered mirrored (columns and rows exchanged, "
    "or y upwards)."
)
# Pictures that a sentence names.
QUOTED: Final = 5
# Relative difference that is none.
ROUNDING: Final = 1e-9
# Errors of a picture, in those of the middle one and in px, from which on corners are wrong.
FAR_OFF: Final = 10.0
SEEN: Final = 2.0
# By what is turned: how pictures are told of which the others say that they are upside down.
TURNED: Final = {
    "board": "the board is turned by half a turn: its corners are numbered from the other end.",
    "picture": "the picture is turned by half a turn: the camera was, or what wrote its file.",
}


@dataclass(frozen=True, eq=False)
class BoardPictures:
    """Corners of a board in pictures.

    Attributes:
        board: that is seen.
        camera: that sees it.
        pixels: (n, points, 2) px; NaN where a corner was not found.
    """

    board: Board
    camera: Camera
    pixels: FloatArray

    @cached_property
    def points(self) -> FloatArray:
        """(points, 3) of the board, m."""
        return np.array(list(self.board.points.values()))

    @cached_property
    def poses(self) -> Poses:
        """``T_eye_board`` of every picture, by its own corners; NaN where they do not tell it."""
        return board_poses(self.points, undistorted(self.pixels, self.camera.intrinsics))

    def of(self, board: Board, camera: Camera, pixels: FloatArray) -> bool:
        """Whether these are the very same."""
        return self.board is board and self.camera is camera and self.pixels is pixels

    def take(self, rows: ArrayLike, pixels: FloatArray | None) -> BoardPictures | None:
        """Some of the pictures, of which these are the pixels; what is known of them is kept."""
        if pixels is None:
            return None
        some = BoardPictures(self.board, self.camera, pixels)
        if "poses" in vars(self):
            rotation, position = self.poses
            chosen = np.asarray(rows)
            vars(some)["poses"] = rotation[chosen], position[chosen]
        return some

    def among(self, pixels: FloatArray | None) -> BoardPictures | None:
        """These pictures in another order, or some of them, with what is known of each.

        None where there are others among them.
        """
        if pixels is None or pixels is self.pixels:
            return None if pixels is None else self
        number = {picture.tobytes(): k for k, picture in enumerate(self.pixels)}
        rows = [number.get(picture.tobytes(), -1) for picture in pixels]
        return None if -1 in rows else self.take(rows, pixels)

    @property
    def pixel(self) -> float | None:
        """Length, m, that a pixel covers where the board typically is; None if nothing tells."""
        _, position = self.poses
        depth = position[:, 2]
        seen = depth[np.isfinite(depth) & (depth > 0)]
        focal = float(np.sqrt(self.camera.intrinsics[0] * self.camera.intrinsics[1]))
        return float(np.median(seen)) / focal if len(seen) else None

    @property
    def told(self) -> BoolArray:
        """(n,) pictures that tell where the board is."""
        return np.isfinite(self.poses[1][:, 0])

    @property
    def behind(self) -> bool:
        """Whether a flat board is seen from behind, which its numbering alone decides."""
        if not self.board.flat:
            return False
        rotation, position = some_poses(self.poses, self.told)
        facing = np.einsum("ni,ni->n", rotation[:, :, 2], position)
        return bool(len(facing) and np.median(facing) < 0)

    @property
    def other_size(self) -> str:
        """That the camera's file tells a size that its principal point and all corners deny.

        Empty where they do not: a principal point may be far from the middle of pictures that were
        cut out of larger ones, but then corners are beyond twice of it.
        """
        camera = self.camera
        size = np.array([camera.width, camera.height])
        # Pixels are counted from the centre of the first one.
        middle = camera.intrinsics[2:4]
        whole = 2.0 * middle + 1.0
        small = whole < CENTRED * size
        seen = self.pixels[np.isfinite(self.pixels).all(axis=2)]
        if not small.any() or (seen + 0.5 > whole)[:, small].any():
            return ""
        return (
            f"The camera's file says {camera.width} x {camera.height} px, but its principal point "
            f"({middle[0]:.1f}, {middle[1]:.1f}) px is the middle of some {whole[0]:.0f} x "
            f"{whole[1]:.0f} px, and no corner is beyond: image_width and image_height, or "
            "camera_matrix, are of pictures of another size."
        )

    @property
    def misread(self) -> Iterator[tuple[str, FloatArray]]:
        """The pixels as they are if they were counted or taken in another way; which.

        Each mirrors the pictures, which no pose of a board makes up for in all of them.
        """
        u, v = self.pixels[..., 0], self.pixels[..., 1]
        right, below = self.camera.width - 1.0, self.camera.height - 1.0
        for sentence, other in (
            ("v counts upwards, from the lowest row, or the pictures are mirrored", (u, below - v)),
            ("u and v are exchanged", (v, u)),
            ("left and right are exchanged in the pictures", (right - u, v)),
        ):
            yield sentence, np.stack(other, axis=-1)

    @cached_property
    def errors(self) -> FloatArray:
        """(n, points, 2) of the corners about their picture's own pose of the board, px.

        NaN where a corner was not found, and in pictures that tell no pose before the camera.
        """
        rotation, position = self.poses
        points = np.einsum("nij,kj->nki", rotation, self.points) + position[:, None]
        ahead = (points[..., 2] > 0).all(axis=1)
        points[~ahead] = [0.0, 0.0, 1.0]
        off = projected(points, self.camera.intrinsics) - self.pixels
        off[~ahead] = np.nan
        return np.asarray(off)

    def strange(self, names: Sequence[str]) -> list[str]:
        """Pictures whose corners are far from where they are in any pose of the board; which.

        Args:
            names: (n,) of the pictures.
        """
        off = _root_mean_square(self.errors)
        limit = max(FAR_OFF * float(np.nanmedian(off)), SEEN) if np.isfinite(off).any() else np.inf
        nowhere = self.told & np.isnan(off)
        said = []
        for k in np.flatnonzero(nowhere | (off > limit)).tolist():
            what = "" if nowhere[k] else self._blunder(k, limit)
            how_far = "" if nowhere[k] else f" {off[k]:.0f} px"
            said.append(
                f"In {names[k]} {what or f'the corners are{how_far}'} off where the board has them "
                "in any pose: leave the picture out (exclude)."
            )
        return said

    def _blunder(self, picture: int, limit: float) -> str:
        """The corner without which all others are within ``limit`` px; empty if there is none."""
        found = np.flatnonzero(np.isfinite(self.pixels[picture]).all(axis=1))
        if len(found) <= PLANAR:
            return ""
        pixels = np.repeat(self.pixels[picture][None], len(found), axis=0)
        pixels[np.arange(len(found)), found] = np.nan
        without = replace(self, pixels=pixels)
        off = _root_mean_square(without.errors)
        if not np.isfinite(off).any() or np.nanmin(off) > limit:
            return ""
        best = int(np.nanargmin(off))
        rotation, position = (part[best] for part in without.poses)
        place = rotation @ self.points[found[best]] + position
        seen = self.pixels[picture, found[best]]
        away = float(np.linalg.norm(projected(place, self.camera.intrinsics) - seen))
        return f"corner {list(self.board.points)[found[best]]} is {away:.0f} px"

    @cached_property
    def misfit(self) -> float:
        """Error of the corners about their picture's own pose of the board, part of its extent.

        Root mean squares; of the middle one of the pictures. Infinite where half of the
        poses have corners behind the camera.
        """
        ahead = np.isfinite(self.errors).any(axis=(1, 2))
        if 2 * ahead.sum() <= self.told.sum():
            return np.inf
        seen = self.pixels[ahead]
        apart = seen - np.nanmean(seen, axis=1, keepdims=True)
        squares = (np.nansum(each**2, axis=(1, 2)) for each in (self.errors[ahead], apart))
        return float(np.sqrt(np.median(np.divide(*squares))))

    def check(self) -> None:
        """Refuse corners that another board or camera explains far better, or that none does.

        Raises:
            SamplesError: names what explains them.
        """
        if len(self.pixels) > ENOUGH:
            some = np.linspace(0, len(self.pixels) - 1, ENOUGH).astype(np.intp)
            fewer = self.take(some, self.pixels[some])
            assert fewer is not None
            fewer.check()
            return
        if self.misfit <= FINE:
            return
        others = list(self._others())
        _pose_together([other for other, _ in others if other.board is self.board])
        misfits = [(other.misfit, error) for other, error in others]
        least, cause = min(misfits, key=lambda other: other[0], default=(np.inf, None))
        if cause is not None and FAR_BETTER * least < self.misfit:
            raise cause
        if self.misfit > NO_BOARD:
            raise SamplesError(
                f"corners that are more than {NO_BOARD:.0%} of the board's extent off from where "
                "any pose of it has them",
                f"corners of this board ({self.board.type}), by their numbers",
                hint="corners, board.yaml and camera.yaml belong together",
            )

    @staticmethod
    def _last_row(board: Board) -> BoolArray:
        """(points,) which have the largest y."""
        y = np.array(list(board.points.values()))[:, 1]
        return np.asarray(y > y.max() - ROUNDING)

    def _others(self) -> Iterator[tuple[BoardPictures, SamplesError]]:
        """The same corners of another board, or by a camera of another size, and what it means."""
        exchanged = self.board.exchanged
        found = np.asarray(np.isfinite(self.pixels).all(axis=2))
        # A board of fewer rows has as many columns as this one exchanged, but never its last row.
        if exchanged is not None and found[:, self._last_row(exchanged)].any():
            yield replace(self, board=exchanged), columns_exchanged()
        if self.misfit > NO_BOARD:
            for other in self.board.recounted:
                more = len(other.points) - self.pixels.shape[1]
                pixels = np.pad(self.pixels, ((0, 0), (0, more), (0, 0)), constant_values=np.nan)
                yield (
                    replace(self, board=other, pixels=pixels),
                    SamplesError(
                        f"corners that are numbered along rows of {other.columns}",
                        "corners of the board as its file has it",
                        hint="corners and board.yaml belong together; it counts inner corners: "
                        "columns first, then rows",
                    ),
                )
        if other_markers := self._other_markers():
            yield other_markers
        corners = self.pixels[found]
        for factor in RESIZED:
            camera = self.camera.resized(factor)
            if not camera.inside(corners).all():
                continue
            yield (
                replace(self, camera=camera),
                SamplesError(
                    f"corners of pictures of some {camera.width} x {camera.height} px",
                    f"of {self.camera.width} x {self.camera.height} px, as the camera's file says",
                    hint="calibrate the camera on pictures of the same size, or scale its file",
                ),
            )

    def _other_markers(self) -> tuple[BoardPictures, SamplesError] | None:
        """The same corners of markers of the size that agrees best with the ways between them."""
        if self.board.with_markers(1.0) is None:
            return None
        from scipy.optimize import minimize_scalar

        def resized(factor: float) -> BoardPictures:
            board = self.board.with_markers(factor)
            assert board is not None
            return replace(self, board=board)

        best = minimize_scalar(
            lambda log: resized(np.exp(log)).misfit, bounds=np.log(MARKERS), method="bounded"
        )
        factor = float(np.exp(best.x))
        return resized(factor), SamplesError(
            f"corners of markers {factor:.3f} times as large, by the ways between them, as the "
            "board's file says",
            "markers of the size that they were printed in, and at their places",
            hint="measure markers and the ways between them; correct size_mm, or all position_mm",
        )

    def numbered_alike(self, hand: Poses, names: Sequence[str], source: Path | None) -> FloatArray:
        """The pixels, a board that looks the same after half a turn numbered from one end in all.

        Args:
            hand: ``T_base_hand``, rotations (n, 3, 3) and positions (n, 3), or their inverses.
            names: (n,) of the pictures.
            source: the file of the corners.

        Warns:
            SutaCalibWarning: in some pictures it was numbered from the other end.
        """
        if not self.board.symmetric:
            return self.pixels
        from suta_calib.terms.half_turns import half_turned

        seen = self.poses[0][self.told]
        turned = np.zeros(len(self.pixels), dtype=np.bool_)
        turned[self.told] = half_turned(hand[0][self.told], seen, seen @ HALF_TURN)
        most = "most pictures, by the turns of the hand between them"
        return self._the_other_way(turned, names, source, most)

    def numbered_as(
        self, first: BoardPictures, hands: tuple[Poses, Poses], names: Sequence[str], *, same: bool
    ) -> FloatArray:
        """The pixels, a board that looks the same after half a turn numbered as in other pictures.

        Args:
            first: those pictures, of the same board at the same place.
            hands: of these and of the first ones, as `from_other_end` has them.
            names: (n,) of the pictures.
            same: whether one camera took both.

        Warns:
            SutaCalibWarning: in some pictures it was numbered from the other end.
        """
        from suta_calib.terms.half_turns import from_other_end

        turned = np.zeros(len(self.pixels), dtype=np.bool_)
        mine, theirs = (
            (some_poses(hand, pictures.told), some_poses(pictures.poses, pictures.told))
            for hand, pictures in zip(hands, (self, first), strict=True)
        )
        turned[self.told] = from_other_end(*mine, theirs, same_eye=same)
        return self._the_other_way(
            turned, names, None, "the pictures of a row before, by its place"
        )

    def _the_other_way(
        self, turned: BoolArray, names: Sequence[str], source: Path | None, than: str
    ) -> FloatArray:
        """The pixels, some (n,) pictures numbered from the other end, which is warned of."""
        if not turned.any():
            return self.pixels
        warnings.warn(
            f"{source or 'corners'}: the board looks the same after half a turn; in "
            f"{listed(np.array(names)[turned].tolist(), QUOTED)} its corners are numbered from the "
            f"other end than in {than}: they are taken the other way round there",
            SutaCalibWarning,
            stacklevel=2,
        )
        # Half a turn brings the first point onto the last.
        return np.where(turned[:, None, None], self.pixels[:, ::-1], self.pixels)

    def upside_down(self, hand: Poses) -> dict[str, BoolArray]:
        """Pictures (n,) that agree with the others once they are turned by half a turn.

        By what is turned: ``board``, whose corners are numbered from the other end, or ``picture``.
        Those that agree as they are, or not even then, are in neither.

        Args:
            hand: ``T_base_hand`` of an eye on the hand, ``T_hand_base`` of one beside it.
        """
        nobody = np.zeros(len(self.pixels), dtype=np.bool_)
        found = {"board": nobody, "picture": nobody.copy()}
        rows = np.flatnonzero(self.told)
        if not self.board.flat or len(rows) < 2:
            return found
        A, B = some_poses(hand, self.told), some_poses(self.poses, self.told)
        X, Z = agreeing_hand_eye(A, B)

        def off(seen: Poses) -> tuple[FloatArray, FloatArray]:
            """(n,) turns of loops against Z, rad, and how far they end from it, in distances."""
            R, p = loop_closures(A, X, seen)
            turned = np.linalg.norm(vector_from_rotation(Z[0].T @ R), axis=1)
            return turned, np.linalg.norm(p - Z[1], axis=1) / np.linalg.norm(B[1], axis=1)

        # About the board's middle, and about the camera's axis.
        middle = self.points.mean(axis=0)
        board = off((B[0] @ HALF_TURN, B[1] + B[0] @ (middle - HALF_TURN @ middle)))
        picture = off((HALF_TURN @ B[0], B[1] @ HALF_TURN))
        strange = off(B)[0] > HALF_TURNED
        # Of a board straight ahead of the camera the two are one, but for rounding.
        nearer = sum(board) <= (1.0 + ROUNDING) * sum(picture)
        for name, (turned, _), mine in (("board", board, nearer), ("picture", picture, ~nearer)):
            found[name][rows[strange & mine & (turned < UPRIGHT)]] = True
        return found


def _root_mean_square(errors: FloatArray) -> FloatArray:
    """(n,) of the corners (n, points, 2) that were found; NaN where none was."""
    squared = np.sum(errors**2, axis=2)
    count = np.isfinite(squared).sum(axis=1)
    return np.asarray(np.sqrt(np.nansum(squared, axis=1) / np.where(count > 0, count, np.nan)))


def _pose_together(others: Sequence[BoardPictures]) -> None:
    """Find the poses of one board's pictures by several cameras at once, a tenth of the work."""
    if not others:
        return
    seen = [undistorted(each.pixels, each.camera.intrinsics) for each in others]
    rotation, position = board_poses(others[0].points, np.concatenate(seen))
    ends = np.cumsum([len(each) for each in seen])[:-1]
    for each, R, p in zip(others, np.split(rotation, ends), np.split(position, ends), strict=True):
        vars(each)["poses"] = R, p
