"""Two tips that touch, or a tip that touches something on another link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, get_args

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.symbols import Symbol
from suta_calib.measurements import SampleColumns
from suta_calib.measurements.fields import LENGTH_OR_0, Field, choice
from suta_calib.model.kinematics import Segment
from suta_calib.model.parameters import POSITION, is_base
from suta_calib.terms.block import Block, Pose, norm
from suta_calib.terms.external_frame import ExternalFrame
from suta_calib.terms.given_pose import GivenPose, PriorValue
from suta_calib.terms.observed import Observed
from suta_calib.terms.places import PlaceTerm
from suta_calib.terms.plane import PlaneFrame, TouchedPlane, signed_distance
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.terms.range import MeasuredRange, anchor_of
from suta_calib.terms.term import Gap
from suta_calib.units import mm

Surface = Literal["sphere", "plane"]


def _spot(unknowns: Symbol) -> Symbol:
    """Where it is that is touched: the other tip itself, where nothing is unknown of it."""
    return unknowns[:3] if unknowns.numel() else ca.DM.zeros(3)


def _position(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """In the frame of the tip, as of a point that stands still."""
    del data
    return poses[0].inverse_act(_spot(unknowns))


def _gap(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    return norm(poses[0].p - _spot(unknowns)) - data[0]


@dataclass(frozen=True, eq=False, repr=False)
class Contact(PlaceTerm):
    """``‖p_i - c‖ - l`` for a tip that is the length l away from the tip of another chain.

    The chain goes from the other tip to this one (``base_chain``). Where l is 0, all of ``p_i - c``
    is compared. Without the column ``spot``, c = 0: the two tips touch, or a ball bar of the
    certified length l is between them. With it, c is unknown: a point, or the centre of a ball, on
    the other tip's link; with ``surface: plane`` a face of that link is touched.

    Such data tell nothing of what carries both chains, nor of where the whole robot stands. Where
    l is 0 they tell no scale: a robot that is larger by 1 %, with all that is on it, touches too.
    Where something on the other link is unknown, they do not tell where the other tip is in it.

    Attributes:
        poses: samples, perhaps with the label spot.
        distance: of the tip from what it touches, m: 0, or the radii of the balls.
        surface: what is touched where there are spots.
    """

    kind = "contact"
    order = 10
    about = (
        "two tips that touch each other, or that a bar of certified length joins (distance_mm): "
        "the chain goes from the other tip to this one (base_chain). With a column spot, a point, "
        "a ball or a plane of unknown place on the other tip's link is touched"
    )
    columns = SampleColumns(
        common_labels=("spot",),
        about={"spot": "Label of what was touched on the other link; without the column, its tip."},
    )
    keys = (
        Field(
            "distance_mm",
            LENGTH_OR_0,
            "Distance of the tip from the other tip, from the centre of the ball, or from the "
            "plane; 0 (they touch) without it.",
            given_attribute="distance",
        ),
        Field(
            "surface",
            choice(get_args(Surface)),
            "What a spot is: a sphere (a point where distance_mm is 0), or a plane.",
        ),
    )
    between_chains = True
    place = "spot"
    place_unknown = "spot"
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"spot": ("spot",), "row": ()}
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {
        "base": (
            "a contact between two links of the robot does not show where the other link, or the "
            "robot, stands",
            "measure one of the tips with an external instrument (tracked_point), or give the "
            "pose of what is touched",
        ),
    }

    distance: float = 0.0
    surface: Surface = "sphere"

    def __post_init__(self) -> None:
        where = self.kind
        if not self.distance >= 0.0:
            expected = "a distance in m, 0 for a touch"
            raise SamplesError(f"{self.distance:g}", expected, where=f"{where}: distance")
        if self.surface not in get_args(Surface):
            expected = " or ".join(get_args(Surface))
            raise SamplesError(repr(self.surface), expected, where=f"{where}: surface")
        if self.surface == "plane" and not self._spots:
            hint = "a column spot with the same label for all touches of one plane"
            raise self.refuse("a plane without a column spot", "the label of each plane", hint)
        super().__post_init__()

    @property
    def place_keys(self) -> tuple[str, ...]:  # type: ignore[override]
        """Of the unknowns of what is touched."""
        return TouchedPlane.place_keys if self.surface == "plane" else POSITION

    @property
    def _segments(self) -> tuple[Segment, ...]:
        return self.poses.arm.segments if isinstance(self.poses, ArmPoses) else ()

    @property
    def _spots(self) -> bool:
        return self.place in self.poses.samples.labels

    @cached_property
    def _as_plane(self) -> TouchedPlane:
        """The plane that it is, whose unknowns are these."""
        return self._plane_over(self.poses)

    def _plane_over(self, poses: PoseSource) -> TouchedPlane:
        samples = poses.samples
        labels = {**samples.labels, TouchedPlane.place: samples.labels[self.place]}
        return TouchedPlane(
            poses.with_samples(replace(samples, labels=labels)), self.noise, radius=self.distance
        )

    @property
    def outside(self) -> tuple[ExternalFrame, ...]:
        """What is touched, in the other tip's link."""
        if self.surface == "plane":
            keys = self.place_keys
            return tuple(PlaneFrame(f"spot[{n}]", "plane", "base", keys) for n in self.places[0])
        return super().outside

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The positions, or the distances."""
        size, residual = (1, _gap) if self.distance else (3, _position)
        if self.surface == "plane":
            size, residual = 1, signed_distance
        name = "position" if size == 3 else "distance"
        data = np.full((len(self.poses), 1), self.distance)
        return self._blocks(name, size, residual, data)

    @property
    def settings(self) -> Mapping[str, Any]:
        """The distance, and from what."""
        return {"distance": self.distance, "surface": self.surface}

    @classmethod
    def touches(
        cls,
        rotation: FloatArray,
        position: FloatArray,
        where: FloatArray,
        settings: Mapping[str, Any],
    ) -> FloatArray:
        """All over a square on the plane, or a cap of the ball."""
        distance = settings.get("distance", 0.0)
        if settings.get("surface") == "plane":
            return TouchedPlane.touches(rotation, position, where, {"radius": distance})
        lengths = {"lengths": (distance, distance)}
        return MeasuredRange.touches(rotation, position, where, lengths)

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The tips as they are, shifted to where they have the distance."""
        if self.surface == "plane":
            plane = self._plane_over(poses)
            owners = {p.name: p.name.replace("plane[", "spot[", 1) for p in plane.own_parameters}
            of_plane = {name: values[ours] for name, ours in owners.items()}
            return plane.observed({**values, **of_plane}, plane.poses)
        spot = self._there(values, poses) if self._spots else np.zeros((len(poses), 3))
        away = poses.at(values)[1] - spot
        length = np.maximum(np.linalg.norm(away, axis=1), 1e-12)
        return Observed(spot + away * (self.distance / length)[:, None])

    def _known_place(self, owner: str, pose: GivenPose) -> dict[str, PriorValue]:
        if self.surface != "plane":
            return pose.of_point(owner)
        if pose.rotation is None:
            expected = "rotation_rpy_deg beside position_mm"
            raise SamplesError(
                "a pose of a plane without an orientation", expected, where=f"{self.kind}: pose"
            )
        return pose.of_axis(owner, 2, ("z",))

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Planes by least squares, centres of balls by `anchor_of`, points as means."""
        if self.surface == "plane":
            return self._as_plane.start(rotation, position)
        starts = [np.zeros(0)]
        for _, rows in self._by_place():
            tips = position[rows]
            lengths = np.full(len(tips), self.distance)
            starts.append(anchor_of(tips, lengths)[0] if self.distance else tips.mean(axis=0))
        return np.concatenate(starts)

    def check_enough(self) -> None:
        """One number more than the place of a spot has unknowns; tips that can touch at all."""
        if self.surface == "plane":
            self._as_plane.check_enough()
            return
        fewest = 5 if self.distance else 2
        for name, rows in self._by_place():
            if len(rows) < fewest:
                raise self.refuse(
                    f"spot {name} touched {len(rows)} times",
                    f"every spot touched at least {fewest} times, because its place is unknown",
                    hint="is its label misspelt?",
                )
        if self._spots or any(is_base(s.owner) for s in self._segments):
            # Where the other robot stands may be anything yet.
            return
        # How far apart tips that touch can seem, m: no arm is built so badly, but the tip of a
        # hand is its wrist's or its palm's in many a URDF.
        far = 0.3
        excess = float(np.median(np.linalg.norm(self.poses.at({})[1], axis=1))) - self.distance
        if abs(excess) > far:
            raise self.refuse(
                f"tips that by the nominal arm are {mm(excess + self.distance):.4g} mm apart",
                f"{mm(self.distance):g} mm (distance_mm)",
                hint="is base_chain the chain of the tip that was touched, and is its tip in the "
                "URDF the point that touched?",
            )
