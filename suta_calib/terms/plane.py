"""Unknown planes, touched anywhere: a surface plate, a machined face, a wall."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import right_singular, rotation_from_vector, vector_turning_z_to
from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.measurements import SampleColumns
from suta_calib.measurements.fields import LENGTH, LENGTH_OR_0, Field
from suta_calib.terms.block import Block, Pose
from suta_calib.terms.external_frame import ExternalFrame, OutsidePose
from suta_calib.terms.given_pose import GivenPose, PriorValue
from suta_calib.terms.observed import Observed
from suta_calib.terms.places import PlaceTerm
from suta_calib.terms.poses import PoseSource


def signed_distance(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """Of the ball's surface to the plane ``nᵀ x = d``; turns and shifts of the base leave it alone.

    The arm is on the side that the tip comes from, against its z axis, whichever way n points: so
    one plane has two descriptions, and both give this distance, but for its sign.
    """
    normal = symbolic_rotation(ca.vertcat(unknowns[1], unknowns[2], 0))[:, 2]
    side = -ca.sign(ca.dot(normal, poses[0].R[:, 2]))
    return ca.dot(normal, poses[0].p) - unknowns[0] - side * data[0]


class PlaneFrame(ExternalFrame):
    """A frame on a plane."""

    def pose(self, values: Mapping[str, float]) -> OutsidePose:
        """At the distance z along the normal, which turns the base's z by (rx, ry, 0)."""
        z, rx, ry = (values[name] for name in self.names)
        rotation = rotation_from_vector([rx, ry, 0.0])
        return rotation, z * rotation[:, 2]


@dataclass(frozen=True, eq=False, repr=False)
class TouchedPlane(PlaceTerm):
    """``nᵀ p_i - d ∓ r`` for every touch of an unknown plane, with a ball of radius r at the tip.

    A plane has three unknowns: ``z``, its distance d from the base's origin along its normal, and
    ``rx``, ``ry``, the rotation vector (rx, ry, 0) that turns the base's z axis into the normal n.
    The start takes the normal that points up; a vertical plane is nothing special. A given pose is
    of any point of it, its z axis being square to it; prior_mm is of the distance from the origin.

    Planes that face several ways, each touched with the tool in several directions, find what a
    point touched from many directions does, and need nothing that a tip can rest in; the overall
    scale is free, unless another term fixes it, or one plane is touched with a ball on both sides.

    Attributes:
        poses: samples with the label plane; the tip is the ball's centre.
        radius: of the ball, m; 0 for a point. The centre is that far off, on the arm's side: the
            side from which the tip's z axis points to the plane.
    """

    kind = "plane"
    order = 4
    about = (
        "an unknown plane, touched anywhere and from several directions; with a ball at the tip, "
        "set probe_radius_mm: the tip is then the centre of the ball"
    )
    columns = SampleColumns(labels=("plane",), about={"plane": "Which plane was touched."})
    keys = (
        Field(
            "probe_radius_mm",
            LENGTH_OR_0,
            "Radius of the ball at the tip; 0 (a point) without it.",
            given_attribute="radius",
        ),
    )
    place = "plane"
    place_unknown = "plane"
    place_needs_turn = True
    place_keys = ("z", "rx", "ry")
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"plane": ("plane",), "row": ()}
    simulation_keys = (Field("size_mm", LENGTH, "Edge of the square that is touched."),)

    radius: float = 0.0

    def __post_init__(self) -> None:
        if not self.radius >= 0.0:
            radius, expected = f"{self.radius:g}", "a radius in m, 0 for a point"
            raise SamplesError(radius, expected, where=f"{self.kind}: radius")
        super().__post_init__()

    @classmethod
    def touches(
        cls,
        rotation: FloatArray,
        position: FloatArray,
        where: FloatArray,
        settings: Mapping[str, Any],
    ) -> FloatArray:
        """All over a square of 0.2 m, or ``size_mm``, about the position, across the z axis."""
        aside = (where - 0.5) * settings.get("size", 0.2)
        above = np.full(len(where), settings.get("radius", 0.0))
        return np.asarray(position + np.column_stack([aside, above]) @ rotation.T)

    @property
    def outside(self) -> tuple[ExternalFrame, ...]:
        """Every plane: the point of it nearest to the base's origin, z along its normal."""
        given = ("probe_radius_mm",) if self._nothing_checks_the_ball else ()
        return tuple(
            PlaneFrame(f"plane[{name}]", "plane", "base", self.place_keys, given)
            for name in self.places[0]
        )

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The signed distances."""
        radius = np.full((len(self.poses), 1), self.radius)
        return self._blocks("distance", 1, signed_distance, radius)

    @property
    def settings(self) -> Mapping[str, Any]:
        """The ball's radius."""
        return {"radius": self.radius}

    @property
    def _nothing_checks_the_ball(self) -> bool:
        """Whether planes that stand anywhere are each touched on one side.

        A ball of another size than is said then moves these, and nothing else.
        """
        if not self.radius or self.given:
            return False
        rotation, position = self.poses.at({})
        for _, rows, centred in self._centred(position):
            normal = right_singular(centred)[1][2]
            if np.ptp(np.sign(self._side(normal, rotation[rows]))):
                return False
        return True

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The tips as they are, shifted along the normal to where the ball touches."""
        planes = self._there(values, poses)
        turns = np.column_stack([planes[:, 1:], np.zeros(len(planes))])
        normal, distance = rotation_from_vector(turns)[:, :, 2], planes[:, 0]
        rotation, position = poses.at(values)
        height = np.sum(normal * position, axis=1) - distance - self._side(normal, rotation)
        return Observed(position - height[:, None] * normal)

    def _known_place(self, owner: str, pose: GivenPose) -> dict[str, PriorValue]:
        return pose.of_axis(owner, 2, ("z",))

    def _side(self, normal: FloatArray, rotation: FloatArray) -> FloatArray:
        """(n,) height of the ball's centre over the plane, m, for normals (n, 3) or one of them."""
        towards = np.sum(normal * rotation[:, :, 2], axis=1)
        return np.asarray(-np.sign(towards) * self.radius)

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """The plane of least squares through the touches, by singular value decomposition."""
        values = []
        for _, rows, centred in self._centred(position):
            normal = right_singular(centred)[1][2]
            normal = -normal if normal[2] < 0 else normal
            heights = position[rows] @ normal - self._side(normal, rotation[rows])
            values.append([heights.mean(), *vector_turning_z_to(normal)[:2]])
        return np.concatenate(values)

    def _centred(self, position: FloatArray) -> Iterator[tuple[str, IntArray, FloatArray]]:
        """Every plane, its rows, and their positions (k, 3) about their mean."""
        for name, rows in self._by_place():
            yield name, rows, position[rows] - position[rows].mean(axis=0)

    def check_enough(self) -> None:
        """Four touches of every plane at least, not on one line at nominal."""
        # Three touches lie on some plane whatever the arm is: the fourth is the first that tells.
        fewest = 4
        _, position = self.poses.at({})
        # Second over first singular value of touches that lie on a line.
        line = 1e-3
        for name, rows, centred in self._centred(position):
            if len(rows) < fewest:
                raise self.refuse(
                    f"plane {name} touched {len(rows)} times",
                    f"every plane touched at least {fewest} times: three touches make any plane",
                )
            singular = np.linalg.svd(centred, compute_uv=False)
            if singular[1] < line * singular[0]:
                raise self.refuse(
                    f"all touches of plane {name} on one line",
                    "touches all over the plane",
                    hint="touches on a line do not determine the turn of the plane about it",
                )
