"""Where the links of an arm are in a posture: to draw them, and to see whether they collide."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.model.arm import ArmModel

# Measured postures that are looked at to learn which shapes overlap by construction.
_LOOKED_AT: Final = 60


def configuration(arm: ArmModel, q: FloatArray) -> FloatArray:
    """Readings (joints,) as a configuration of ``arm.model``, continuous joints included."""
    return np.asarray(pin.integrate(arm.model, pin.neutral(arm.model), np.asarray(q, dtype=float)))


def link_points(arm: ArmModel, q: FloatArray) -> FloatArray:
    """Origins of the base, of every moving joint and of the tip, (joints + 2, 3), m in the base.

    Args:
        arm: the arm; its nominal geometry is drawn.
        q: (joints,) readings, rad (m for prismatic joints).
    """
    model, data = arm.model, arm.model.createData()
    pin.framesForwardKinematics(model, data, configuration(arm, q))
    base = data.oMf[model.getFrameId(arm.chain.joints[0].parent, pin.FrameType.BODY)]
    _, tip = arm.forward(q)
    joints = [base.actInv(placement).translation for placement in list(data.oMi)[1:]]
    return np.array([np.zeros(3), *joints, tip])


@dataclass(frozen=True, eq=False)
class Collisions:
    """Self-collision of an arm, by the shapes of its URDF.

    Attributes:
        arm: the arm.
        geometry: shapes and the pairs that are looked at; None where nothing can be checked.
        note: what is checked, or why nothing is, for people.
    """

    arm: ArmModel
    geometry: Any
    note: str

    @classmethod
    def of(cls, arm: ArmModel, visited: FloatArray) -> Collisions:
        """Read the URDF's shapes.

        Args:
            arm: the arm.
            visited: (n, joints) readings the real arm had: what overlaps there does not collide.

        Returns:
            Pairs of links that are neighbours, or overlap in a visited posture, are left out.
            Collision shapes count; where there is none, those that are drawn.
        """
        for kind, word in ((pin.GeometryType.COLLISION, "collision"), (pin.VISUAL, "visual")):
            try:
                geometry = _shapes(arm, kind)
            except (ValueError, RuntimeError) as error:
                reason = " ".join(str(error).split())
                return cls(arm, None, f"collisions not checked: {reason}")
            if geometry.ngeoms:
                return cls._over(arm, geometry, word, visited)
        return cls(arm, None, "collisions not checked: the URDF has no shapes")

    @classmethod
    def _over(cls, arm: ArmModel, geometry: Any, word: str, visited: FloatArray) -> Collisions:
        # All pairs but those of one link or of neighbours.
        parents = [shape.parentJoint for shape in geometry.geometryObjects]
        for (j, b), (i, a) in combinations(enumerate(parents), 2):
            if a != b and arm.model.parents[a] != b and arm.model.parents[b] != a:
                geometry.addCollisionPair(pin.CollisionPair(j, i))
        found = cls(arm, geometry, "")
        overlapping = {
            pair for q in visited[:: 1 + len(visited) // _LOOKED_AT] for pair in found._hits(q)
        }
        for k in sorted(overlapping, reverse=True):
            geometry.removeCollisionPair(geometry.collisionPairs[k])
        count = len(geometry.collisionPairs)
        note = (
            f"self-collisions checked with {count} pairs of the URDF's {word} shapes; table and "
            "artefact are not looked at"
        )
        return cls(arm, geometry if count else None, note)

    def free(self, q: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether the arm in these readings (n, joints) touches nothing of itself."""
        if self.geometry is None:
            return np.ones(len(q), dtype=bool)
        return np.array([not self._hits(row) for row in q], dtype=bool)

    def _hits(self, q: FloatArray) -> Sequence[int]:
        """Numbers of the pairs that overlap."""
        data, shapes = self.arm.model.createData(), self.geometry.createData()
        pin.computeCollisions(
            self.arm.model, data, self.geometry, shapes, configuration(self.arm, q), False
        )
        return [k for k, result in enumerate(shapes.collisionResults) if result.isCollision()]


def _shapes(arm: ArmModel, kind: Any) -> Any:
    """Geometry of the reduced model; meshes are looked for beside the URDF and above it."""
    path = arm.chain.path
    model = pin.buildModelFromUrdf(str(path))
    folders = [str(folder) for folder in path.resolve().parents]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        geometry = pin.buildGeomFromUrdf(model, str(path), kind, folders)
    kept = set(arm.model.names)
    locked = [i for i in range(1, model.njoints) if model.names[i] not in kept]
    _, reduced = pin.buildReducedModel(model, [geometry], locked, pin.neutral(model))
    return reduced[0]
