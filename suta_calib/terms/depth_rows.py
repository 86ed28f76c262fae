"""What a depth camera saw, as numbers that change with its pose, with what it saw, and the hand.

Every point z of the camera is at ``A_i X (1 - s) z`` outside, for the pose A_i of what carries the
camera, X of the camera in it, and s, by which its lengths are too long. It is compared with a plane
(one number: its height), with a point, or with a point of a board (three numbers, in the axes in
which the camera errs). All are over their standard deviations.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import (
    register_points,
    right_singular,
    rotation_from_vector,
    skew,
)
from suta_calib.measurements import Board
from suta_calib.measurements.pose_files import FAR, NEAR
from suta_calib.measurements.seen_points import SeenPoints
from suta_calib.terms.depth_term import DepthTerm, with_seen
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EyeSetup, Poses, some_poses
from suta_calib.terms.plane_view import PlaneView
from suta_calib.terms.points import DepthPoints
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.terms.setup import Setup

# Unknowns that all numbers share: a turn of X about its own axes, where it is, and the scale.
SHARED: Final = 7
SCALE: Final = 6
# Standard deviation of a scale that is exact by definition: the solver needs one.
EXACT: Final = 1e-9
# Numbers by which a hand errs: displacement, and turn.
OF_HAND: Final = 6


@dataclass(frozen=True, eq=False)
class Eye:
    """A camera, in what carries it.

    Attributes:
        rotation: (3, 3).
        position: (3,), m.
        scale: by which part its lengths are too long.
    """

    rotation: FloatArray
    position: FloatArray
    scale: float = 0.0

    def moved(self, step: FloatArray) -> Eye:
        """After a step (7,) of the shared unknowns."""
        turned = self.rotation @ rotation_from_vector(step[:3])
        return Eye(turned, self.position + step[3:6], self.scale + float(step[SCALE]))


@dataclass(frozen=True, eq=False)
class Numbers:
    """Numbers of one kind: (n, k) from n points.

    Attributes:
        off: (n, k) over their standard deviations.
        by_place: (n, k, 3) derivative by where the camera has the point, outside, per m.
        by_mark: (n, k, q) derivative by unknowns of what was seen.
        columns: (n, q) which of these.
        apart: (n, 3) how far the point is from what it should be on, m.
    """

    off: FloatArray
    by_place: FloatArray
    by_mark: FloatArray
    columns: IntArray
    apart: FloatArray


class Prior(NamedTuple):
    """What is known of an unknown before the data are asked, zero but for a standard deviation."""

    column: int
    at: float
    std: float


class Marks(ABC):
    """Things that a camera saw, where the answer has them outside.

    Attributes:
        term: with all points.
        unknowns: how many numbers they have.
    """

    term: DepthTerm
    unknowns: int

    @property
    def priors(self) -> Sequence[Prior]:
        """Of their unknowns, numbered from 0."""
        return ()

    @property
    def which(self) -> IntArray:
        """(n,) which of them each point is of."""
        return self.term.seen[1]

    @abstractmethod
    def numbers(self, at: FloatArray, turn: FloatArray) -> Numbers:
        """Of points at (n, 3), m, of a camera that is turned (n, 3, 3) there."""

    @abstractmethod
    def moved(self, step: FloatArray) -> Marks:
        """After a step of their unknowns."""


@dataclass(frozen=True, eq=False)
class PlaneMarks(Marks):
    """Planes: two tilts and the distance of each.

    Attributes:
        normal: (m, 3).
        distance: (m,) from the origin, along the normals, m.
    """

    term: PlaneView
    normal: FloatArray
    distance: FloatArray

    @classmethod
    def of(cls, term: PlaneView, at: FloatArray) -> PlaneMarks:
        """The middle planes of points at (n, 3), m; few that are wrong decide nothing."""
        names, which = term.seen
        found = [_middle_plane(at[which == k]) for k in range(len(names))]
        return cls(term, np.array([n for n, _ in found]), np.array([d for _, d in found]))

    @property
    def unknowns(self) -> int:  # type: ignore[override]
        """Three of each."""
        return 3 * len(self.distance)

    @cached_property
    def across(self) -> FloatArray:
        """(m, 2, 3) two directions in each plane."""
        return np.array([right_singular(normal[None])[1][1:] for normal in self.normal])

    def numbers(self, at: FloatArray, turn: FloatArray) -> Numbers:
        """Heights."""
        del turn
        normal, sigma = self.normal[self.which], self.term.sigmas
        height = np.einsum("ni,ni->n", normal, at) - self.distance[self.which]
        tilted = np.einsum("nki,ni->nk", self.across[self.which], at)
        by_mark = np.column_stack([tilted, -np.ones(len(at))]) / sigma
        return Numbers(
            height[:, None] / sigma,
            (normal / sigma)[:, None],
            by_mark[:, None],
            3 * self.which[:, None] + np.arange(3),
            height[:, None] * normal,
        )

    def moved(self, step: FloatArray) -> PlaneMarks:
        """Tilted and shifted; normals keep their length."""
        steps = step.reshape(-1, 3)
        normal = self.normal + np.einsum("mk,mki->mi", steps[:, :2], self.across)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return PlaneMarks(self.term, normal / length, self.distance + steps[:, 2])


@dataclass(frozen=True, eq=False)
class PointMarks(Marks):
    """Points that stand anywhere.

    Attributes:
        places: (m, 3), m.
    """

    term: DepthPoints
    places: FloatArray

    @classmethod
    def of(cls, term: DepthPoints, at: FloatArray) -> PointMarks:
        """Where most have them."""
        names, which = term.seen
        return cls(term, np.array([np.median(at[which == k], axis=0) for k in range(len(names))]))

    @property
    def unknowns(self) -> int:  # type: ignore[override]
        """Three of each."""
        return self.places.size

    def numbers(self, at: FloatArray, turn: FloatArray) -> Numbers:
        """How far points are off."""
        apart, axes = at - self.places[self.which], _axes_over_sigma(self.term, turn)
        columns = 3 * self.which[:, None] + np.arange(3)
        return Numbers(np.einsum("nki,ni->nk", axes, apart), axes, -axes, columns, apart)

    def moved(self, step: FloatArray) -> PointMarks:
        """Elsewhere."""
        return replace(self, places=self.places + step.reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class BoardMarks(Marks):
    """A board: a turn about its own axes, where it is, and by which part it is too small.

    Attributes:
        rotation: (3, 3).
        position: (3,), m.
        larger: than its file says, as a part.
    """

    term: DepthPoints
    rotation: FloatArray
    position: FloatArray
    larger: float = 0.0
    unknowns: int = 7

    @property
    def priors(self) -> Sequence[Prior]:
        """Its size is as sure as its file says."""
        assert self.term.board is not None
        return (Prior(6, self.larger, max(self.term.board.length_scale.std, EXACT)),)

    @classmethod
    def of(cls, term: DepthPoints, at: FloatArray) -> BoardMarks:
        """Where most points have it."""
        names, which = term.seen
        middle = np.array([np.median(at[which == k], axis=0) for k in range(len(names))])
        first = np.unique(which, return_index=True)[1]
        return cls(term, *register_points(term.on_board[first], middle))

    def numbers(self, at: FloatArray, turn: FloatArray) -> Numbers:
        """How far points are off those of the board."""
        on_board = (1.0 + self.larger) * self.term.on_board
        apart = at - on_board @ self.rotation.T - self.position
        axes = _axes_over_sigma(self.term, turn)
        by_turn = axes @ self.rotation @ skew(on_board)
        by_size = -axes @ (self.term.on_board @ self.rotation.T)[:, :, None]
        by_mark = np.concatenate([by_turn, -axes, by_size], axis=2)
        columns = np.tile(np.arange(self.unknowns), (len(at), 1))
        return Numbers(np.einsum("nki,ni->nk", axes, apart), axes, by_mark, columns, apart)

    def moved(self, step: FloatArray) -> BoardMarks:
        """Turned, shifted, and of another size."""
        turned = self.rotation @ rotation_from_vector(step[:3])
        position, larger = self.position + step[3:6], self.larger + float(step[6])
        return replace(self, rotation=turned, position=position, larger=larger)


def _axes_over_sigma(term: DepthPoints, turn: FloatArray) -> FloatArray:
    """(n, 3, 3) rows that make of a displacement outside what it is over standard deviations."""
    axes, sigma = term.scatter
    return np.asarray(np.swapaxes(turn @ axes, 1, 2) / sigma[:, :, None])


def _middle_plane(points: FloatArray) -> tuple[FloatArray, float]:
    """Normal and distance of the plane that most points (n, 3) are on."""
    weight = np.ones(len(points))
    for _ in range(8):
        middle = weight @ points / weight.sum()
        scaled = (points - middle) * np.sqrt(weight)[:, None]
        normal = right_singular(scaled)[1][-1]
        height = np.abs((points - middle) @ normal)
        weight = 1.0 / (1.0 + (height / max(2.0 * float(np.median(height)), 1e-9)) ** 2)
    return normal, float(normal @ middle)


@dataclass(frozen=True, eq=False)
class State:
    """An answer: the camera, and where everything is that it saw.

    Attributes:
        eye: the camera.
        marks: what it saw, of each term.
        scale_std: standard deviation of the camera's scale before the data are asked.
    """

    eye: Eye
    marks: tuple[Marks, ...]
    scale_std: float

    @property
    def priors(self) -> list[Prior]:
        """Of all unknowns."""
        priors, first = [Prior(SCALE, self.eye.scale, self.scale_std)], SHARED
        for mark in self.marks:
            priors += [prior._replace(column=first + prior.column) for prior in mark.priors]
            first += mark.unknowns
        return priors

    def moved(self, step: FloatArray) -> State:
        """After a step of all unknowns."""
        ends = np.cumsum([SHARED, *(m.unknowns for m in self.marks)])
        parts = np.split(step, ends[:-1])[1:]
        marks = tuple(m.moved(part) for m, part in zip(self.marks, parts, strict=True))
        return State(self.eye.moved(step[:SHARED]), marks, self.scale_std)

    @property
    def unknowns(self) -> int:
        """How many numbers it has."""
        return SHARED + sum(mark.unknowns for mark in self.marks)


@dataclass(frozen=True, eq=False)
class PictureSums:
    """What a picture's numbers r come to, with derivatives J by unknowns and H by the hand.

    Attributes:
        count: (n,) numbers.
        rr: (n,) squares.
        Hr: (n, 6).
        HH: (n, 6, 6).
        HJ: (n, 6, p).
        Jr: (n, p).
        JJ: (n, p, p).
        off: (n, 3) mean of how far its points are off, m.
    """

    count: IntArray
    rr: FloatArray
    Hr: FloatArray
    HH: FloatArray
    HJ: FloatArray
    Jr: FloatArray
    JJ: FloatArray
    off: FloatArray

    def take(self, rows: BoolArray) -> PictureSums:
        """Those of some pictures."""
        return PictureSums(**{name: part[rows] for name, part in vars(self).items()})


@dataclass(frozen=True, eq=False)
class DepthRows:
    """All numbers of some terms, by picture.

    Attributes:
        terms: planes, points, or both, with their poses in `poses`.
        carrier: poses (n, 3, 3) and (n, 3), m, of what carries the camera, one for each picture.
        picture: (rows,) of each term, which picture each of its rows is of.
        setup: where the camera is.
        scale_std: standard deviation of the camera's scale before the data are asked.
    """

    terms: tuple[DepthTerm, ...]
    carrier: Poses
    picture: tuple[IntArray, ...]
    setup: EyeSetup
    scale_std: float

    def __len__(self) -> int:
        return len(self.carrier[1])

    def carried_by(self, carrier: Poses) -> DepthRows:
        """The same with other poses of what carries the camera."""
        return replace(self, carrier=carrier)

    def _at(self, eye: Eye) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Of each term, where the camera has its points (n, 3), m, and how it is turned there."""
        for term, picture in zip(self.terms, self.picture, strict=True):
            R, p = some_poses(self.carrier, picture)
            in_carrier = (1.0 - eye.scale) * term.in_eye @ eye.rotation.T + eye.position
            yield np.einsum("nij,nj->ni", R, in_carrier) + p, R @ eye.rotation

    def places(self, eye: Eye) -> list[FloatArray]:
        """Of each term, where a camera has its points (n, 3), outside, m."""
        return [at for at, _ in self._at(eye)]

    def seen_by(self, eye: Eye) -> State:
        """The answer of a camera, with everything where most pictures have it."""
        marks = list[Marks]()
        for term, (at, _) in zip(self.terms, self._at(eye), strict=True):
            if isinstance(term, PlaneView):
                marks.append(PlaneMarks.of(term, at))
            elif isinstance(term, DepthPoints):
                marks.append((PointMarks if term.board is None else BoardMarks).of(term, at))
        return State(eye, tuple(marks), self.scale_std)

    def sums(self, state: State) -> PictureSums:
        """Of every picture."""
        eye, width = state.eye, state.unknowns
        parts = list[tuple[IntArray, FloatArray]]()
        apart = np.zeros((len(self), 4))
        first = SHARED
        for marks, picture, (at, turn) in zip(
            state.marks, self.picture, self._at(eye), strict=True
        ):
            found = marks.numbers(at, turn)
            R, p = some_poses(self.carrier, picture)
            n, size = found.off.shape
            lever = at - p if self.setup == EYE_IN_HAND else at
            table = np.zeros((n, size, OF_HAND + width + 1))
            table[..., :3] = found.by_place
            table[..., 3:6] = np.cross(lever[:, None], found.by_place)
            unknowns = table[..., OF_HAND : OF_HAND + width]
            in_eye = (1.0 - eye.scale) * marks.term.in_eye
            unknowns[..., :3] = -found.by_place @ turn @ skew(in_eye)
            unknowns[..., 3:6] = found.by_place @ R
            along = np.einsum("nij,nj->ni", turn, marks.term.in_eye)
            unknowns[..., SCALE] = -np.einsum("nki,ni->nk", found.by_place, along)
            rows = np.arange(n)[:, None, None]
            spots = np.arange(size)[None, :, None]
            unknowns[rows, spots, first + found.columns[:, None, :]] = found.by_mark
            table[..., -1] = found.off
            parts.append((np.repeat(picture, size), table.reshape(n * size, -1)))
            np.add.at(apart, picture, np.column_stack([found.apart, np.ones(n)]))
            first += marks.unknowns
        return _sums(parts, len(self), width, apart)


def _sums(
    parts: Sequence[tuple[IntArray, FloatArray]], count: int, width: int, apart: FloatArray
) -> PictureSums:
    picture = np.concatenate([numbers for numbers, _ in parts])
    order = np.argsort(picture, kind="stable")
    table = np.concatenate([rows for _, rows in parts])[order]
    counts = np.bincount(picture, minlength=count)
    square = np.array([rows.T @ rows for rows in np.split(table, np.cumsum(counts)[:-1])])
    hand, unknown = slice(OF_HAND), slice(OF_HAND, OF_HAND + width)
    return PictureSums(
        counts,
        square[:, -1, -1],
        square[:, hand, -1],
        square[:, hand, hand],
        square[:, hand, unknown],
        square[:, unknown, -1],
        square[:, unknown, unknown],
        apart[:, :3] / np.maximum(apart[:, 3:], 1.0),
    )


def seen_terms(
    poses: MeasuredPoses,
    planes: SeenPoints | None,
    points: SeenPoints | None,
    board: Board | None,
    setup: EyeSetup,
) -> tuple[DepthTerm, ...]:
    """What was seen, beside the poses of its pictures.

    Raises:
        SamplesError: points in another unit, or of pictures that no pose has.
    """
    kinds: list[tuple[type[DepthTerm], SeenPoints, dict[str, Any]]] = []
    if planes is not None:
        kinds.append((PlaneView, planes, {}))
    if points is not None:
        kinds.append((DepthPoints, points, {"board": board} if board else {}))
    terms = list[DepthTerm]()
    for kind, seen, settings in kinds:
        away = float(np.median(np.linalg.norm(seen.position, axis=1)))
        if not NEAR <= away <= FAR:
            unit = "mm: use columns x_mm, y_mm, z_mm" if away > FAR else "m: use columns x, y, z"
            raise SamplesError(
                f"{kind.mark}s about {away:.3g} m from the camera",
                "lengths in m",
                file=seen.path,
                hint=f"they look like {unit}",
            )
        own = with_seen(poses, seen, kind.mark)
        terms.append(kind.over(own, Setup(settings={"setup": setup, **settings})))
    return tuple(terms)
