"""Certified landmarks at an unknown pose of the artefact: the efficient use of an artefact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Final, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError, did_you_mean
from suta_calib.geometry.numbers import nearest_rotation, rms_length, rotation_from_vector
from suta_calib.geometry.symbols import Symbol, symbolic_chordal_log, symbolic_rotation
from suta_calib.measurements import Artefact, SampleColumns
from suta_calib.model.parameters import Parameter
from suta_calib.terms.block import (
    LEARNT,
    Block,
    Certified,
    Noise,
    Pose,
    flat,
    grouped,
    pose_of,
    summed,
)
from suta_calib.terms.checks import check_unit
from suta_calib.terms.external_frame import pose_named, pose_parameters, pose_values
from suta_calib.terms.length_scale import stretch_factors, stretch_parameters, stretched_point
from suta_calib.terms.observed import Observed, Resimulation
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.terms.seating import Seating, seat_axes, seated_at
from suta_calib.terms.term import Term

ARTEFACT_COLUMNS: Final = SampleColumns(
    labels=("placement", "repeat", "landmark"),
    about={
        "placement": "Label of the place where the artefact stood.",
        "repeat": "Number of the pass over the artefact at that place.",
        "landmark": "Which landmark of the artefact was touched.",
    },
)
# What touches of an artefact are grouped by; a set is a placement gone through once.
ARTEFACT_GROUPINGS: Final = {
    "landmark": ("landmark",),
    "placement": ("placement",),
    "set": ("placement", "repeat"),
}


def _position(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """In the artefact's frame, which turns with the arm: the base gauge stays unobservable."""
    seat = data[0:3]
    if unknowns.numel() > 6:  # The tip sits off the landmark's axis.
        seat = seat + ca.reshape(data[3:9], 3, 2) @ unknowns[6:8]
    return pose_of(unknowns).inverse_act(poses[0].p) - seat


def _position_stretched(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """The same on an artefact whose stretch is unknown: the last two of the own unknowns."""
    made = stretched_point(data[0:3], unknowns[-2:])
    return _position(poses, unknowns[:-2], ca.vertcat(made, data[3:]))


def _rotation(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    seat = ca.reshape(data, 3, 3)
    if unknowns.numel() > 6:  # The tip is turned in its seat.
        seat = seat @ symbolic_rotation(ca.vertcat(0, 0, unknowns[6]))
    return symbolic_chordal_log(seat.T @ pose_of(unknowns).R.T @ poses[0].R)


@dataclass(frozen=True, eq=False, repr=False)
class TouchedLandmark(Term):
    """``T_base_artefact⁻¹ p_i - l_i`` for every touched landmark; each placement's pose is unknown.

    Where the artefact gives the seated orientation, the tip's rotation is compared as well.

    Attributes:
        poses: samples with the labels placement, repeat and landmark.
        artefact: certified landmarks.
        noise: scatter and robustness of a position, m per axis.
        angular_noise: the same for the orientation, rad per axis.
        seating: what the sockets leave open; the tip fits them exactly by default.
        label: tells the seating in several artefacts apart.
        seats: (n, 3, 3) the tip's orientation in the artefact at every touch; as certified by
            default. Those without a certified orientation are not looked at.

    Raises:
        ArtefactError: a landmark without orientation where there is a seating.
        SamplesError: a landmark is not certified.
    """

    kind = "landmark"
    order = 2
    about = (
        "touched landmarks of an artefact; the pose of each placement is unknown and estimated too"
    )
    columns = ARTEFACT_COLUMNS
    needs_artefact = True
    place = "placement"
    place_unknown = "placement"
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = ARTEFACT_GROUPINGS

    artefact: Artefact
    noise: Noise = LEARNT
    angular_noise: Noise = LEARNT
    seating: Seating | None = None
    label: str = "default"
    seats: FloatArray | None = None

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The pose of every placement, then the seating, then the artefact's stretch."""
        names, _ = self.places
        poses = (p for name in names for p in pose_parameters(f"placement[{name}]"))
        seating = () if self.seating is None else self.seating.parameters(self.label)
        artefact = self.artefact
        return (*poses, *seating, *stretch_parameters(artefact.name, artefact.stretch))

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Positions, and rotations where the artefact gives the seats'."""
        certified, marks, oriented = self._certified, self._marks, self._oriented
        rows = np.arange(len(marks))
        data, own_columns = certified, self._own_rows(rows, (".x", ".y"))
        if self.seating is not None:
            axes = seat_axes(self.artefact, marks)
            data = np.hstack([certified, flat(axes)]) if own_columns.shape[1] > 6 else certified
        by_mark = np.tile(-np.eye(3)[:, None, :], (len(rows), 1, 1, 1))
        touched = Certified.of(self.artefact, marks, rows[:, None], by_mark)
        residual = _position if self.artefact.stretch is None else _position_stretched
        position = Block.per_sample(
            "position", "m", 3, residual, own_columns, data, self.noise, marks
        )
        sigma = touched.sigma[touched.marks[:, 0]]
        position = replace(position, known_sigma=sigma, certified=touched)
        if not len(oriented):
            return (position,)
        own_columns, data = self._own_rows(oriented, (".rz",)), flat(self._seats[oriented])
        noise, labels = self.angular_noise, marks[oriented]
        rotation = Block.per_sample(
            "rotation", "rad", 3, _rotation, own_columns, data, noise, labels
        )
        return position, replace(rotation, samples=oriented[:, None])

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """Every landmark where its placement's pose has it, the tip as it sits there."""
        labels = poses.samples.labels
        names, placement = grouped(labels["placement"])
        frames = [pose_named(values, f"placement[{name}]") for name in names]
        R, p = (np.array(c)[placement] for c in zip(*frames, strict=True))
        artefact = self.artefact.stretched(stretch_factors(self.own_parameters, values))
        return seated(artefact, labels["landmark"], R, p, *seated_at(self.own_parameters, values))

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """Every landmark where its placement's pose has it.

        Seats get the orientation that they would have had, rather than the arm readings that give
        both: an arm of few joints cannot reach any orientation.
        """
        simulated = super().resimulated(values, noise, again)
        if not len(self._oriented):
            return simulated
        rows, (names, placement) = self._oriented, self.places
        R = np.array([pose_named(values, f"placement[{name}]")[0] for name in names])[placement]
        rotation, _ = simulated.poses.at(values)
        seats = again.turned(np.swapaxes(R[rows], 1, 2) @ rotation[rows], noise[1])
        _, turn = seated_at(self.own_parameters, values)
        every = np.tile(np.eye(3), (len(placement), 1, 1))
        every[rows] = seats @ rotation_from_vector([0.0, 0.0, -turn])
        return replace(simulated, seats=every)

    def take(self, rows: ArrayLike) -> Self:
        """The term over some of its samples."""
        seats = None if self.seats is None else self.seats[np.asarray(rows)]
        return replace(self, poses=self.poses.take(rows), seats=seats)

    @property
    def touched(self) -> Artefact:
        """The artefact whose landmarks are touched."""
        return self.artefact

    def single_touches(self) -> TouchedLandmark:
        """The positions alone."""
        return TouchedLandmark(self.poses, positions_only(self.artefact))

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Arun's registration of each placement; by orientation where the landmarks are in line."""
        certified, (names, placement) = self._certified, self.places
        R, p = registered(certified, position, placement, len(names))
        for k in np.unique(placement[self._oriented]):
            rows, seats = np.flatnonzero(placement == k), self._oriented
            seats = seats[placement[seats] == k]
            centred = certified[rows] - certified[rows].mean(axis=0)
            singular = np.linalg.svd(centred, compute_uv=False)
            if len(singular) < 2 or singular[1] <= 1e-3 * singular[0]:
                implied = rotation[seats] @ np.swapaxes(self._seats[seats], 1, 2)
                R[k] = np.asarray(Rotation.from_matrix(implied).mean().as_matrix(), dtype=float)
                p[k] = (position[rows] - certified[rows] @ R[k].T).mean(axis=0)
        seating = len(self.own_parameters) - 6 * len(names)
        return np.concatenate([pose_values(R, p).reshape(-1), np.zeros(seating)])

    @property
    def subject(self) -> str:
        """The artefact: two artefacts cannot stand at one placement."""
        return f"artefact '{self.artefact.name}'"

    def check_enough(self) -> None:
        """Two different landmarks at every placement, or one with its orientation; in mm."""
        marks, (names, placement) = self._marks, self.places
        mark = grouped(marks)[1]
        several = np.zeros(len(names), dtype=np.bool_)
        first = np.unique(placement, return_index=True)[1]
        several[placement[mark != mark[first][placement]]] = True
        if not np.all(several) and not len(self._oriented):
            k = int(np.argmin(several))
            raise self.refuse(
                f"only landmark {marks[first[k]]} at placement {names[k]}",
                "at least two different landmarks at every placement",
                hint="the pose of a placement has six unknowns; use fixed_point for one point "
                "touched often",
            )
        check_artefact_unit(self, self._certified, placement)

    @property
    def _marks(self) -> NDArray[np.str_]:
        return self.poses.samples.labels["landmark"]

    @cached_property
    def _certified(self) -> FloatArray:
        return certified_positions(self.poses, self.artefact)

    @cached_property
    def _oriented(self) -> IntArray:
        """Samples whose landmark has a certified orientation."""
        marks = self.artefact.landmarks
        has = [marks[str(n)].rotation is not None for n in self._marks]
        return np.flatnonzero(np.array(has, dtype=bool))

    @cached_property
    def _seats(self) -> FloatArray:
        return seat_rotations(self.artefact, self._marks) if self.seats is None else self.seats

    def _own_rows(self, rows: IntArray, keys: tuple[str, ...]) -> IntArray:
        """The placement's pose, and those of the other unknowns whose names end so, in order."""
        names, placement = self.places
        seats = range(6 * len(names), len(self.own_parameters))
        more = [k for k in seats if self.own_parameters[k].name.endswith(keys)]
        pose = 6 * placement[rows, None] + np.arange(6)
        return np.hstack([pose, np.tile(np.array(more, dtype=np.intp), (len(rows), 1))])


def seated(
    artefact: Artefact,
    names: Sequence[str] | NDArray[np.str_],
    rotation: FloatArray,
    position: FloatArray,
    shift: ArrayLike = (0.0, 0.0),
    turn: float = 0.0,
) -> Observed:
    """Where the tip is that sits on landmarks: ``T_base_artefact T_artefact_seat``.

    The artefact stands at rotation (n, 3, 3) and position (n, 3), or one for all; the tip sits off
    the sockets' axes by ``shift`` (2,), m, and is turned about them by ``turn``, rad. Landmarks
    without a seat are taken to hold it upright in the artefact.
    """
    seats = seat_rotations(artefact, names)
    marks = artefact.position_of(names) + seats[:, :, :2] @ np.asarray(shift)
    turned = seats @ rotation_from_vector([0.0, 0.0, turn])
    return Observed(np.einsum("...ij,...j->...i", rotation, marks) + position, rotation @ turned)


def registered(
    source: FloatArray, target: FloatArray, group: IntArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """`geometry.register_points` for each of ``count`` groups (n,) of points (n, 3), none empty.

    Gives rotations (count, 3, 3) and positions (count, 3), m, of source in target.
    """
    number = np.bincount(group, minlength=count)[:, None]
    middles = [summed(points, group, count) / number for points in (source, target)]
    away, there = (points - at[group] for points, at in zip((source, target), middles, strict=True))
    products = (there[:, :, None] * away[:, None, :]).reshape(-1, 9)
    rotation = nearest_rotation(summed(products, group, count).reshape(-1, 3, 3))
    return rotation, middles[1] - np.einsum("nij,nj->ni", rotation, middles[0])


def seat_rotations(artefact: Artefact, names: Sequence[str] | NDArray[np.str_]) -> FloatArray:
    """(n, 3, 3) certified orientations of a seated tip, upright where none is given."""
    marks = [artefact.landmarks[str(name)].rotation for name in names]
    return np.array([np.eye(3) if seat is None else seat for seat in marks])


def check_artefact_unit(term: Term, certified: FloatArray, groups: IntArray) -> None:
    """Refuse an artefact of another size than the arm touched.

    Certified positions (n, 3) are of the touched landmarks, m; between touches of one group (n,)
    the artefact did not move.
    """
    if not isinstance(term.poses, ArmPoses):
        return
    count = np.bincount(groups)[:, None]

    def size(points: FloatArray) -> float:
        middle = summed(points, groups, len(count)) / np.maximum(count, 1)
        return rms_length(points - middle[groups])

    if (extent := size(certified)) > 0.0:  # else each landmark stands alone
        expected = "landmarks as far apart as the arm touched them"
        hint = "position_mm of the artefact is in mm: is the unit right, and the artefact?"
        check_unit(term, "landmarks", extent, size, expected, hint)


def certified_positions(poses: PoseSource, artefact: Artefact) -> FloatArray:
    """Certified position (n, 3) of the landmark each sample touched, m, in the artefact.

    Raises:
        SamplesError: a landmark that is not certified; names the sample.
    """
    samples = poses.samples
    touched = samples.labels["landmark"].tolist()
    for name in dict.fromkeys(touched):
        if name not in artefact.landmarks:
            raise SamplesError(
                f"landmark '{name}'",
                f"one of {', '.join(artefact.landmarks)}",
                where=samples.origin[touched.index(name)],
                hint=did_you_mean(name, artefact.landmarks)
                or f"add it to the artefact '{artefact.name}' or correct the samples",
            )
    return artefact.position_of(touched)


def positions_only(artefact: Artefact) -> Artefact:
    """The artefact without the orientations of its seats."""
    marks = {name: replace(mark, rotation=None) for name, mark in artefact.landmarks.items()}
    return replace(artefact, landmarks=marks)
