"""A kind of observation: an inclinometer that sits somewhere on the tip's link."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from suta_calib import Noise, Parameter, Term
from suta_calib.geometry.numbers import rotation_from_vector, vector_from_rotation
from suta_calib.geometry.symbols import symbolic_rotation
from suta_calib.measurements import NumberColumn, SampleColumns
from suta_calib.terms import Block, Observed, PoseSource, Setup
from suta_calib.terms.block import Pose


def _across(poses: Sequence[Pose], own: Any, data: Any) -> Any:
    """The two components of "up", in the sensor's frame, across the direction it measured."""
    up = symbolic_rotation(ca.vertcat(own[3], own[4], 0))[:, 2]
    seen = symbolic_rotation(own[:3]).T @ poses[0].R.T @ up
    return ca.reshape(data, 3, 2).T @ seen


@dataclass(frozen=True, eq=False, repr=False)
class Inclinometer(Term):
    """Roll and pitch against gravity: a = Sᵀ Rᵀ u, roll = atan2(a_y, a_z), pitch = asin(-a_x).

    R is the orientation of the tip in the base. The mount S of the sensor on the tip's link and
    the direction u of "up" in the base are unknown.
    """

    kind: ClassVar[str] = "inclinometer"
    about: ClassVar[str] = "an inclinometer on the tip's link: roll and pitch against gravity"
    columns: ClassVar[SampleColumns] = SampleColumns(
        numbers=(NumberColumn("roll", "rad"), NumberColumn("pitch", "rad")),
        about={"roll": "Turn about its x axis.", "pitch": "Turn about its y axis."},
    )
    medium: ClassVar[str] = "instrument"
    unit: ClassVar[str] = "deg"

    noise: Noise = Noise()

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> "Inclinometer":
        """Build it from a row of a job file."""
        return cls(poses, setup.angular_noise)

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The sensor's mount in the tip, and "up" in the base, as rotation vectors."""
        names = [("sensor", "rx"), ("sensor", "ry"), ("sensor", "rz"), ("up", "rx"), ("up", "ry")]
        return tuple(Parameter(owner, key, "rad", plausible=1.0) for owner, key in names)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Two angles for each row."""
        numbers = self.poses.samples.numbers
        _, *across = _directions(numbers["roll"], numbers["pitch"])
        own = np.tile(np.arange(5), (len(self.poses), 1))
        labels = self.poses.samples.origin
        data = np.hstack(across)
        return (Block.per_sample("tilt", "rad", 2, _across, own, data, self.noise, labels),)

    def start(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        """By `mount_and_up`."""
        numbers = self.poses.samples.numbers
        return mount_and_up(rotation, _directions(numbers["roll"], numbers["pitch"])[0])

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The readings of an ideal sensor."""
        own = np.array([values[p.name] for p in self.own_parameters])
        up = rotation_from_vector(np.array([own[3], own[4], 0.0]))[:, 2]
        x, y, z = (poses.at(values)[0] @ rotation_from_vector(own[:3])).transpose(2, 0, 1) @ up
        return Observed(numbers={"roll": np.arctan2(y, z), "pitch": np.arcsin(-x)})


def mount_and_up(rotation: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """S and u of R_i S a_i = u for all rows i: linear in both, by singular values."""
    by_mount = np.einsum("nij,nk->nijk", rotation, seen).reshape(-1, 9)
    rows = np.hstack([by_mount, -np.tile(np.eye(3), (len(seen), 1))])
    found = np.linalg.svd(rows)[2][-1][:9].reshape(3, 3)
    U, _, Vt = np.linalg.svd(found * np.sign(np.linalg.det(found) or 1.0))
    mount = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    up = np.mean(rotation @ mount @ seen[:, :, None], axis=0)[:, 0]
    return np.concatenate([vector_from_rotation(mount), _tilt(up)])


def _directions(roll: np.ndarray, pitch: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors (n, 3): "up" in the sensor, and two across it along pitch and roll."""
    s, c, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    rows = (-sp, s * cp, c * cp), (-cp, -s * sp, -c * sp), (0 * s, c, -s)
    up, by_pitch, by_roll = (np.column_stack(row) for row in rows)
    return up, by_pitch, by_roll


def _tilt(up: np.ndarray) -> np.ndarray:
    """The rotation vector (rx, ry) that turns z to a direction (3,)."""
    lean = np.arctan2(np.hypot(up[0], up[1]), up[2])
    return lean * np.array([-up[1], up[0]]) / max(np.hypot(up[0], up[1]), 1e-12)
