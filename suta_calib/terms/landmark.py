"""Certified landmarks at an unknown pose of the artefact: the efficient use of an artefact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import register_points, rotation_from_vector
from suta_calib.geometry.symbols import Symbol, symbolic_chordal_log
from suta_calib.measurements import Artefact, SampleColumns
from suta_calib.terms.certified import certified_rows
from suta_calib.terms.pairwise_distance import check_landmarks
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.resimulation import Resimulation, pose_named
from suta_calib.terms.seating import Seating, flat, seat_axes, seated_at, turned_about_z
from suta_calib.terms.term import (
    Block,
    Noise,
    Pose,
    Setup,
    Term,
    grouped,
    pose_of,
    pose_parameters,
    pose_values,
)


def _position(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    """In the artefact's frame, which turns with the arm: the base gauge stays unobservable."""
    return pose_of(own).inverse_act(poses[0].p) - data


def _rotation(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    seated = ca.reshape(data, 3, 3)
    return symbolic_chordal_log(seated.T @ pose_of(own).R.T @ poses[0].R)


def _position_shifted(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    """The same where the tip sits off the landmark's axis."""
    seat = data[0:3] + ca.reshape(data[3:9], 3, 2) @ own[6:8]
    return pose_of(own).inverse_act(poses[0].p) - seat


def _rotation_turned(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    """The same where the tip is turned in its seat."""
    seated = ca.reshape(data, 3, 3) @ turned_about_z(own[6])
    return symbolic_chordal_log(seated.T @ pose_of(own).R.T @ poses[0].R)


class TouchedLandmark(Term):
    """``T_base_artefact⁻¹ p_i - l_i`` for every touched landmark; each placement's pose is unknown.

    Where the artefact gives the seated orientation, the tip's rotation is compared as well.

    Args:
        poses: samples with the labels placement, repeat and landmark.
        artefact: certified landmarks.
        noise: scatter and robustness of a position, m per axis.
        angular_noise: the same for the orientation, rad per axis.
        seating: what the sockets leave open; the tip fits them exactly by default.
        label: tells the seating in several artefacts apart.

    Raises:
        ArtefactError: a landmark without orientation where there is a seating.
        SamplesError: a landmark is not certified.
    """

    kind: ClassVar[str] = "landmark"
    columns: ClassVar[SampleColumns] = SampleColumns(labels=("placement", "repeat", "landmark"))

    def __init__(
        self,
        poses: PoseSource,
        artefact: Artefact,
        noise: Noise = Noise(),
        angular_noise: Noise = Noise(),
        seating: Seating | None = None,
        label: str = "default",
    ) -> None:
        super().__init__(poses, noise, angular_noise)
        self.artefact, self.seating, self.label = artefact, seating, label
        self._certified = check_landmarks(poses, artefact)
        self._placements, self._placement = grouped(poses.samples.labels["placement"])
        self._seated = self._seated_rotations()
        self.own = tuple(
            p for name in self._placements for p in pose_parameters(f"placement[{name}]")
        )
        if seating is not None:
            self._axes = seat_axes(artefact, poses.samples.labels["landmark"])
            self.own += seating.parameters(label)
        rows = np.arange(len(poses))
        self.blocks = (self._position_block(rows),)
        if len(self._oriented):
            self.blocks += (self._rotation_block(self._oriented),)

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> TouchedLandmark:
        """Build it from a row of a job file."""
        certified = setup.certified(cls.kind)
        return cls(poses, certified, setup.noise, setup.angular_noise, setup.seating, setup.label)

    def over_poses(self, poses: PoseSource) -> Self:
        """The same over other poses."""
        given = (self.artefact, self.noise, self.angular_noise, self.seating, self.label)
        return type(self)(poses, *given)

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """Every landmark where its placement's pose has it.

        Seats get the orientation that they would have had, rather than the arm readings that give
        both: an arm of few joints cannot reach any orientation.
        """
        shift, turn = seated_at(self.own, values)
        marks = self._certified if self.seating is None else self._certified + self._axes @ shift
        frames = [pose_named(values, f"placement[{name}]") for name in self._placements]
        R, p = (np.array(c)[self._placement] for c in zip(*frames, strict=True))
        target = np.einsum("nij,nj->ni", R, marks) + p
        found = self.over_poses(again.touched(self.poses, target, noise[0]))
        if len(self._oriented):
            rows, (rotation, _) = self._oriented, found.poses.at(values)
            seated = again.turned(np.swapaxes(R[rows], 1, 2) @ rotation[rows], noise[1])
            unturned = seated @ rotation_from_vector([0.0, 0.0, -turn])
            found.blocks = (found.blocks[0], replace(found.blocks[1], data=flat(unturned)))
        return found

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Arun's registration of each placement; by orientation where the landmarks are in line."""
        values = []
        for k in range(len(self._placements)):
            rows = np.flatnonzero(self._placement == k)
            r, p = register_points(self._certified[rows], position[rows])
            seated = [i for i in rows if i in self._oriented_set]
            if len(seated) and not self._spans_plane(rows):
                r = _mean_rotation(rotation[seated], self._seated[seated])
                p = (position[rows] - self._certified[rows] @ r.T).mean(axis=0)
            values.append(pose_values(r, p))
        seating = len(self.own) - 6 * len(self._placements)
        return np.concatenate([*values, np.zeros(seating)])

    def _spans_plane(self, rows: IntArray) -> bool:
        centred = self._certified[rows] - self._certified[rows].mean(axis=0)
        singular = np.linalg.svd(centred, compute_uv=False)
        return len(singular) > 1 and bool(singular[1] > 1e-3 * singular[0])

    def _seated_rotations(self) -> FloatArray:
        marks = [self.artefact.landmarks[str(n)] for n in self.poses.samples.labels["landmark"]]
        has = np.array([m.rotation is not None for m in marks], dtype=bool)
        self._oriented: IntArray = np.flatnonzero(has)
        self._oriented_set = frozenset(self._oriented.tolist())
        return np.array([np.eye(3) if m.rotation is None else m.rotation for m in marks])

    @property
    def subject(self) -> str:
        """The artefact: two artefacts cannot stand at one placement."""
        return f"artefact '{self.artefact.name}'"

    def check_enough(self) -> None:
        """Two different landmarks at every placement, or one with its orientation."""
        names = self.poses.samples.labels["landmark"]
        for k, placement in enumerate(self._placements):
            touched = {str(n) for n in names[self._placement == k]}
            if len(touched) < 2 and not len(self._oriented):
                raise SamplesError(
                    f"only landmark {', '.join(touched)} at placement {placement}",
                    "at least two different landmarks at every placement",
                    where=self.kind,
                    hint="its pose is six unknowns; use fixed_point for one point touched often",
                )

    def _own_rows(self, rows: IntArray, keys: str = "") -> IntArray:
        """The placement's pose, and those of the seating's unknowns whose names end so."""
        seats = range(6 * len(self._placements), len(self.own))
        more = [k for k in seats if self.own[k].name.endswith(tuple(keys.split()) or ("?",))]
        pose = 6 * self._placement[rows, None] + np.arange(6)
        return np.hstack([pose, np.tile(np.array(more, dtype=np.intp), (len(rows), 1))])

    def _labels(self, rows: IntArray) -> tuple[str, ...]:
        return tuple(str(n) for n in self.poses.samples.labels["landmark"][rows])

    def _position_block(self, rows: IntArray) -> Block:
        names = self.poses.samples.labels["landmark"]
        sigma = np.array([self.artefact.landmarks[str(n)].sigma for n in names])
        labels, residual, data = self._labels(rows), _position, self._certified
        own = self._own_rows(rows, ".x .y")
        if own.shape[1] > 6:
            residual, data = _position_shifted, np.hstack([data, flat(self._axes)])
        by_mark = np.tile(-np.eye(3)[:, None, :], (len(rows), 1, 1, 1))
        return Block(
            "position",
            "m",
            3,
            residual,
            rows[:, None],
            own,
            data,
            self.noise,
            sigma,
            labels,
            certified_rows(self.artefact, names[rows, None], by_mark),
        )

    def _rotation_block(self, rows: IntArray) -> Block:
        own, labels = self._own_rows(rows, ".rz"), self._labels(rows)
        residual = _rotation_turned if own.shape[1] > 6 else _rotation
        data = flat(self._seated[rows])
        known = np.zeros(len(rows))
        noise = self.angular_noise
        return Block("rotation", "rad", 3, residual, rows[:, None], own, data, noise, known, labels)


def _mean_rotation(measured: FloatArray, seated: FloatArray) -> FloatArray:
    """Mean of the artefact rotations that each seated tip implies."""
    implied = measured @ np.swapaxes(seated, 1, 2)
    return np.asarray(Rotation.from_matrix(implied).mean().as_matrix(), dtype=float)
