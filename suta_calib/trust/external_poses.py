"""Poses of what stands outside the arm, with their covariance.

The solver's unknowns are a position and a rotation vector; what a user wants is a pose with the
scatter of its position and of a small turn. Both are functions of the unknowns, differentiated by
differences: δpose = J δunknowns, and J C Jᵀ is the covariance.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import homogeneous, quaternion_from_rotation, vector_from_rotation
from suta_calib.model.parameters import PLACEMENT, is_base
from suta_calib.solver.solution import Solution
from suta_calib.terms.external_frame import ExternalFrame, OutsidePose, pose_named


@dataclass(frozen=True, eq=False)
class ExternalPose:
    """A frame, or a point, that a calibration found outside the arm.

    Attributes:
        frame: which.
        rotation: (3, 3) of ``T_within_what``; None for a point.
        position: (3,) m.
        std: (6,) standard deviations of the position, m, in the axes of ``within``, and of a small
            turn about the frame's own axes, rad; NaN for what the data cannot tell.
        quaternion_std: (4,) of the quaternion's components x, y, z, w, likewise.
        held: unknowns of the pose that the data could not tell.
        given: parameters of the arm, held by convention, and keys of the job that nothing measured
            checks: the pose is meant relative to them.
    """

    frame: ExternalFrame
    rotation: FloatArray | None
    position: FloatArray
    std: FloatArray
    quaternion_std: FloatArray
    held: tuple[str, ...]
    given: tuple[str, ...]

    @property
    def name(self) -> str:
        """What its parameters are called before the dot."""
        return self.frame.owner

    @property
    def words(self) -> str:
        """``eye in tip``."""
        return f"{self.frame.what} in {self.frame.within}"

    @cached_property
    def matrix(self) -> FloatArray | None:
        """(4, 4) of ``T_within_what``, m; None for a point."""
        return None if self.rotation is None else homogeneous(self.rotation, self.position)

    @cached_property
    def inverse(self) -> FloatArray | None:
        """(4, 4) of ``T_what_within``, m; None for a point."""
        if self.rotation is None:
            return None
        return homogeneous(self.rotation.T, -self.rotation.T @ self.position)

    @cached_property
    def quaternion(self) -> FloatArray | None:
        """(4,) x, y, z, w of the rotation, w ≥ 0; None for a point."""
        return None if self.rotation is None else quaternion_from_rotation(self.rotation)


def external_poses(solution: Solution) -> tuple[ExternalPose, ...]:
    """Every pose and point outside the arm that a solution has, by name; none without convergence.

    Several terms may share one: it is told once.
    """
    frames = {frame.owner: frame for frame in _robot_bases(solution)}
    frames |= {frame.owner: frame for term in solution.problem.terms for frame in term.outside}
    if not solution.converged:
        return ()
    return tuple(_external_pose(solution, frame) for frame in frames.values())


@dataclass(frozen=True)
class _RobotBase(ExternalFrame):
    """The base of a robot in a cell, turned from where its URDF would have it."""

    turn: FloatArray = field(default_factory=lambda: np.eye(3))

    def pose(self, values: Mapping[str, float]) -> OutsidePose:
        """As of a joint's placement: its own turn comes last."""
        rotation, position = pose_named(values, self.owner)
        return self.turn @ rotation, position


def _robot_bases(solution: Solution) -> Iterator[ExternalFrame]:
    """Of which something was to be found."""
    arm = solution.problem.arm
    for segment in () if arm is None else arm.segments:
        owner = segment.owner
        names = [f"{owner}.{key}" for key in PLACEMENT]
        if is_base(owner) and set(names) <= set(solution.estimates):
            yield _RobotBase(owner, "robot", "base", PLACEMENT, turn=segment.rotation)


def _external_pose(solution: Solution, frame: ExternalFrame) -> ExternalPose:
    estimates = [solution.estimates[name] for name in frame.names]
    values = {e.name: e.value for e in estimates}
    rotation, position = frame.pose(values)
    turned = rotation is not None
    axes = np.eye(3) if rotation is None else rotation
    moved = np.zeros((6, len(estimates)))
    change = 1e-6
    for k, name in enumerate(frame.names):
        (Ra, pa), (Rb, pb) = (
            frame.pose(values | {name: values[name] + step}) for step in (-change, change)
        )
        moved[:3, k] = (pb - pa) / (2 * change)
        if Ra is not None and Rb is not None:
            moved[3:, k] = vector_from_rotation(axes.T @ Rb) - vector_from_rotation(axes.T @ Ra)
    moved[3:] /= 2 * change
    x, y, z, w = quaternion_from_rotation(axes)
    # q ⊗ (θ/2, 1) for a small turn θ about the frame's own axes.
    turns = np.array([[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]]) / 2
    rows = [solution.problem.names.index(name) for name in frame.names]
    covariance = solution.covariance[np.ix_(rows, rows)]
    held = tuple(e.name for e in estimates if e.state in ("unidentified", "at_bound"))
    # Directions in which the unknowns may move and nothing measured changes.
    open_ways = np.array(
        [
            [direction.get(name, 0.0) for name in frame.names]
            for direction in _open_directions(solution, held)
        ]
    ).reshape(-1, len(estimates))

    def std(by_unknown: FloatArray) -> FloatArray:
        spread = np.sqrt(
            np.maximum(np.einsum("ij,jk,ik->i", by_unknown, covariance, by_unknown), 0)
        )
        # A number that changes by less, m or rad per unit, does not depend on what is held.
        lost = (np.abs(by_unknown @ open_ways.T) > 1e-6).any(axis=1)
        return np.where(lost, np.nan, spread)

    relative = (name for e in estimates for name in e.given if name not in values)
    return ExternalPose(
        frame,
        rotation,
        position,
        std(moved) if turned else np.concatenate([std(moved[:3]), np.full(3, np.nan)]),
        std(turns @ moved[3:]) if turned else np.full(4, np.nan),
        held,
        tuple(dict.fromkeys((*frame.given, *relative))),
    )


def _open_directions(solution: Solution, held: Sequence[str]) -> Iterator[Mapping[str, float]]:
    """Of held unknowns: the combination that was to be held with each, or it alone."""
    combinations = {c.fixed: c.direction for c in solution.identification.combinations}
    return (combinations.get(name, {name: 1.0}) for name in held)
