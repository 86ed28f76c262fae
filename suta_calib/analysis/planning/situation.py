"""Where the planner starts: the present data, the arm as far as it is known, and the noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from suta_calib.analysis.planning.candidates import Candidate, Placement, Posture, TouchPoint
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import register_points
from suta_calib.measurements import Artefact, Samples
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.inverse_kinematics import InverseKinematics
from suta_calib.solver.problem import DEFAULT_SIGMA, PLAIN_SIGMA, Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms import ArmPoses, Setup, Term, first_kind
from suta_calib.trust.repeats import LACKING, lack_of_fit


@dataclass(frozen=True, eq=False)
class Situation(Displayable):
    """The present data at the parameters they give.

    Attributes:
        problem: terms and parameters.
        x: (n,) where everything is linearised: the solution, or nominal where there is none.
        sigmas: noise level of each block of the problem, m or rad per component.
        solved: whether x is a solution and ``sigmas`` are what its residuals show.
        trouble: why a fit of the data may not be used; empty where it may, or none was possible.
        lacking: how many times as large residuals are as repeats, or what is stated, scatter, where
            the model lacks something: every ± that is planned is wider by it. One where it lacks
            nothing.
        chain: of several chains of a robot the one that is looked at.
    """

    problem: Problem
    x: FloatArray
    sigmas: tuple[float, ...]
    solved: bool
    trouble: str = ""
    lacking: float = 1.0
    chain: str = ""

    @classmethod
    def of(
        cls,
        problem: Problem,
        solution: Solution | None = None,
        trouble: str = "",
        chain: str = "",
    ) -> Situation:
        """From a problem and, if the data could be fitted, its solution.

        Args:
            problem: the present data.
            solution: of it.
            trouble: why the solution must not be used, beside that it did not converge.
            chain: as of the attribute.

        Raises:
            JobError: the terms look at no arm.
            ParameterError: there are several chains, and this is none of them.
        """
        if problem.arm is None:
            raise JobError("observations without an arm", "samples with joint readings")
        problem.arm.chosen(chain)
        if solution is not None and not solution.converged:
            trouble = str(solution.sentence)
        if solution is None or trouble:
            sigmas = tuple(problem.assumed_sigmas())
            return cls(problem, problem.start(), sigmas, False, trouble, chain=chain)
        lacking = _lacking(solution)
        return cls(problem, solution.x, solution.noise, True, lacking=lacking, chain=chain)

    @property
    def arm(self) -> ArmModel:
        """The arm that is looked at."""
        assert self.problem.arm is not None
        return self.problem.arm.chosen(self.chain)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms over it."""
        arm = self.arm
        return tuple(term for term in self.problem.terms if over(term, arm))

    @cached_property
    def values(self) -> dict[str, float]:
        """Of all parameters by name, the terms' own among them."""
        return self.problem.values(self.x)

    @cached_property
    def kinematics(self) -> InverseKinematics:
        """Inverse kinematics of the arm at x."""
        return InverseKinematics(self.arm.at(self.values), {})

    @property
    def samples(self) -> int:
        """Number of measured poses."""
        return sum(len(term.poses) for term in self.terms)

    @cached_property
    def readings(self) -> FloatArray:
        """(samples, joints) of all terms."""
        return readings_of(self.problem, self.arm)

    @cached_property
    def tips(self) -> tuple[FloatArray, FloatArray]:
        """Rotations (samples, 3, 3) and positions (samples, 3) of the tip at `readings`, m."""
        return self.arm.forward(self.readings, self.values)

    @property
    def touching(self) -> Term | None:
        """The first term that touches an artefact."""
        return next((t for t in self.terms if t.touched is not None), None)

    @property
    def artefact(self) -> Artefact | None:
        """What is put down at a placement."""
        return None if self.touching is None else self.touching.touched

    @property
    def sighted(self) -> Term | None:
        """The first term of an instrument or a camera."""
        return next((t for t in self.terms if t.medium != "touch"), None)

    def in_sight(self, readings: FloatArray) -> BoolArray:
        """(n,) whether the instrument or the camera sees anything at readings (n, joints)."""
        if self.sighted is None or self.sighted.chance == 1.0:
            return np.ones(len(readings), dtype=np.bool_)
        poses = ArmPoses(self.arm, Samples.from_arrays(self.arm.joints, readings))
        return self.sighted.observed(self.values, poses).in_sight

    @property
    def places(self) -> Term | type[Term]:
        """The first term that touches places without an artefact, or the kind that would."""
        touching = (t for t in self.terms if t.medium == "touch" and t.touched is None)
        return next(touching, None) or first_kind(artefact=False)

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
        term, artefact = self.touching, self.artefact
        if term is None or artefact is None:
            return ()
        labels = term.poses.samples.labels
        certified = artefact.position_of(labels["landmark"])
        _, position = term.poses.at(self.values)
        placements = []
        for name in dict.fromkeys(map(str, labels["placement"])):
            rows = labels["placement"] == name
            R, p = register_points(certified[rows], position[rows])
            placements.append(Placement(name, p, R))
        return tuple(placements)

    @property
    def labels(self) -> frozenset[str]:
        """Names of placements and points that are taken."""
        used = [t.poses.samples.labels[t.place] for t in self.problem.terms if t.place]
        return frozenset(str(name) for column in used for name in column)

    def term(self, candidate: Candidate) -> Term:
        """The candidate as observations that meet the present arm exactly, gone through once."""
        q, n, place = candidate.q, len(candidate.q), candidate.place
        if isinstance(place, Posture):
            return self._sighted_in(q)
        if isinstance(place, TouchPoint):
            kind = self.places
            settings = kind.settings if isinstance(kind, Term) else {}
            tips = self.arm.forward(q, self.values)[1]
            numbers = kind.measured(place.position, tips, settings)
            poses = self._poses(q, {kind.place: [candidate.name] * n}, numbers)
            return kind.over_poses(poses) if isinstance(kind, Term) else kind.over(poses, Setup())
        assert self.touching is not None
        labels = {"placement": [candidate.name] * n, "repeat": ["1"] * n}
        return self.touching.over_poses(
            self._poses(q, {**labels, "landmark": list(candidate.marks)})
        )

    def _poses(
        self,
        q: FloatArray,
        labels: Mapping[str, list[str]],
        numbers: Mapping[str, FloatArray] = MappingProxyType({}),
    ) -> ArmPoses:
        samples = Samples.from_arrays(self.arm.joints, q, labels=labels, numbers=numbers)
        return ArmPoses(self.arm, samples)

    def _sighted_in(self, q: FloatArray) -> Term:
        """What the instrument or the camera would report in these postures, of every mark."""
        assert self.sighted is not None
        present, mark = self.sighted.poses.samples, self.sighted.mark
        marks = list(dict.fromkeys(present.labels.get(mark, np.array([""])).tolist()))
        labels = {mark: marks} if self.sighted.marked else {}
        poses = self._poses(np.repeat(q, len(marks), axis=0), labels)
        ideal = self.sighted.observed(self.values, poses)
        samples = replace(
            poses.samples,
            position=None if present.position is None else ideal.position,
            rotation=None if present.rotation is None else ideal.rotation,
            pixels=ideal.pixels,
            numbers=ideal.numbers,
        )
        return self.sighted.over_poses(ArmPoses(self.arm, samples))

    def noise(self, term: Term) -> list[float]:
        """Noise level of each block of a new term: that of its kind, or of the same hand."""
        by_kind: dict[tuple[str, str], float] = {}
        # Of one component of a touch: a distance has those of two.
        touch: list[float] = []
        blocks = [(fitted, block) for fitted in self.problem.terms for block in fitted.blocks]
        for (fitted, block), sigma in zip(blocks, self.sigmas, strict=True):
            by_kind.setdefault((fitted.kind, block.name), sigma)
            touch += [sigma / fitted.noise_factor] if block.unit == "m" else []
        other = {"m": [*touch, DEFAULT_SIGMA["m"]][0], "rad": DEFAULT_SIGMA["rad"]}
        return [
            by_kind.get((term.kind, block.name), other.get(block.unit, PLAIN_SIGMA))
            for block in term.blocks
        ]


def over(term: Term, arm: ArmModel) -> bool:
    """Whether a term's poses are those of this chain."""
    return isinstance(term.poses, ArmPoses) and term.poses.arm is arm


def readings_of(problem: Problem, arm: ArmModel) -> FloatArray:
    """(samples, joints) of all terms over a chain; of all, where none is."""
    terms = [term for term in problem.terms if over(term, arm)] or problem.terms
    return np.vstack([term.poses.samples.q for term in terms])


def _lacking(solution: Solution) -> float:
    """How many times the scatter of repeats, or what is stated, residuals are; one if hardly more.

    What a model lacks is the same in all rows of a posture and alike in neighbouring ones: more
    rows do not average it out as they do noise.
    """
    ratios = [fit.ratio for fit in lack_of_fit(solution)]
    ratios += [
        noise / block.noise.sigma
        for block, noise in zip(solution.problem.blocks, solution.noise, strict=True)
        if block.noise.sigma and block.noise.fixed
    ]
    return max((ratio for ratio in ratios if ratio > LACKING), default=1.0)
