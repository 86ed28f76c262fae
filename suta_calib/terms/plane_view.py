"""A depth camera or a 3-D scanner sees planes: a table, a wall, a plate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import ClassVar, Final

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Level
from suta_calib.geometry.numbers import right_singular, rotation_from_vector, vector_turning_z_to
from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.model.parameters import Parameter
from suta_calib.terms.block import Block, Pose, Residual, grouped, numbered, pose_of
from suta_calib.terms.depth_term import NOISE_KEY, DepthTerm, depth_columns, file_key
from suta_calib.terms.external_frame import (
    ExternalFrame,
    pose_named,
    pose_parameters,
    pose_values,
)
from suta_calib.terms.eye import point_outside
from suta_calib.terms.eye_term import setup_key
from suta_calib.terms.given_pose import GivenPose, PriorValue
from suta_calib.terms.hand_eye_start import EyeSetup, Poses, after, as_eye_in_hand
from suta_calib.terms.observed import Observed
from suta_calib.terms.plane import PlaneFrame
from suta_calib.terms.plane_start import EyeAndPlanes, eye_and_planes, open_motions
from suta_calib.terms.poses import PoseSource

# Unknowns of a plane: those of `TouchedPlane`.
_KEYS: Final = ("z", "rx", "ry")
# Part of a motion from which on it is worth a word.
_SHARE: Final = 0.2


@cache  # What was compiled for a residual is found again by it.
def _height(setup: EyeSetup) -> Residual:
    """Height of a point over its plane, over how well it is known."""

    def residual(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
        point = point_outside(poses[0], pose_of(unknowns[0:6]), data[0:3], setup)
        normal = symbolic_rotation(ca.vertcat(unknowns[7], unknowns[8], 0))[:, 2]
        return (ca.dot(normal, point) - unknowns[6]) / data[3]

    return residual


@dataclass(frozen=True, eq=False, repr=False)
class PlaneView(DepthTerm):
    """``n_kᵀ T_base_hand,i X z - d_k`` for every point z on plane k that was seen at row i.

    X = ``T_hand_eye`` is unknown, and so are the planes, each with the three unknowns of
    `TouchedPlane`. With the camera beside the arm X = ``T_base_eye``, and the planes are on the
    hand.

    A plane that is fitted to a cloud is three points whose heights err independently
    (`CloudPlane.marks`); points that somebody chose on it will do as well. The residual is over the
    standard deviation along the ray, by the distance or as the rows state it.
    """

    kind = "plane_view"
    order = 14
    about = (
        "a depth camera or a 3-D scanner on the tip saw planes that stand anywhere (a table, a "
        "wall, a plate): three points or more on each, at x, y, z in its frame (m), as suta-calib "
        "planes finds them in clouds. With setup: eye-to-hand the camera is beside the arm, and "
        "the planes are on the tip. The poses of camera and planes are estimated too"
    )
    columns = depth_columns("plane", "Name of the plane that the point is on.")
    mark = "plane"
    once = False
    keys = (file_key("plane"), setup_key("planes"), NOISE_KEY)
    measured_keys = ("planes",)
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "plane": ("plane",),
        "image": ("image",),
        "row": (),
    }

    @property
    def outside(self) -> tuple[ExternalFrame, ...]:
        """The camera, and the planes."""
        planes = (PlaneFrame(o, "plane", self.ends[1], _KEYS) for o in self.mark_owners)
        return self.eye_outside, *planes

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The pose of the camera, then the planes."""
        (eye,) = self.frame_names
        planes = (p for o in self.mark_owners for p in pose_parameters(o) if p.key in _KEYS)
        return (*pose_parameters(eye), *planes)

    def prior_from_pose(self, label: str, pose: GivenPose) -> dict[str, PriorValue]:
        """As of any frame; of a plane any point of it, and its normal along z."""
        if label not in self.seen[0] or not label:
            return super().prior_from_pose(label, pose)
        if pose.rotation is None:
            expected = "rotation_rpy_deg beside position_mm: z along its normal"
            raise self.refuse(f"a pose of plane {label} without an orientation", expected)
        return pose.of_axis(f"{self.mark}[{label}]", 2, ("z",))

    # ── what was seen ─────────────────────────────────────────────────────────────────────────
    @cached_property
    def _sights(self) -> IntArray:
        """(n,) one number, from 0, for all points of one plane in one picture."""
        return numbered(self.picture * len(self.seen[0]) + self.seen[1])[1]

    @property
    def sigmas(self) -> FloatArray:
        """(n, 1) standard deviations of the heights, m: those along the rays.

        Along the normal they are less, by the cosine of a tilt that some rows do not tell.
        """
        axes, sigma = self.scatter
        along = np.einsum("nij,ni->nj", axes, _rays(self.in_eye, len(sigma)))
        return np.asarray(np.linalg.norm(along * sigma, axis=1, keepdims=True))

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Heights of the points over their planes."""
        n = len(self.poses)
        planes = 6 + len(_KEYS) * self.seen[1][:, None] + np.arange(len(_KEYS))
        own_columns = np.hstack([np.tile(np.arange(6), (n, 1)), planes])
        measured = np.hstack([self.in_eye, self.relative])
        block = Block.per_sample(
            *("distance", "m", 1, _height(self.setup), own_columns, measured, self.noise),
            self.poses.samples.origin,
        )
        return (self.by_distance(block),)

    def readings(self, block: Block) -> IntArray:
        """The same point of a plane that is seen again at the same rest is the same reading."""
        del block
        order = np.argsort(self._sights, kind="stable")
        begins = np.flatnonzero(np.diff(self._sights[order], prepend=-1))
        place = np.arange(len(order)) - np.repeat(begins, np.diff([*begins, len(order)]))
        number = np.empty_like(order)
        number[order] = place
        return np.column_stack([self.poses.rests, self.seen[1], number])

    def equations(self) -> int:
        """A plane has three numbers, however many points of it are seen at a rest."""
        rest_and_plane = np.column_stack([self.poses.rests, self.seen[1]])
        return min(super().equations(), 3 * len(np.unique(rest_and_plane, axis=0)))

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """Where rays of the camera meet the planes: those of what was seen, or all about."""
        ray = _rays(poses.samples.position, len(poses))
        labels = poses.samples.labels.get(self.mark)
        names, which = ([""], np.zeros(len(poses), np.intp)) if labels is None else grouped(labels)
        owners = [f"{self.mark}[{name}]" if name else self.mark for name in names]
        unknowns = np.array([[values[f"{o}.{key}"] for key in _KEYS] for o in owners])[which]
        turns = np.column_stack([unknowns[:, 1:], np.zeros(len(poses))])
        normal = rotation_from_vector(turns)[:, :, 2]
        (R, p), (rotation, position) = (
            pose_named(values, self.frame_names[0]),
            as_eye_in_hand(poses.at(values), self.setup),
        )
        # The plane in the eye: its normal, and its distance along that.
        by_carrier = np.einsum("nji,nj->ni", rotation, normal)
        away = unknowns[:, 0] - np.einsum("ni,ni->n", normal, position) - by_carrier @ p
        slope = np.einsum("ni,ni->n", by_carrier @ R, ray)
        length = away / np.where(np.abs(slope) > 1e-9, slope, 1e-9)
        # Cosine of the steepest angle at which a simulated depth camera sees a plane.
        steepest = 0.25
        # Between which distances it sees, m.
        reach = (0.1, 3.0)
        sighted = (np.abs(slope) > steepest) & (length == np.clip(length, *reach))
        # A plane that a ray does not meet is farther away than anything, m.
        beyond = 100.0
        points = ray * np.clip(length, -beyond, beyond)[:, None]
        sigma = None if self.depth_noise is None else self.depth_noise.sigmas(points[:, 2])
        return Observed(points, axes=self.simulated_axes(points), sigma=sigma, sighted=sighted)

    def seen_planes(self, values: Mapping[str, float]) -> Mapping[str, FloatArray]:
        """The points of each, moved onto it along its normal."""
        carrier = as_eye_in_hand(self.poses.at(values), self.setup)
        R, p = after(carrier, pose_named(values, self.frame_names[0]))
        at, names = np.einsum("nij,nj->ni", R, self.in_eye) + p, self.seen[0]
        planes = dict[str, FloatArray]()
        for k, (name, frame) in enumerate(zip(names, self.outside[1:], strict=True)):
            turn, origin = frame.pose(values)
            assert turn is not None
            mine, normal = at[self.seen[1] == k], turn[:, 2]
            planes[name or self.mark] = mine - np.outer((mine - origin) @ normal, normal)
        return planes

    # ── where the solver starts ───────────────────────────────────────────────────────────────
    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """From rotations of the camera all about; normals point up."""
        found = self._found((rotation, position))
        up = np.where(found.normal[:, 2] < 0, -1.0, 1.0)
        turns = vector_turning_z_to(found.normal * up[:, None])
        planes = np.column_stack([found.distance * up, turns[:, :2]])
        return np.concatenate([pose_values(found.rotation, found.position), planes.reshape(-1)])

    def _found(self, hand: Poses) -> EyeAndPlanes:
        return eye_and_planes(as_eye_in_hand(hand, self.setup), self.in_eye, self.seen[1])

    # ── what is doubted ───────────────────────────────────────────────────────────────────────
    @property
    def doubts(self) -> Mapping[str, Level]:
        """Also what of the camera's pose is open, because the planes were tilted too little."""
        hand = self.poses.at({})
        carrier = as_eye_in_hand(hand, self.setup)
        motions = open_motions(carrier, self.in_eye, self.seen[1], self._found(hand))
        if not len(motions):
            return super().doubts
        return {self._left_open(motions): "care", **super().doubts}

    def _left_open(self, motions: FloatArray) -> str:
        """What motions (k, 6) of the camera leave open, in a sentence."""
        carrier = self.poses.label("the tip", "tip") if self.ends[0] == "tip" else "the base"
        place, turn = motions[:, :3], motions[:, 3:]
        parts = [
            *([f"where the camera is{_directions(place, 'along')}"] if _large(place) else []),
            *([f"how it is turned{_directions(turn, 'about')}"] if _large(turn) else []),
        ]
        return (
            f"These planes do not determine {', nor '.join(parts)} (in the axes of {carrier}): "
            "they were seen too much alike. What is stated of the camera and of the planes in "
            "these directions is arbitrary. Tilt the hand by tens of degrees, about two axes and "
            "by different angles, or let the camera see another plane that is square to the first."
        )


def _large(parts: FloatArray) -> bool:
    return bool(np.linalg.norm(parts) > _SHARE)


def _directions(parts: FloatArray, word: str) -> str:
    """Of displacements or turns (k, 3), along or about what they are; empty for all directions."""
    size, vectors = right_singular(parts)
    count = int(np.sum(size > _SHARE * size[0]))
    if count == 3:
        return ""
    axis = vectors[0] if count == 1 else vectors[2]
    shown = "({:.2f} {:.2f} {:.2f})".format(*(axis * np.sign(axis[np.argmax(np.abs(axis))]) + 0.0))
    return f" {word} {shown}" if count == 1 else f" {word} what is square to {shown}"


def _rays(measured: FloatArray | None, count: int) -> FloatArray:
    """Unit vectors (n, 3) to what was measured, or all over the view where nothing was."""
    number = np.arange(count)
    # Of low discrepancy, so that few rays see all of a plane (Roberts, the plastic number).
    across, about = np.modf(np.outer([0.7548776662, 0.5698402910], number + 1))[0]
    # Slope of the edge of a depth camera's view.
    aside = 0.4 * np.sqrt(across)
    angle = 2.0 * np.pi * about
    rays = np.column_stack([aside * np.cos(angle), aside * np.sin(angle), np.ones(count)])
    if measured is not None:
        there = measured.any(axis=1)
        rays[there] = measured[there]
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
