"""Unknown straight lines, touched anywhere along them: an edge, a taut wire, a guide rail."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.geometry.numbers import rotation_from_vector, vector_turning_z_to
from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.measurements import SampleColumns
from suta_calib.measurements.fields import LENGTH, Field
from suta_calib.terms.block import Block, Pose, norm
from suta_calib.terms.external_frame import ExternalFrame, OutsidePose
from suta_calib.terms.given_pose import GivenPose, PriorValue
from suta_calib.terms.observed import Observed
from suta_calib.terms.places import PlaceTerm
from suta_calib.terms.poses import PoseSource


def _offset(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """Off the line, along two directions square to it that turn with the tool.

    The data are the tool's axis, in the tool, that the first of them is square to: in the line's
    own frame, which has no turn about the line to follow the arm with, noise would seem to tell
    where the arm points.
    """
    frame = symbolic_rotation(ca.vertcat(unknowns[2], unknowns[3], 0))
    along = frame[:, 2]
    off = poses[0].p - frame[:, 0] * unknowns[0] - frame[:, 1] * unknowns[1]
    first = ca.cross(along, poses[0].R @ data)
    first = first / norm(first)
    return ca.vertcat(ca.dot(first, off), ca.dot(ca.cross(along, first), off))


class LineFrame(ExternalFrame):
    """A frame on a line."""

    def pose(self, values: Mapping[str, float]) -> OutsidePose:
        """At (x, y) of the plane square to it, which turns the base's z by (rx, ry, 0)."""
        x, y, rx, ry = (values[name] for name in self.names)
        rotation = rotation_from_vector([rx, ry, 0.0])
        return rotation, rotation[:, :2] @ [x, y]


@dataclass(frozen=True, eq=False, repr=False)
class TouchedLine(PlaceTerm):
    """Two offsets of every touch from an unknown straight line.

    A line has four unknowns: ``rx``, ``ry``, the rotation vector (rx, ry, 0) that turns the base's
    z axis along it, and ``x``, ``y``, where it meets the plane through the base's origin square to
    it, along the x and y axes that were turned likewise. The start takes the direction that points
    up; a horizontal line is nothing special. A given pose is of any point of it, its x axis going
    along it; prior_mm is of x and y.

    Lines find what a point touched from many directions does, and are easier to come by; the
    overall scale is free, unless another term fixes it.

    Attributes:
        poses: samples with the label line.
    """

    kind = "line"
    order = 5
    about = (
        "an unknown straight line (an edge, a taut wire), touched anywhere along it and from "
        "several directions"
    )
    columns = SampleColumns(labels=("line",), about={"line": "Which line was touched."})
    place = "line"
    place_unknown = "line"
    place_needs_turn = True
    place_keys = ("x", "y", "rx", "ry")
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"line": ("line",), "row": ()}
    simulation_keys = (Field("size_mm", LENGTH, "How much of the line is touched."),)

    @classmethod
    def touches(
        cls,
        rotation: FloatArray,
        position: FloatArray,
        where: FloatArray,
        settings: Mapping[str, Any],
    ) -> FloatArray:
        """All along the place's x axis, 0.2 m or ``size_mm``, about the position."""
        aside = (where[:, 0] - 0.5) * settings.get("size", 0.2)
        return np.asarray(position + aside[:, None] * rotation[:, 0])

    @property
    def outside(self) -> tuple[ExternalFrame, ...]:
        """Every line: the point of it nearest to the base's origin, z along it."""
        return tuple(
            LineFrame(f"line[{name}]", "line", "base", self.place_keys) for name in self.places[0]
        )

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The offsets."""
        return self._blocks("position", 2, _offset, self._square)

    @cached_property
    def _square(self) -> FloatArray:
        """(n, 3) the tool's axis, in the tool, that is most nearly square to the line touched."""
        rotation, position = self.poses.at({})
        along = np.empty((len(rotation), 3))
        for _, rows, _, direction in self._by_line(position):
            along[rows] = direction
        nearest = np.argmin(np.abs(np.einsum("nij,ni->nj", rotation, along)), axis=1)
        return np.asarray(np.eye(3)[nearest])

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The tips as they are, shifted square to the line onto it."""
        lines = self._there(values, poses)
        frame = rotation_from_vector(np.column_stack([lines[:, 2:], np.zeros(len(lines))]))
        _, position = poses.at(values)
        in_line = np.einsum("nji,nj->ni", frame, position)
        in_line[:, :2] = lines[:, :2]
        return Observed(np.einsum("nij,nj->ni", frame, in_line))

    def _known_place(self, owner: str, pose: GivenPose) -> dict[str, PriorValue]:
        return pose.of_axis(owner, 0, ("x", "y"))

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """The line of least squares through the touches, by singular value decomposition."""
        del rotation
        values = []
        for _, _, middle, along in self._by_line(position):
            turn = vector_turning_z_to(along)
            values.append([*(rotation_from_vector(turn).T @ middle)[:2], *turn[:2]])
        return np.concatenate(values)

    def _by_line(
        self, position: FloatArray
    ) -> Iterator[tuple[str, IntArray, FloatArray, FloatArray]]:
        """Every line, its rows, the middle (3,) of their touches, and its direction (3,)."""
        for name, rows in self._by_place():
            middle = position[rows].mean(axis=0)
            along = np.linalg.svd(position[rows] - middle, full_matrices=False)[2][0]
            yield name, rows, middle, -along if along[2] < 0 else along

    def check_enough(self) -> None:
        """Three touches of every line at least, not all at one point at nominal."""
        # Two touches lie on some line whatever the arm is: the third is the first that tells.
        fewest = 3
        _, position = self.poses.at({})
        # Touches closer together than that, rms about their middle, are one point and no line, m.
        shortest = 1e-3
        for name, rows, middle, _ in self._by_line(position):
            if len(rows) < fewest:
                raise self.refuse(
                    f"line {name} touched {len(rows)} times",
                    f"every line touched at least {fewest} times: two touches make any line",
                )
            if np.abs(position[rows] - middle).max() < shortest:
                raise self.refuse(
                    f"all touches of line {name} at one point",
                    "touches all along the line",
                    hint="touches at one point do not determine the direction of the line",
                )
