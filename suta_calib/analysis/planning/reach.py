"""From places to candidates: what the arm can touch, in which postures, without colliding."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from suta_calib.analysis.planning.candidates import (
    Candidate,
    Place,
    Placement,
    Posture,
    TouchPoint,
    Unreachable,
)
from suta_calib.analysis.planning.region import directions, nearest
from suta_calib.analysis.planning.situation import Situation
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_vector, vector_turning_z_to
from suta_calib.measurements import Artefact
from suta_calib.model.arm import ArmModel
from suta_calib.model.kinematic_urdf import pinocchio_model
from suta_calib.model.urdf_tree import read_tree
from suta_calib.simulation.inverse_kinematics import Matching, Postures, Targets
from suta_calib.terms import KINDS, Term
from suta_calib.terms.landmark import seated

# Of the directions of a point, the part that must be reached; more are tried than are needed.
_ENOUGH: Final = 0.5


@dataclass(frozen=True, eq=False)
class Reached:
    """Candidates, the places that are none, and what is known of collisions."""

    candidates: tuple[Candidate, ...]
    unreachable: tuple[Unreachable, ...]
    collisions: str


@dataclass(frozen=True, eq=False)
class Reach(Displayable):
    """Finds postures for places, near those the arm had."""

    situation: Situation
    repeats: int
    seed: int = 0

    def candidates(self, places: Sequence[Place]) -> Reached:
        """Those places every touch of which is within reach, joint limits and free of collision.

        Raises:
            JobError: a place needs an artefact or an instrument that the job does not have.
        """
        for place in places:
            if isinstance(place, Placement) and self.situation.touching is None:
                kinds = [name for name, kind in KINDS.items() if kind.needs_artefact]
                say = "the artefact"
            elif isinstance(place, Posture) and self.situation.sighted is None:
                kinds = [name for name, kind in KINDS.items() if kind.medium != "touch"]
                say = "the camera or instrument"
            else:
                continue
            raise JobError(
                f"{place.kind} {place.name!r}",
                f"a job with {' or '.join(kinds)} observations, which define {say}",
                line=place.line,
                where="candidates",
            )
        collisions = Collisions.of(self.situation.arm, self.situation.readings)
        by_name = self._placements([p for p in places if isinstance(p, Placement)])
        by_name |= self._points([p for p in places if isinstance(p, TouchPoint)])
        for place in places:
            if isinstance(place, Posture):
                q, moving = place.readings, self.situation.arm.readings
                off = [
                    joint.name
                    for joint, reading in zip(moving, q, strict=True)
                    if not joint.lower - 1e-9 <= reading <= joint.upper + 1e-9
                ]
                why = f"{off[0]} beyond its limits" if off else ""
                if not why and not self.situation.in_sight(q[None, :])[0]:
                    why = "the camera sees no target"
                by_name[place.name] = (
                    Unreachable(place.name, place.kind, why)
                    if why
                    else Candidate(place, q[None, :], (), 1)
                )
        judged = [self._colliding(by_name[place.name], collisions) for place in places]
        return Reached(
            tuple(c for c in judged if isinstance(c, Candidate)),
            tuple(c for c in judged if isinstance(c, Unreachable)),
            collisions.note,
        )

    def _placements(self, places: Sequence[Placement]) -> dict[str, Candidate | Unreachable]:
        artefact = self.situation.artefact
        if artefact is None or not places:
            return {}
        q, ok, failed = self._touch(places, artefact)
        by_name: dict[str, Candidate | Unreachable] = {}
        names = tuple(mark.name for mark in artefact.landmarks.values())
        for place, readings, good, lost in zip(places, q, ok, failed, strict=True):
            if good.all():
                by_name[place.name] = Candidate(place, readings, names, self.repeats)
            else:
                # One is enough: the others are not all looked for any more.
                missed = names[int(np.argmax(lost))]
                by_name[place.name] = Unreachable(
                    place.name, place.kind, f"landmark {missed} out of reach"
                )
        return by_name

    def _touch(
        self, places: Sequence[Placement], artefact: Artefact
    ) -> tuple[FloatArray, NDArray[np.bool_], NDArray[np.bool_]]:
        """Postures (places, marks, joints), whether they reach, and whether none was found that do.

        Seats fix the orientation. Of a place that is out of reach, not all marks are looked for.
        """
        tips = [seated(artefact, [*artefact.landmarks], p.rotation, p.position) for p in places]
        position = np.array([tip.position for tip in tips])
        rotation = np.array([tip.rotation for tip in tips])
        q = np.zeros((*position.shape[:2], len(self.situation.arm.joints)))
        ok, failed = (np.zeros(position.shape[:2], dtype=bool) for _ in range(2))
        oriented = np.array([mark.rotation is not None for mark in artefact.landmarks.values()])
        touching = self.situation.touching
        if touching is not None and not touching.has_angles:
            oriented &= self.situation.kinematics.attainable["pose"]
        kinds: dict[Matching, NDArray[np.bool_]] = {"pose": oriented, "position": ~oriented}
        for matching, rows in kinds.items():
            if rows.any():
                targets = Targets(
                    position[:, rows].reshape(-1, 3), rotation[:, rows].reshape(-1, 3, 3), matching
                )
                solved = self._solve(targets, np.repeat(np.arange(len(places)), rows.sum()))
                q[:, rows] = solved.q.reshape(len(places), -1, q.shape[2])
                ok[:, rows] = solved.reached.reshape(len(places), -1)
                failed[:, rows] = solved.failed.reshape(len(places), -1)
        return q, ok, failed

    def _points(self, places: Sequence[TouchPoint]) -> dict[str, Candidate | Unreachable]:
        if not places:
            return {}
        counts = [2 * place.directions for place in places]
        kind = self.situation.places
        settings = kind.settings if isinstance(kind, Term) else {}
        position, rotation = [], []
        for p, n in zip(places, counts, strict=True):
            k = np.arange(n, dtype=np.float64)
            # The z axes fill the cone along a spiral by the golden ratio, the root of x² = x + 1;
            # the places touched fill theirs by Roberts' sequence: powers of that of x³ = x + 1.
            square = (0.5 + k[:, None] * [0.7548776662466927, 0.5698402909980532]) % 1.0
            facing = rotation_from_vector(vector_turning_z_to(-p.axis))
            position.append(kind.touches(facing, p.position, square, settings))
            around = (k * (math.sqrt(5.0) - 1.0) / 2.0) % 1.0
            rotation.append(directions(p.axis, p.cone, (k + 0.5) / n, around))
        # An arm of few joints comes as it can.
        matching = self.situation.kinematics.most("axis")
        targets = Targets(np.concatenate(position), np.concatenate(rotation), matching)
        there = self._solve(targets)
        by_name: dict[str, Candidate | Unreachable] = {}
        ends = np.cumsum(counts)
        for place, end, count in zip(places, ends, counts, strict=True):
            q = there.q[end - count : end][there.reached[end - count : end]]
            if len(q) < _ENOUGH * count:
                reason = f"{len(q)} of {count} directions within reach"
                by_name[place.name] = Unreachable(place.name, place.kind, reason)
                continue
            spread = np.linspace(0, len(q) - 1, place.directions).round().astype(int)
            by_name[place.name] = Candidate(place, q[spread], (), 1)
        return by_name

    def _solve(self, targets: Targets, together: IntArray | None = None) -> Postures:
        """Postures near those the arm had: whoever measures will not fold it another way."""
        visited = self.situation.readings[nearest(self.situation.tips[1], targets.position)]
        rng = np.random.default_rng(self.seed)
        starts = 8
        return self.situation.kinematics.solve(targets, visited, rng, starts, together)

    @staticmethod
    def _colliding(
        candidate: Candidate | Unreachable, collisions: Collisions
    ) -> Candidate | Unreachable:
        if isinstance(candidate, Unreachable) or collisions.geometry is None:
            return candidate
        free = collisions.free(candidate.q)
        if free.all():
            return candidate
        if isinstance(candidate.place, TouchPoint) and free.mean() >= _ENOUGH:
            rows = np.resize(np.flatnonzero(free), len(free))
            return Candidate(candidate.place, candidate.q[rows], (), candidate.repeats)
        reason = f"the arm touches itself in {int((~free).sum())} of {len(free)} postures"
        return Unreachable(candidate.name, candidate.place.kind, reason)


@dataclass(frozen=True, eq=False)
class Collisions:
    """Self-collision of an arm, by the shapes of its URDF.

    ``geometry`` has shapes and pairs, None where nothing can be checked; ``note`` says so.
    """

    arm: ArmModel
    geometry: Any
    note: str

    @classmethod
    def of(cls, arm: ArmModel, visited: FloatArray) -> Collisions:
        """Read the URDF's collision shapes or, where there is none, those that are drawn.

        Links that are neighbours, or overlap in readings (n, joints) that the real arm had, do
        not collide.
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
        collisions = cls(arm, geometry, "")
        # Measured postures that are looked at to learn which shapes overlap by construction.
        overlapping = {
            pair for q in visited[:: 1 + len(visited) // 60] for pair in collisions._hits(q)
        }
        for k in sorted(overlapping, reverse=True):
            geometry.removeCollisionPair(geometry.collisionPairs[k])
        count = len(geometry.collisionPairs)
        note = (
            f"self-collisions checked with {count} pairs of the URDF's {word} shapes; collisions "
            "with the table or the artefact are not checked"
        )
        return cls(arm, geometry if count else None, note)

    def free(self, q: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether the arm in these readings (n, joints) touches nothing of itself."""
        if self.geometry is None:
            return np.ones(len(q), dtype=bool)
        return np.array([not self._hits(row, first=True) for row in q], dtype=bool)

    def _hits(self, q: FloatArray, *, first: bool = False) -> Sequence[int]:
        """Numbers of the pairs that overlap, or of the ``first`` that is found."""
        model, shapes = self.arm.model, self.geometry.createData()
        at = self.arm.configuration(q)
        pin.computeCollisions(model, model.createData(), self.geometry, shapes, at, first)
        return [k for k, result in enumerate(shapes.collisionResults) if result.isCollision()]


def _shapes(arm: ArmModel, kind: Any) -> Any:
    """Geometry of the reduced model; meshes are looked for beside the URDF and above it."""
    path, data = arm.urdf
    folders = [str(folder) for folder in path.resolve().parents]
    model = pinocchio_model(read_tree(path, data), set(arm.model.names))
    text = data.decode("utf-8", errors="replace")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pin.buildGeomFromUrdfString(model, text, kind, package_dirs=folders)
