"""What data as rich as they can be would tell: kinds of observation all over an arm's reach.

Random postures over the whole range of every joint, and what is touched anywhere within reach. A
direction of the parameters that such data of the same kinds leave open is redundant: no data of
these kinds could tell it. Advice is tested in the same way: following it must tell the direction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import random_rotations, skew
from suta_calib.measurements import Artefact, Landmark, Samples
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.solver.identifiability import WEAK, schur_complement
from suta_calib.solver.information import whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.terms import ArmPoses, Noise, Observed, PoseSource, Seating, Setup, Term
from suta_calib.terms.block import LEARNT
from suta_calib.trust.tip import STILL, Sensitivity, sensitivity

# Places that are touched, and rows at each of them.
PLACES: Final = 8
ROWS: Final = 12
MARKS: Final = 6
# How far the touches of one place are apart at first, m: the size of an artefact.
EXTENT: Final = 0.1
# What an angle is worth beside a length, m: the size of a tool or an artefact.
LEVER: Final = 0.25
# Information, relative to the largest, that so much data leaves only to what is null to rounding.
NULL: Final = 1e-10


@dataclass(frozen=True)
class Sort:
    """Observations that tell alike: a kind, and what it looks at.

    Attributes:
        kind: of observation.
        oriented: whether orientations are seen, or certified where an artefact is touched.
        marked: whether marks on the tip's link are seen in place of the tip.
        noise, angular_noise: scatter of lengths and of angles.
        seating: what the artefact's sockets leave open, or None.
        settings: the kind's own.
    """

    kind: type[Term]
    oriented: bool
    marked: bool = False
    noise: Noise = LEARNT
    angular_noise: Noise = LEARNT
    seating: Seating | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, term: Term) -> Sort:
        """What a term is."""
        angular = next((b.noise for b in term.blocks if b.unit == "rad"), None)
        noise = next((b.noise for b in term.blocks if b.unit != "rad"), LEARNT)
        oriented, seating = angular is not None, getattr(term, "seating", None)
        levels = noise, angular or LEARNT
        return cls(type(term), oriented, term.marked, *levels, seating, term.settings)


@dataclass(eq=False)
class _Exact:
    """A `Resimulation` without noise; ``reached`` says what the arm can touch, or the eye see."""

    kinematics: InverseKinematics
    random: np.random.Generator
    reached: BoolArray | None = None

    def touched(self, poses: PoseSource, target: FloatArray, sigma: float) -> PoseSource:
        targets = Targets(target, np.tile(np.eye(3), (len(target), 1, 1)), "position")
        solved = self.kinematics.solve(targets, poses.samples.q, self.random, starts=2)
        # From a target that a touch may be, m.
        self.reached = solved.distance < 1e-9
        return poses.with_samples(replace(poses.samples, q=solved.q))

    def observed(
        self, poses: PoseSource, ideal: Observed, noise: Mapping[str, float], relative: FloatArray
    ) -> PoseSource:
        if ideal.pixels is not None:
            return poses.with_samples(replace(poses.samples, pixels=ideal.pixels))
        if ideal.sighted is not None:
            self.reached = ideal.sighted
        again = replace(
            poses.samples,
            position=ideal.position,
            rotation=ideal.rotation if "rotation" in noise else None,
            numbers=ideal.numbers,
        )
        return poses.with_samples(again)

    def turned(self, rotation: FloatArray, sigma: float) -> FloatArray:
        return rotation


@dataclass(frozen=True, eq=False)
class _Reached:
    """A chain, and the same at the values in question: its kinematics have nothing unknown."""

    arm: ArmModel
    known: ArmModel

    @cached_property
    def kinematics(self) -> InverseKinematics:
        return InverseKinematics(self.known, {})

    def random_readings(self) -> FloatArray:
        return self.kinematics.random_readings(np.random.default_rng(0), PLACES * ROWS)


class RichData:
    """Data of any sorts over one arm, and what they tell of its free parameters.

    Matrices and directions are in units of what is plausible for each parameter.

    Args:
        problem: of an arm: which parameters are asked for.
        x: (n,) where to look.

    Attributes:
        names: of the arm's free parameters.
        unit: (n,) what is plausible for each, m or rad.
    """

    def __init__(self, problem: Problem, x: FloatArray) -> None:
        assert problem.arm is not None
        self._problem, self._own = problem, problem.values(x)
        self._arm, self._parameters = problem.arm, problem.arm_parameters
        self._free = np.flatnonzero([p.free for p in self._parameters.values()])
        self.names = [self._parameters.names[k] for k in self._free]
        self.unit = self._parameters.array("plausible")[self._free]
        self._values = {name: self._own[name] for name in self._parameters}
        # The same arm, whose kinematics then have nothing unknown, and cost little.
        self._reached = [_Reached(arm, arm.at(self._values)) for arm in problem.arm.arms]
        self._told: dict[tuple[type[Term], bool] | int, FloatArray] = {}

    def registered(self, direction: FloatArray) -> float:
        """How far the tip moves along a direction (n,), m per unit: RMS in postures all over.

        A rigid registration takes out what is common to all of them: zero where nothing is left,
        or the parts of the direction cancel.
        """
        return max(tip.moved(direction * self.unit) for tip in self._anywhere)

    @cached_property
    def _anywhere(self) -> list[Sensitivity]:
        """Of each chain's tip."""
        return [
            sensitivity(chain.arm, self._values, self.names, chain.random_readings())
            for chain in self._reached
        ]

    def tells(self, kind: type[Term], oriented: bool) -> FloatArray:
        """Information (n, n) that data of one sort add, with whatever they leave unknown."""
        if (kind, oriented) not in self._told:
            observed = self._observed([(Sort(kind, oriented), c) for c in self._reached])
            nothing = np.zeros((len(self.unit),) * 2)
            self._told[kind, oriented] = nothing if observed is None else observed[1]
        return self._told[kind, oriented]

    def varied(self, joint: str) -> FloatArray:
        """Information (n, n) of the postures visited, with one joint anywhere in its range."""
        k = self._arm.joints.index(joint)
        if k not in self._told:
            random, terms = np.random.default_rng(k), list[Term]()
            for term in self._problem.terms:
                samples, chain = term.poses.samples, self._chain_of(term)
                q = samples.q.copy()
                q[:, k] = chain.kinematics.random_readings(random, len(q))[:, k]
                moved = term.over_poses(ArmPoses(chain.known, replace(samples, q=q)))
                terms.append(self._ideal(moved, chain, random, self._own))
            _, self._told[k] = self._information(terms, self._own)
        return self._told[k]

    def _chain_of(self, term: Term) -> _Reached:
        assert isinstance(term.poses, ArmPoses)
        arm = term.poses.arm
        return next(chain for chain in self._reached if chain.arm is arm)

    @cached_property
    def _same(self) -> tuple[FloatArray, FloatArray]:
        """Of the problem's own sorts: redundant directions, and information.

        Open is what even rich data tell so badly that it would be held.
        """
        pairs = [(Sort.of(term), self._chain_of(term)) for term in self._problem.terms]
        sorts = [sort for sort, _ in pairs]
        observed = self._observed([pair for k, pair in enumerate(pairs) if pair not in pairs[:k]])
        if observed is None:
            return np.zeros((len(self.unit), 0)), np.zeros((len(self.unit),) * 2)
        problem, information = observed
        prior = self._problem.prior_precision()[self._free] * self.unit**2
        values, vectors = np.linalg.eigh(information + np.diag(prior))
        null = vectors[:, values <= max(NULL * values[-1], WEAK**-2)]
        table = problem.evaluation.table
        motion = table.velocity[:, self._free].reshape(-1, 6, len(self.unit)) * self.unit
        rotation = np.swapaxes(table.rotation.reshape(-1, 3, 3), 1, 2)
        one, zero = np.broadcast_to(np.eye(3), rotation.shape), np.zeros(rotation.shape)
        linear = np.concatenate([one, -skew(table.position), rotation, zero], axis=2)
        rigid = np.concatenate(
            [linear, np.concatenate([zero, one, zero, rotation], axis=2)], axis=1
        )
        # Where nothing looks at the tip's orientation, any turn of it is a convention.
        lever = LEVER * any(sort.oriented for sort in sorts)
        moved, rigid = (
            (matrix * np.repeat([1.0, lever], 3)[:, None]).reshape(6 * len(matrix), matrix.shape[2])
            for matrix in (motion @ null, rigid)
        )
        moved = moved - rigid @ (np.linalg.pinv(rigid) @ moved)
        _, size, turn = np.linalg.svd(moved, full_matrices=False)
        directions = null @ turn.T
        parts = np.linalg.norm(motion, axis=(0, 1)) @ np.abs(directions)
        return directions[:, size <= STILL * parts], information

    @property
    def redundant(self) -> FloatArray:
        """Directions (n, k) that no data of the problem's sorts could tell, and that do no harm.

        They draw frames elsewhere: the base's, the tip's, or one between two joints. What moves
        the tip against the base otherwise, such as the scale of an arm that never met a length,
        is no convention.
        """
        return self._same[0]

    @property
    def same(self) -> FloatArray:
        """Information (n, n) of the problem's own sorts."""
        return self._same[1]

    def _observed(
        self, sorts: Sequence[tuple[Sort, _Reached]]
    ) -> tuple[Problem, FloatArray] | None:
        """Rich data of sorts, each by a chain; None where it can neither touch nor see any."""
        values = dict(self._values)
        terms = []
        for k, (sort, chain) in enumerate(sorts):
            try:
                term, own_values = self._observations(sort, f"rich {k}", chain)
            except SamplesError:
                # No posture of this arm shows such a kind anything, as a board to its camera.
                continue
            terms += [term] if len(term.poses) else []
            values |= own_values
        return self._information(terms, values) if terms else None

    def _information(
        self, terms: Sequence[Term], values: Mapping[str, float]
    ) -> tuple[Problem, FloatArray]:
        problem = Problem(terms, self._parameters)
        x = np.array([values[name] for name in problem.names])
        rows = whitened_rows(problem, x, problem.assumed_sigmas())
        unit = problem.parameters.array("plausible")
        curvature = sum((r.jacobian * unit).T @ (r.jacobian * unit) for r in rows)
        arm = problem.arm_count
        free = np.array([p.free for p in problem.parameters.values()], dtype=bool)
        prior = problem.prior_precision() * unit**2 * (np.arange(len(unit)) >= arm)
        own_unknowns = np.flatnonzero(free[arm:]) + arm
        (reduced,) = schur_complement([np.asarray(curvature)], prior, self._free, own_unknowns)
        size, vectors = np.linalg.eigh(reduced)
        # If the own unknowns cancel everything, the rest is rounding.
        size[size < NULL * np.diag(curvature)[self._free].max(initial=0.0)] = 0.0
        return problem, np.asarray((vectors * size) @ vectors.T)

    def observations(self, sort: Sort, label: str, chain: int = 0) -> tuple[Term, dict[str, float]]:
        """Rich data of one sort, by one of the chains: without noise, and what is true of them."""
        return self._observations(sort, label, self._reached[chain])

    def _observations(
        self, sort: Sort, label: str, chain: _Reached
    ) -> tuple[Term, dict[str, float]]:
        kind, random = sort.kind, np.random.default_rng(0)
        touches = kind.medium == "touch"
        # So many that enough of them are in sight.
        n = math.ceil(PLACES * ROWS / kind.chance)
        place, row = np.divmod(np.arange(n) % (PLACES * ROWS), ROWS)
        artefact = _artefact(oriented=sort.oriented)
        columns = (*kind.columns.labels, *([kind.mark] if sort.marked else []))
        labels = {name: [f"{label}.{k}" for k in place] for name in columns}
        if on_body := kind.marks_in(sort.settings):
            labels[kind.mark] = [on_body[k % len(on_body)] for k in range(n)]
        if kind.needs_artefact:
            repeat, mark = np.divmod(row, len(artefact.landmarks))
            labels |= {"repeat": [str(k) for k in repeat], "landmark": [f"L{k}" for k in mark]}
        q = chain.kinematics.random_readings(random, n)
        samples = Samples.from_arrays(
            chain.arm.joints,
            q,
            labels=labels,
            position=np.zeros((n, 3)) if kind.columns.position else None,
            rotation=np.tile(np.eye(3), (n, 1, 1))
            if sort.oriented and kind.columns.orientation != "none"
            else None,
            numbers={} if touches else {c.name: np.zeros(n) for c in kind.columns.numbers},
        )
        poses: PoseSource = ArmPoses(chain.known, samples)
        if touches:
            _, centre = chain.known.forward(q[:PLACES])
            about = centre[place] + random.uniform(-EXTENT, EXTENT, (n, 3))
            poses = _Exact(chain.kinematics, random).touched(poses, about, 0.0)
            numbers = kind.measured(centre[place], poses.at({})[1], sort.settings)
            poses = poses.with_samples(replace(poses.samples, numbers=numbers))
        noise = sort.noise, sort.angular_noise
        term = kind.over(poses, Setup(artefact, *noise, label, sort.seating, sort.settings))
        # A ball is no larger than balls are.
        anywhere = {
            p.name: min(1.0, 2.0 * p.plausible) * random.uniform(-0.5, 0.5)
            for p in term.own_parameters
        }
        own_values = term.start_values({}) if touches else anywhere
        return self._ideal(term, chain, random, self._values | own_values), own_values

    def _ideal(
        self,
        term: Term,
        chain: _Reached,
        random: np.random.Generator,
        values: Mapping[str, float],
    ) -> Term:
        """The term over ideal measurements near the given postures, of the arm in question."""
        exact = _Exact(chain.kinematics, random)
        ideal = term.resimulated(values, [0.0] * len(term.blocks), exact)
        if exact.reached is not None:
            ideal = ideal.take(np.flatnonzero(exact.reached)[: PLACES * ROWS])
        pixels = ideal.poses.samples.pixels
        if pixels is not None:
            in_sight = np.flatnonzero(np.isfinite(pixels).any(axis=(1, 2)))
            ideal = ideal.take(in_sight[: PLACES * ROWS])
        return ideal.over_poses(ArmPoses(chain.arm, ideal.poses.samples))


def _artefact(*, oriented: bool) -> Artefact:
    """Six landmarks all over a block, whose seats point anywhere."""
    random = np.random.default_rng(0)
    seats = random_rotations(random, MARKS)
    places = random.uniform(-EXTENT, EXTENT, (MARKS, 3))
    marks = [
        Landmark(f"L{k}", p, R if oriented else None)
        for k, (R, p) in enumerate(zip(seats, places, strict=True))
    ]
    return Artefact("rich", {mark.name: mark for mark in marks})
