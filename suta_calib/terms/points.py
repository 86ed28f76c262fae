"""A depth camera sees points in 3-D: the corners of a board, or the centres of balls."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Level
from suta_calib.errors import SutaCalibWarning
from suta_calib.geometry.numbers import register_points, vector_from_rotation
from suta_calib.geometry.symbols import Symbol
from suta_calib.measurements import Board, read_board
from suta_calib.measurements.fields import Field, Value
from suta_calib.measurements.seen_points import seen_size, unit_hint
from suta_calib.model.parameters import POSITION, Parameter
from suta_calib.terms.block import Block, Pose, Residual, flat, grouped, pose_of
from suta_calib.terms.board_pictures import QUOTED, half_turned
from suta_calib.terms.depth_term import NOISE_KEY, DepthTerm, depth_columns, file_key
from suta_calib.terms.external_frame import (
    ExternalFrame,
    point_named,
    point_parameters,
    pose_named,
    pose_parameters,
    pose_values,
)
from suta_calib.terms.eye import point_in_eye, points_in_eye
from suta_calib.terms.eye_term import BOARD, EYE, TARGET_KEY, BoardEyeTerm, setup_key
from suta_calib.terms.hand_eye_start import (
    FEWEST,
    HALF_TURN,
    EyeSetup,
    Poses,
    agreeing_hand_eye,
    as_eye_in_hand,
    inverse_poses,
    some_poses,
)
from suta_calib.terms.length_scale import stretch_factors, stretch_parameters, stretched_point
from suta_calib.terms.observed import Observed
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.setup import Setup
from suta_calib.terms.target_start import instrument_and_targets
from suta_calib.units import mm
from suta_calib.words import listed


@cache  # What was compiled for a residual is found again by it.
def _off(setup: EyeSetup, on_board: bool, stretched: bool) -> Residual:
    """The residual of a point: across the ray and along it, over how well each is known.

    Args:
        setup: the eye is on the hand, or stands in the base.
        on_board: whether the points are those of a board whose pose is unknown.
        stretched: whether the board's stretch is unknown too.
    """

    def residual(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
        point, axes = unknowns[6:9], ca.reshape(data[3:12], 3, 3)
        if on_board:
            board, point = pose_of(unknowns[6:12]), data[15:18]
            if stretched:
                point = stretched_point(point, unknowns[-2:])
            point = board.R @ point + board.p
        off = point_in_eye(poses[0], pose_of(unknowns[0:6]), point, setup) - data[:3]
        return (axes.T @ off) / data[12:15]

    return residual


@dataclass(frozen=True, eq=False, repr=False)
class DepthPoints(DepthTerm, BoardEyeTerm):
    """``(T_base_hand,i X)⁻¹ P_k - z_ik`` for every point k that a depth camera saw at row i.

    X = ``T_hand_eye`` is unknown. The points P_k are anywhere, each unknown; or they are those of a
    board, ``P_k = Z p_k``, whose pose Z = ``T_base_board`` is unknown. With the camera beside the
    arm X = ``T_base_eye``, the points are on the hand, and Z = ``T_hand_board``. It is
    `tracked_point` with its marks, seen from the other end of the arm.

    The residual is along and across the ray to the point, each over its standard deviation by the
    distance (`DepthNoise`), or in the camera's axes over what the rows state.

    Raises:
        SamplesError: the samples hold no positions, or points that the board does not have.
    """

    kind = "points"
    order = 13
    about = (
        "a depth camera on the tip saw points at x, y, z in its frame (m): corners of a board "
        "(board), or centres of balls anywhere, each named in a column point. With setup: "
        "eye-to-hand the camera is beside the arm, and the points are on the tip. The poses of "
        "camera and board, or the places of the points, are estimated too"
    )
    columns = depth_columns(
        "point", "Name of the point: the number of the board's corner, or any name of a ball."
    )
    mark = "point"
    keys = (
        file_key("point"),
        Field(
            "board",
            Value("file", lambda row, key: read_board(row.existing_file(key))),
            "The board.yaml, if the points are its corners.",
        ),
        setup_key("points"),
        TARGET_KEY,
        NOISE_KEY,
    )
    measured_keys = ("points", "target")
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "point": ("point",),
        "image": ("image",),
        "row": (),
    }
    frames = (EYE, replace(BOARD, required=False))

    # ── from files ────────────────────────────────────────────────────────────────────────────
    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> Self:
        """Build it from a row of a job file, its board numbered from one end."""
        return super().over(poses, setup).numbered_alike()

    @classmethod
    def over_arrays(cls, poses: PoseSource, given: Mapping[str, Any]) -> Self:
        """Build it from arrays, as from files."""
        return super().over_arrays(poses, given).numbered_alike()

    def numbered_alike(self) -> Self:
        """The same with a board that looks the same after half a turn numbered from one end.

        As most pictures have it, judged by the rotations of the hand between them.
        """
        if self.board is None or not self.board.symmetric or not self._posed:
            return self
        turns = np.array([register_points(*pair)[0] for pair in self.of_bodies])
        first = np.array([rows[0] for rows in self._posed])
        hand, _ = as_eye_in_hand(self.poses.at({}), self.setup)
        turned = np.flatnonzero(half_turned(hand[first], turns, turns @ HALF_TURN))
        if not len(turned):
            return self
        samples = self.poses.samples
        names = samples.labels.get("image", np.array(samples.origin))[first[turned]]
        warnings.warn(
            "points: the board looks the same after half a turn. In "
            f"{listed([str(name) for name in names], QUOTED)} its corners are numbered from the "
            "other end than in most pictures, judged by the rotations of the hand between them. "
            "They are renumbered there",
            SutaCalibWarning,
            stacklevel=2,
        )
        # Half a turn brings the first point onto the last.
        numbers = [str(number) for number in self.board.points]
        other = dict(zip(numbers, reversed(numbers), strict=True))
        labels = samples.labels[self.mark].tolist()
        for row in np.concatenate([self._posed[k] for k in turned]):
            labels[row] = other[labels[row]]
        samples = replace(samples, labels={**samples.labels, self.mark: np.array(labels)})
        return self.over_poses(self.poses.with_samples(samples))

    @classmethod
    def marks_in(cls, settings: Mapping[str, Any]) -> Sequence[str]:
        """The corners of the board, where there is one."""
        board = settings.get("board")
        return () if board is None else [str(number) for number in board.points]

    @property
    def settings(self) -> Mapping[str, Any]:
        """With the board."""
        return {**super().settings, "board": self.board, "target": self.target}

    # ── who is unknown ────────────────────────────────────────────────────────────────────────
    @property
    def board_seen(self) -> Board | None:
        """The board, if there is one."""
        return self.board

    @property
    def marks_on_body(self) -> bool:
        """Those of a board are."""
        return self.board is not None

    @property
    def outside(self) -> tuple[ExternalFrame, ...]:
        """The camera, and the board or the points."""
        if self.board is not None:
            return self.eye_outside, self.board_outside
        points = (ExternalFrame(o, self.mark, self.ends[1], POSITION) for o in self.mark_owners)
        return self.eye_outside, *points

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The pose of the camera, then the board's pose and stretch, or the points."""
        eye, board = self.frame_names
        if self.board is None:
            points = (p for owner in self.mark_owners for p in point_parameters(owner))
            return (*pose_parameters(eye), *points)
        stretch = stretch_parameters(board, self.stretch)
        return (*pose_parameters(eye), *pose_parameters(board), *stretch)

    # ── what was seen ─────────────────────────────────────────────────────────────────────────
    @cached_property
    def on_board(self) -> FloatArray:
        """(n, 3) where on the board the point of each row is, m."""
        assert self.board is not None
        names, which = self.seen
        if not self.marked and not self.in_eye.any():
            # Nobody has looked yet: its middle stands for all of it.
            return np.tile(np.mean([*self.board.points.values()], axis=0), (len(which), 1))
        places = []
        for name in names:
            is_number = name.isdecimal() and int(name) in self.board.points
            if not is_number:
                raise self.refuse(
                    f"point {name!r}" if name else "no column point",
                    f"{self.board.numbering} ({self.board.type})",
                    hint="check whether the points and the board belong together",
                )
            places.append(self.board.points[int(name)])
        return np.array(places)[which]

    @cached_property
    def of_bodies(self) -> list[tuple[FloatArray, FloatArray]]:
        """Points on the board and in the camera, of each picture that tells the board's pose."""
        if self.board is None:
            return []
        return [(self.on_board[rows], self.in_eye[rows]) for rows in self._posed]

    @cached_property
    def _posed(self) -> list[IntArray]:
        """Rows of each picture with points that are not on a line."""
        order = np.argsort(self.picture, kind="stable")
        ends = np.flatnonzero(np.diff(self.picture[order])) + 1
        return [rows for rows in np.split(order, ends) if _spread_out(self.on_board[rows])]

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Where points are off, across the ray and along it."""
        (axes, _), n, which = self.scatter, len(self.poses), self.seen[1]
        data = [self.in_eye, flat(axes), self.relative]
        if self.board is None:
            points = 6 + 3 * which[:, None] + np.arange(3)
            own_columns = np.hstack([np.tile(np.arange(6), (n, 1)), points])
        else:
            data.append(self.on_board)
            own_columns = np.tile(np.arange(len(self.own_parameters)), (n, 1))
        residual = _off(self.setup, self.board is not None, self.stretch is not None)
        block = Block.per_sample(
            *("position", "m", 3, residual, own_columns, np.hstack(data), self.noise),
            self.poses.samples.origin,
        )
        return (self.by_distance(block),)

    def readings(self, block: Block) -> IntArray:
        """A point that is seen again at the same rest is the same reading."""
        del block
        return np.column_stack([self.poses.rests, self.seen[1]])

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The points as the camera sees them; in sight are those ahead, within a cone of 62°.

        Without a column point, the middle of all that are known.
        """
        labels = poses.samples.labels.get(self.mark)
        places = self._places(values)
        if labels is None:
            points = np.tile(np.mean([*places.values()], axis=0), (len(poses), 1))
        else:
            names, which = grouped(labels)
            points = np.array([places[name] for name in names])[which]
        eye = pose_named(values, self.frame_names[0])
        in_camera = points_in_eye(poses.at(values), eye, points, self.setup)
        # Half the opening of a depth camera's view, as the slope of its edge: 2 · 31°.
        ahead = in_camera[:, 2] > np.linalg.norm(in_camera[:, :2], axis=1) / 0.6
        sigma = None if self.depth_noise is None else self.depth_noise.sigmas(in_camera[:, 2])
        return Observed(in_camera, axes=self.simulated_axes(in_camera), sigma=sigma, sighted=ahead)

    def _places(self, values: Mapping[str, float]) -> dict[str, FloatArray]:
        """By name, where all points are that these values know, in what carries them, m."""
        if self.board is None:
            owners = [n.removesuffix(".x") for n in values if n.endswith(".x")]
            mine = [n for n in owners if n == self.mark or n.startswith(f"{self.mark}[")]
            # A single one, that has no name, counts where no other does.
            named = [n for n in mine if n != self.mark] or mine
            return {n.partition("[")[2].removesuffix("]"): point_named(values, n) for n in named}
        R, p = pose_named(values, self.frame_names[1])
        factors = stretch_factors(self.own_parameters, values)
        return {str(k): R @ (factors * at) + p for k, at in self.board.points.items()}

    # ── where the solver starts ───────────────────────────────────────────────────────────────
    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """By the board's pose in every picture; or of points, as targets of an instrument.

        From the carrier of the camera, what carries the points moves: the camera is the instrument
        that stands there, and the points are its targets.
        """
        carrier = as_eye_in_hand((rotation, position), self.setup)
        rest = np.zeros(2 if self.stretch is not None else 0)
        if self.board is not None and len(self._posed) >= FEWEST:
            X, Z = self._by_pictures(carrier)
            return np.concatenate([pose_values(*X), pose_values(*Z), rest])
        which = self.seen[1]
        R, p, points = instrument_and_targets(inverse_poses(carrier), self.in_eye, which)
        eye = pose_values(*inverse_poses((R, p)))
        if self.board is None:
            return np.concatenate([eye, points.reshape(-1)])
        Z = register_points(self.on_board, points[which])
        return np.concatenate([eye, pose_values(*Z), rest])

    def _by_pictures(self, carrier: Poses) -> tuple[Poses, Poses]:
        registered = [register_points(*pair) for pair in self.of_bodies]
        poses_seen = np.array([R for R, _ in registered]), np.array([p for _, p in registered])
        first = np.array([rows[0] for rows in self._posed])
        return agreeing_hand_eye(some_poses(carrier, first), poses_seen)

    # ── what is refused, or doubted ───────────────────────────────────────────────────────────
    def check_marks(self) -> None:
        """Of a board its size, of other points that each is seen again."""
        if self.board is None:
            super().check_marks()
        else:
            self._check_size()

    def _check_size(self) -> None:
        """Refuse points that lie apart as no points of this board do."""
        size = self._size
        # What is wrong with a depth camera's scale, or a printed board's, is a few per cent.
        most = 0.1
        if size is None or abs(size[0] - 1.0) <= most:
            return
        far_off = f"{size[0]:.3g} times as far apart as board.yaml has them"
        unit = unit_hint(size[0])
        hint = (
            f"the points seem to be in {unit}: use columns x_mm, y_mm, z_mm for mm, and "
            "suta-calib detect --depth-unit for pictures of depth"
            if unit
            else "check the size of the squares in board.yaml, the unit of the depth, and the "
            "camera's file"
        )
        raise self.refuse(f"points of the board {far_off}", "its points, in m", hint)

    @cached_property
    def _size(self) -> tuple[float, float] | None:
        """How many times as large as its file says the board is seen, with its ±."""
        return seen_size(self.of_bodies)

    @property
    def doubts(self) -> Mapping[str, Level]:
        """Also turns that are too small; a board of another size than its file says."""
        doubts: dict[str, Level] = dict.fromkeys(self._turned_too_little(), "care")
        doubts |= super().doubts
        measured = self.in_eye
        if self._size is not None:
            times, std = self._size
            # A tenth of a per cent is 1 mm at a metre: less is no matter with a depth camera.
            if abs(times - 1.0) > max(1e-3, 4.0 * std):
                doubts[
                    f"The camera sees the board {abs(times - 1.0):.2%} ± {std:.2%} too "
                    f"{'large' if times > 1 else 'small'}. At {_away(measured):.0f} mm that is "
                    f"{abs(times - 1.0) * _away(measured):.2g} mm. Either its depth has another "
                    "scale, or the squares of the board have another size: measure the board."
                ] = "care"
        return doubts

    def _turned_too_little(self) -> Iterator[str]:
        """What is open where the hand turned about one axis, or not at all."""
        rotation, _ = self.poses.at({})
        turns = vector_from_rotation(rotation[0].T @ rotation)
        turned = np.linalg.svd(turns - turns.mean(axis=0), compute_uv=False) / np.sqrt(len(turns))
        # Turns of less than 3° tell a lever by less than a twentieth of what they move.
        least = 0.05
        if turned[0] < least:
            yield (
                "The hand hardly turned: these points do not determine where the camera is on what "
                "carries it. Turn the hand by tens of degrees about two axes that are not parallel."
            )
        elif turned[1] < least:
            yield (
                "The hand turned about one axis only: these points do not determine where the "
                "camera is along that axis. Turn the hand about another axis too."
            )


def _away(points: FloatArray) -> float:
    """Middle distance of points (n, 3), mm."""
    return float(mm(np.median(np.linalg.norm(points, axis=1))))


def _spread_out(points: FloatArray) -> bool:
    """Whether points (n, 3) are three at least, and not on a line."""
    if len(points) < 3:
        return False
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    # Second over first singular value of points that are on a line.
    return bool(singular[1] > 1e-3 * singular[0])
