"""What the tip is brought to: landmarks of placed artefacts, and fixed points from all sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Artefact, Landmark
from suta_calib.simulation.inverse_kinematics import (
    InverseKinematics,
    Matching,
    Postures,
    Targets,
)
from suta_calib.simulation.noise import stream
from suta_calib.simulation.schema import PoseSpec, SetSpec, SimulationSpec

# A direction that few starts reach is not worth more: another one is drawn.
_STARTS_PER_DIRECTION: Final = 6
_MOST_BATCHES: Final = 20
_DOWN: Final = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False)
class Visits:
    """The touches of one file, in order, and a posture for each.

    Attributes:
        name: of the placement or point, and of the file.
        labels: label columns, each (n,).
        targets: true poses of the tip before any noise, n of them.
        oriented: (n,) whether what is touched fixes the tip's orientation too.
        start: (n, joints) readings that reach the targets.
        line: where the placement or point stands in the simulation's file.
    """

    name: str
    labels: dict[str, list[str]]
    targets: Targets
    oriented: BoolArray
    start: FloatArray
    line: int | None = None

    def what(self, row: int) -> str:
        """What a row touches, for messages."""
        if "landmark" in self.labels:
            return f"landmark {self.labels['landmark'][row]!r} of placement {self.name!r}"
        return f"point {self.name!r}"


@dataclass(frozen=True, eq=False)
class Visitor:
    """The true arm and where its postures are searched.

    Attributes:
        spec: the whole simulation, for its messages.
        kinematics: of the true arm.
        posture: (joints,) readings from which the search starts.
        seed: of the starts and directions.
    """

    spec: SimulationSpec
    kinematics: InverseKinematics
    posture: FloatArray
    seed: int

    def artefact(self, plan: SetSpec, label: str, pose: PoseSpec, truth: Artefact) -> Visits:
        """All landmarks of one placement, ``plan.repeats`` times.

        Raises:
            JobError: a landmark is out of reach; names it and the placement.
        """
        landmarks = list(truth.landmarks.values())
        once = _seated(label, pose, landmarks, self.posture)
        rng = stream(self.seed, plan.name, label, "postures")
        start = self.reach(once, once.targets, once.start, rng, f"sets.{plan.name}.placements")
        n, repeats = len(landmarks), plan.repeats
        labels = {
            "placement": [label] * (n * repeats),
            "repeat": [str(k + 1) for k in range(repeats) for _ in range(n)],
            "landmark": once.labels["landmark"] * repeats,
        }
        rows = np.tile(np.arange(n), repeats)
        targets = once.targets.take(rows)
        return Visits(label, labels, targets, once.oriented[rows], start[rows], pose.line)

    def fixed_point(self, plan: SetSpec, label: str, point: PoseSpec) -> Visits:
        """One point from ``plan.directions`` directions spread over the cone.

        Raises:
            JobError: too few directions of the cone can be reached.
        """
        rng = stream(self.seed, plan.name, label, "postures")
        found = np.empty((0, len(self.posture)))
        for _ in range(_MOST_BATCHES):
            wanted = _cone_targets(plan, point, rng)
            starts = self._anywhere(rng, len(wanted))
            answer = self.kinematics.solve(wanted, starts, rng, _STARTS_PER_DIRECTION)
            found = np.concatenate([found, answer.q[answer.reached]])
            if len(found) >= plan.directions:
                break
        else:
            raise self._too_few(plan, label, point, len(found))
        n = plan.directions
        targets = Targets(np.tile(point.position, (n, 1)), np.tile(np.eye(3), (n, 1, 1)))
        # Whatever the direction, the point is touched: it alone has to be met again with noise.
        unoriented = np.zeros(n, dtype=bool)
        return Visits(label, {"point": [label] * n}, targets, unoriented, found[:n], point.line)

    def reach(
        self,
        visits: Visits,
        targets: Targets,
        start: FloatArray,
        rng: np.random.Generator,
        where: str,
    ) -> FloatArray:
        """Readings (n, joints) that reach every target; ``visits`` says what each of them is.

        Raises:
            JobError: one cannot be reached; says which, and how close the tip came.
        """
        q = np.empty_like(start)
        kinds: tuple[tuple[Matching, BoolArray], ...] = (
            ("pose", visits.oriented),
            ("position", ~visits.oriented),
        )
        for matching, chosen in kinds:
            rows = np.flatnonzero(chosen)
            if not len(rows):
                continue
            some = Targets(targets.position[rows], targets.rotation[rows], matching)
            answer = self.kinematics.solve(some, start[rows], rng)
            for k in np.flatnonzero(~answer.reached):
                raise self._out_of_reach(visits, int(rows[k]), answer, int(k), where)
            q[rows] = answer.q
        return q

    def _anywhere(self, rng: np.random.Generator, n: int) -> FloatArray:
        """Starts about the posture, so that the turns about the tool axis differ too."""
        other = self.kinematics.random_readings(rng, n)
        return self.posture + 0.25 * (other - self.posture)

    def _out_of_reach(
        self, visits: Visits, row: int, answer: Postures, k: int, where: str
    ) -> JobError:
        distance, angle = 1e3 * answer.distance[k], np.degrees(answer.angle[k])
        return JobError(
            f"{visits.what(row)} out of the arm's reach "
            f"(closest: {distance:.3g} mm and {angle:.3g} deg away)",
            "a pose within reach and joint limits",
            file=self.spec.path,
            line=visits.line,
            where=f"{where}.{visits.name}",
            hint="move it or turn it",
        )

    def _too_few(self, plan: SetSpec, label: str, point: PoseSpec, count: int) -> JobError:
        return JobError(
            f"{count} directions within reach of point {label!r}",
            f"{plan.directions} within {np.degrees(plan.cone):.3g} deg of the axis",
            file=self.spec.path,
            line=point.line,
            where=f"sets.{plan.name}.points.{label}",
            hint="move the point, or ask for fewer directions or a wider cone",
        )


def _seated(
    label: str, pose: PoseSpec, landmarks: Sequence[Landmark], posture: FloatArray
) -> Visits:
    """Each landmark of a placement once, to be searched from one posture."""
    n = len(landmarks)
    position = np.array([mark.position for mark in landmarks]) @ pose.rotation.T + pose.position
    seats = np.array([np.eye(3) if mark.rotation is None else mark.rotation for mark in landmarks])
    return Visits(
        label,
        {"landmark": [mark.name for mark in landmarks]},
        Targets(position, pose.rotation @ seats),
        np.array([mark.rotation is not None for mark in landmarks]),
        np.tile(posture, (n, 1)),
        pose.line,
    )


def _cone_targets(plan: SetSpec, point: PoseSpec, rng: np.random.Generator) -> Targets:
    """Poses at the point whose z axes are uniform over the cone, as many as are wanted."""
    n = plan.directions
    height = rng.uniform(np.cos(plan.cone), 1.0, n)
    around = rng.uniform(-np.pi, np.pi, n)
    radius = np.sqrt(1 - height**2)
    z = np.stack([radius * np.cos(around), radius * np.sin(around), height], axis=1)
    axis = _DOWN if plan.axis is None else plan.axis
    rotation = _turning_z_to(axis) @ np.array([_turning_z_to(each) for each in z])
    return Targets(np.tile(point.position, (n, 1)), rotation, "axis")


def _turning_z_to(axis: FloatArray) -> FloatArray:
    """A rotation whose third column is the unit vector ``axis``."""
    sine = float(np.hypot(axis[0], axis[1]))
    angle = np.arctan2(sine, axis[2])
    direction = np.array([-axis[1], axis[0], 0.0]) / sine if sine > 0 else np.array([1.0, 0.0, 0.0])
    return rotation_from_vector(angle * direction)
