"""The thesis' problem written the usual way: NumPy kinematics and SciPy's least squares.

Everything a careful user would do is done: forward kinematics of all samples at once, pairs
gathered by index, Huber loss, bounds. The Jacobian is SciPy's own 2-point difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.spatial.transform import Rotation

from suta_calib import ArmModel, ArmPoses, Problem


def tip_positions(arm: ArmModel, q: np.ndarray, value: Mapping[str, float]) -> np.ndarray:
    """Tip positions (n, 3), m, of the arm with these values, vectorised over the samples."""
    rotation = np.broadcast_to(np.eye(3), (len(q), 3, 3))
    position = np.zeros((len(q), 3))
    column = 0
    for s in arm.segments:
        placed = [value.get(f"{s.owner}.{k}", s.position[i]) for i, k in enumerate("xyz")]
        position = position + rotation @ np.array(placed)
        rotation = rotation @ s.rotation
        turn = [value.get(f"{s.owner}.{k}", 0.0) for k in ("rx", "ry", "rz")]
        if any(turn):
            rotation = rotation @ Rotation.from_rotvec(turn).as_matrix()
        if s.motion == "fixed":
            continue
        reading = q[:, column] + value.get(f"{s.owner}.offset", 0.0)
        if s.motion == "revolute":
            rotation = rotation @ _about(s.axis, reading)
        else:
            position = position + rotation @ s.axis * reading[:, None]
        column += 1
    return position


class NumpyDistances:
    """Residuals of pairwise distances, m, from a vector of named arm parameters."""

    def __init__(self, problem: Problem, names: Sequence[str]) -> None:
        source = problem.terms[0].poses
        assert isinstance(source, ArmPoses)
        self.arm: ArmModel = source.arm
        self.q = source.samples.q
        self.names = list(names)
        block = problem.blocks[0]
        self.first, self.second = block.samples.T
        self.length = block.data[:, 0]
        self.huber = block.noise.huber
        chosen = [problem.parameters[n] for n in names]
        self.bounds = ([p.lower for p in chosen], [p.upper for p in chosen])
        self.scale = np.array([p.scale for p in chosen])

    def positions(self, x: np.ndarray) -> np.ndarray:
        """Tip positions of all samples (n, 3), vectorised over the samples."""
        return tip_positions(self.arm, self.q, dict(zip(self.names, x, strict=True)))

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Distances minus certified lengths (pairs,)."""
        p = self.positions(x)
        return np.linalg.norm(p[self.first] - p[self.second], axis=1) - self.length

    def solve(self, start: np.ndarray, jacobian: object = "2-point") -> OptimizeResult:
        """SciPy's trust region reflective method from one start."""
        return least_squares(
            self.residuals,
            np.clip(start, *self.bounds),
            jac=jacobian,
            bounds=self.bounds,
            loss="huber",
            f_scale=self.huber,
            x_scale=self.scale,
            max_nfev=500,
        )


class LoopDistances(NumpyDistances):
    """The same with one sample after the other, as a first version is usually written."""

    def positions(self, x: np.ndarray) -> np.ndarray:
        """Tip positions of all samples (n, 3), in a Python loop."""
        value = dict(zip(self.names, x, strict=True))
        found = np.zeros((len(self.q), 3))
        for i, q in enumerate(self.q):
            transform, column = np.eye(4), 0
            for s in self.arm.segments:
                origin = np.eye(4)
                origin[:3, :3] = s.rotation
                origin[:3, 3] = [
                    value.get(f"{s.owner}.{k}", s.position[j]) for j, k in enumerate("xyz")
                ]
                transform = transform @ origin
                if s.motion == "revolute":
                    turn = np.eye(4)
                    angle = q[column] + value.get(f"{s.owner}.offset", 0.0)
                    turn[:3, :3] = _about(s.axis, np.array([angle]))[0]
                    transform = transform @ turn
                    column += 1
            found[i] = transform[:3, 3]
        return found


def _about(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) about a unit axis."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    sine, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.eye(3) + sine * k + versine * (k @ k)
