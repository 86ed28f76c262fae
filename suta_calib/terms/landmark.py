"""Certified landmarks at an unknown pose of the artefact: the efficient use of an artefact."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Self

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.errors import SamplesError
from suta_calib.geometry import FloatArray, Symbol, register_points, symbolic_rotation_log
from suta_calib.measurements import Artefact, SampleColumns
from suta_calib.terms.pairwise_distance import check_landmarks
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.term import (
    Block,
    IntArray,
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
    return symbolic_rotation_log(seated.T @ pose_of(own).R.T @ poses[0].R)


class Landmark(Term):
    """``T_base_artefact⁻¹ p_i - l_i`` for every touched landmark; each placement's pose is unknown.

    Where the artefact gives the seated orientation, the tip's rotation is compared as well.

    Args:
        poses: samples with the labels placement, repeat and landmark.
        artefact: certified landmarks.
        noise: scatter and robustness of a position, m per axis.
        angular_noise: the same for the orientation, rad per axis.

    Raises:
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
    ) -> None:
        super().__init__(poses, noise, angular_noise)
        self.artefact = artefact
        self._certified = check_landmarks(poses, artefact)
        self._placements, self._placement = grouped(poses.samples.labels["placement"])
        self._seated = self._seated_rotations()
        self.own = tuple(
            p for name in self._placements for p in pose_parameters(f"placement[{name}]")
        )
        rows = np.arange(len(poses))
        self.blocks = (self._position_block(rows),)
        if len(self._oriented):
            self.blocks += (self._rotation_block(self._oriented),)

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> Landmark:
        """Build it from a row of a job file."""
        return cls(poses, setup.certified(cls.kind), setup.noise, setup.angular_noise)

    def over_poses(self, poses: PoseSource) -> Self:
        """The same over other poses."""
        return type(self)(poses, self.artefact, self.noise, self.angular_noise)

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
        return np.concatenate(values)

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

    def _own_rows(self, rows: IntArray) -> IntArray:
        return 6 * self._placement[rows, None] + np.arange(6)

    def _labels(self, rows: IntArray) -> tuple[str, ...]:
        return tuple(str(n) for n in self.poses.samples.labels["landmark"][rows])

    def _position_block(self, rows: IntArray) -> Block:
        names = self.poses.samples.labels["landmark"]
        sigma = np.array([self.artefact.landmarks[str(n)].sigma for n in names])
        own, labels = self._own_rows(rows), self._labels(rows)
        certified = self._certified
        return Block(
            "position", "m", 3, _position, rows[:, None], own, certified, self.noise, sigma, labels
        )

    def _rotation_block(self, rows: IntArray) -> Block:
        own, labels = self._own_rows(rows), self._labels(rows)
        # Column by column, as CasADi reshapes.
        data = np.swapaxes(self._seated[rows], 1, 2).reshape(len(rows), 9)
        known = np.zeros(len(rows))
        noise = self.angular_noise
        return Block(
            "rotation", "rad", 3, _rotation, rows[:, None], own, data, noise, known, labels
        )


def _mean_rotation(measured: FloatArray, seated: FloatArray) -> FloatArray:
    """Mean of the artefact rotations that each seated tip implies."""
    implied = measured @ np.swapaxes(seated, 1, 2)
    return np.asarray(Rotation.from_matrix(implied).mean().as_matrix(), dtype=float)
