"""What a change of the parameters does to the tip, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length, skew
from suta_calib.solver.problem import Problem
from suta_calib.trust.rich_data import LEVER

# A part or a misfit this small beside the whole is put there by noise.
NOISE: Final = 0.05


@dataclass(frozen=True, eq=False)
class TipMotion:
    """Velocities of the tip at every sample when the parameters move along one direction.

    Attributes:
        position: (n, 3) of the tip in the base, m.
        rotation: (n, 3, 3) of the tip in the base.
        linear: (n, 3) velocity of the tip in the base, m per unit of the direction.
        angular: (n, 3) angular velocity in the base, rad per unit.
        parts: effect of each parameter by itself, m per unit: root mean square over the samples,
            angles at `LEVER`.
    """

    position: FloatArray
    rotation: FloatArray
    linear: FloatArray
    angular: FloatArray
    parts: dict[str, float]

    @property
    def size(self) -> float:
        """Root mean square of the whole motion, m per unit, angles at `LEVER`."""
        return _size(self.linear, self.angular)

    @property
    def main(self) -> tuple[str, ...]:
        """The parameters that do the moving, strongest first: the others are noise."""
        largest = max(self.parts.values(), default=0.0)
        moving = [name for name, size in self.parts.items() if size >= NOISE * largest]
        return tuple(sorted(moving, key=lambda name: -self.parts[name]))

    @property
    def vanishes(self) -> bool:
        """Whether the parts cancel, so that nothing moves at all."""
        # Parts that cancel to this share of the largest one cancel.
        cancels = 0.02
        return self.size <= cancels * max(self.parts.values(), default=0.0)

    @property
    def turns_in_place(self) -> bool:
        """Whether the tip turns but stays where it is."""
        return _rms(self.linear) <= NOISE * LEVER * _rms(self.angular)

    def base_twist(self) -> tuple[FloatArray, FloatArray, float]:
        """The one rigid motion of the base that explains all samples best: v, ω and the misfit.

        Returns:
            Velocity (3,) of the base's origin and angular velocity (3,), in the base, per unit;
            and what they leave unexplained as a part of the whole, 0 … 1.
        """
        omega = self.angular.mean(axis=0)
        v = (self.linear - np.cross(omega, self.position)).mean(axis=0)
        left = self.linear - v - np.cross(omega, self.position)
        return v, omega, self._misfit(left, self.angular - omega)

    def tool_twist(self) -> tuple[FloatArray, FloatArray, float]:
        """The same for a motion of the tip that is always the same in the tip's own frame."""
        linear = np.einsum("nji,nj->ni", self.rotation, self.linear)
        angular = np.einsum("nji,nj->ni", self.rotation, self.angular)
        v, omega = linear.mean(axis=0), angular.mean(axis=0)
        return v, omega, self._misfit(linear - v, angular - omega)

    def rigid_per_group(self, groups: FloatArray) -> float:
        """Misfit of one rigid motion per group (n,): what the touched points alone would show."""
        left = np.zeros_like(self.linear)
        for group in np.unique(groups):
            rows = np.flatnonzero(groups == group)
            p = self.position[rows] - self.position[rows].mean(axis=0)
            design = np.concatenate(
                [np.tile(np.eye(3), (len(rows), 1, 1)), -skew(p)], axis=2
            ).reshape(-1, 6)
            flat = self.linear[rows].reshape(-1)
            twist = np.linalg.lstsq(design, flat, rcond=1e-9)[0]
            left[rows] = (flat - design @ twist).reshape(-1, 3)
        return _rms(left) / max(_rms(self.linear), 1e-300)

    def _misfit(self, linear: FloatArray, angular: FloatArray) -> float:
        return _size(linear, angular) / max(self.size, 1e-300)


def tip_motion(problem: Problem, x: FloatArray, direction: Mapping[str, float]) -> TipMotion:
    """Push a direction of the arm's parameters through the forward kinematics.

    Args:
        problem: whose samples are visited.
        x: (n,) parameters to linearise at.
        direction: change of each parameter, m or rad per unit; names of others are ignored.
    """
    problem.linearise(x, problem.assumed_sigmas())
    table, names = problem.evaluation.table, problem.names[: problem.arm_count]
    moving = {name: k for k, name in enumerate(names) if name in direction}
    factor = np.array([direction[name] for name in moving])
    columns = table.velocity
    if len(moving) < columns.shape[1]:
        columns = columns[:, list(moving.values())]
    total = (columns @ factor).reshape(-1, 6)
    columns = columns.reshape(len(table.position), 6, len(moving))
    squares = np.einsum("nvk,nvk->vk", columns, columns) * factor**2 / max(len(columns), 1)
    sizes = np.sqrt(squares[:3].sum(axis=0) + LEVER**2 * squares[3:].sum(axis=0))
    parts = dict(zip(moving, sizes.tolist(), strict=True))
    rotation = np.swapaxes(table.rotation.reshape(-1, 3, 3), 1, 2).copy()
    return TipMotion(table.position.copy(), rotation, total[:, :3], total[:, 3:], parts)


def placement_groups(problem: Problem) -> FloatArray:
    """(n,) one number per set of samples whose common motion its own unknowns make up for."""
    keys: list[tuple[object, ...]] = []
    for k, term in enumerate(problem.terms):
        labels = term.poses.samples.labels
        columns = [labels[name] for name in (term.place, "repeat") if name in labels]
        keys += [(k, *(str(c[row]) for c in columns)) for row in range(len(term.poses))]
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    return np.array([number[key] for key in keys], dtype=float)


def _size(linear: FloatArray, angular: FloatArray) -> float:
    return float(np.hypot(_rms(linear), LEVER * _rms(angular)))


def _rms(vectors: FloatArray) -> float:
    return rms_length(vectors) if len(vectors) else 0.0
