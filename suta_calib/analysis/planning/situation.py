"""Where the planner starts: the present data, the arm as far as it is known, and the noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from suta_calib.analysis.planning.candidates import Candidate, Placement
from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import register_points, rotation_from_vector
from suta_calib.measurements import Artefact, Samples
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.inverse_kinematics import InverseKinematics
from suta_calib.solver.problem import DEFAULT_SIGMA, Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms import KINDS, ArmPoses, Setup, Term
from suta_calib.terms.landmark import TouchedLandmark
from suta_calib.terms.pairwise_distance import PairwiseDistance

# Kinds whose unknowns all samples share, wherever they are taken.
SEEN = ("tracked_point", "hand_eye")


@dataclass(frozen=True, eq=False)
class Situation:
    """The present data at the parameters they give.

    Attributes:
        problem: terms and parameters.
        x: (n,) where everything is linearised: the solution, or nominal where there is none.
        sigmas: noise level of each block of the problem, m or rad per component.
        solved: whether x is a solution and ``sigmas`` are what its residuals show.
        trouble: why a fit of the data may not be used; empty where it may, or none was possible.
    """

    problem: Problem
    x: FloatArray
    sigmas: tuple[float, ...]
    solved: bool
    trouble: str = ""

    @classmethod
    def of(cls, problem: Problem, solution: Solution | None = None) -> Situation:
        """From a problem and, if the data could be fitted, its solution.

        Raises:
            JobError: the terms look at no arm.
        """
        if problem.arm is None:
            raise JobError("observations without an arm", "samples with joint readings")
        if solution is None or not solution.converged:
            trouble = "" if solution is None else str(solution.sentence)
            return cls(problem, problem.start(), tuple(problem.assumed_sigmas()), False, trouble)
        return cls(problem, solution.x, solution.noise, True)

    @property
    def arm(self) -> ArmModel:
        """The arm that all terms share."""
        assert self.problem.arm is not None
        return self.problem.arm

    @cached_property
    def values(self) -> dict[str, float]:
        """Parameter values by name, the terms' own among them."""
        return self.problem.values(self.x)

    @cached_property
    def kinematics(self) -> InverseKinematics:
        """Inverse kinematics of the arm at x."""
        return InverseKinematics(self.arm.at(self.values), {})

    @property
    def samples(self) -> int:
        """Number of measured poses."""
        return sum(len(term.poses) for term in self.problem.terms)

    @cached_property
    def readings(self) -> FloatArray:
        """(samples, joints) of all terms."""
        return np.vstack([term.poses.samples.q for term in self.problem.terms])

    @cached_property
    def tips(self) -> tuple[FloatArray, FloatArray]:
        """Rotations (samples, 3, 3) and positions (samples, 3) of the tip at `readings`, m."""
        return self.arm.forward(self.readings, self.values)

    @property
    def touching(self) -> PairwiseDistance | TouchedLandmark | None:
        """The first term that touches an artefact."""
        found = [t for t in self.problem.terms if isinstance(t, PairwiseDistance | TouchedLandmark)]
        return found[0] if found else None

    @property
    def artefact(self) -> Artefact | None:
        """What is put down at a placement."""
        return None if self.touching is None else self.touching.artefact

    @property
    def seen(self) -> Term | None:
        """The first term of an instrument or a camera."""
        return next((t for t in self.problem.terms if t.kind in SEEN), None)

    @cached_property
    def repeats(self) -> int:
        """How often a placement was gone through, typically; 1 where nothing was."""
        if self.touching is None:
            return 1
        labels = self.touching.poses.samples.labels
        sets = set(zip(labels["placement"], labels["repeat"], strict=True))
        return max(1, round(len(sets) / len({placement for placement, _ in sets})))

    @cached_property
    def placements(self) -> tuple[Placement, ...]:
        """Where the artefact stood, by registration to the touches."""
        term = self.touching
        if term is None:
            return ()
        labels = term.poses.samples.labels
        certified = term.artefact.position_of(labels["landmark"])
        _, position = term.poses.at(self.values)
        found = []
        for name in dict.fromkeys(map(str, labels["placement"])):
            rows = labels["placement"] == name
            R, p = register_points(certified[rows], position[rows])
            found.append(Placement(name, p, R))
        return tuple(found)

    @property
    def labels(self) -> frozenset[str]:
        """Names of placements and points that are taken."""
        terms = [term.poses.samples.labels for term in self.problem.terms]
        used = [labels[key] for labels in terms for key in ("placement", "point") if key in labels]
        return frozenset(str(name) for column in used for name in column)

    def term(self, candidate: Candidate) -> Term:
        """The candidate as observations that meet the present arm exactly, gone through once."""
        q, n = candidate.q, len(candidate.q)
        if candidate.place.kind == "pose":
            return self._seen_from(q)
        if candidate.place.kind == "point":
            samples = Samples.from_arrays(
                self.arm.joints, q, labels={"point": [candidate.name] * n}
            )
            return KINDS["fixed_point"].over(ArmPoses(self.arm, samples), Setup())
        labels = {
            "placement": [candidate.name] * n,
            "repeat": ["1"] * n,
            "landmark": list(candidate.marks),
        }
        assert self.touching is not None
        samples = Samples.from_arrays(self.arm.joints, q, labels=labels)
        return self.touching.over_poses(ArmPoses(self.arm, samples))

    def noise(self, term: Term) -> list[float]:
        """Noise level of each block of a new term: that of its kind, or of the same hand."""
        known = self._levels()
        found = []
        for block in term.blocks:
            touch = known.get(("touch", "m"), DEFAULT_SIGMA["m"])
            other = touch if block.unit == "m" else DEFAULT_SIGMA["rad"]
            found.append(known.get((term.kind, block.name), other))
        return found

    def _levels(self) -> dict[tuple[str, str], float]:
        """By kind and block; and of one component of a touch: a distance has those of two."""
        levels: dict[tuple[str, str], float] = {}
        k = 0
        for term in self.problem.terms:
            for block in term.blocks:
                levels.setdefault((term.kind, block.name), self.sigmas[k])
                if block.unit == "m":
                    share = math.sqrt(2.0) if term.kind == "pairwise_distance" else 1.0
                    levels.setdefault(("touch", "m"), self.sigmas[k] / share)
                k += 1
        return levels

    def _seen_from(self, q: FloatArray) -> Term:
        """What the instrument or the camera would report in these postures."""
        assert self.seen is not None
        rotation, position = _expected(self.seen, *self.arm.forward(q, self.values), self.values)
        oriented = self.seen.poses.samples.rotation is not None
        samples = Samples.from_arrays(
            self.arm.joints, q, position=position, rotation=rotation if oriented else None
        )
        return self.seen.over_poses(ArmPoses(self.arm, samples))


def _expected(
    term: Term, rotation: FloatArray, position: FloatArray, values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Measurements that agree with the parameters: of the tip, or of the target in the camera."""

    def pose(names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        six = np.array([values[name] for name in names])
        return rotation_from_vector(six[3:]), six[:3]

    own = [p.name for p in term.own]
    R, p = pose(own[:6])
    if term.kind == "tracked_point":
        return R @ rotation, position @ R.T + p
    target_R, target_p = pose(own[6:])
    eye_R, eye_p = rotation @ R, rotation @ p + position
    back = np.swapaxes(eye_R, 1, 2)
    return back @ target_R, np.einsum("nij,nj->ni", back, target_p - eye_p)
