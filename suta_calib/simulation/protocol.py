"""The places that the tip visits, and the true poses of things outside the arm."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_vector, vector_turning_z_to
from suta_calib.measurements import Artefact, Samples
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Matching, Targets
from suta_calib.simulation.noise import stream
from suta_calib.simulation.schema import PoseSpec, SetSpec, SimulationSpec
from suta_calib.terms import ArmPoses, Setup, Term
from suta_calib.terms.external_frame import ExternalFrame
from suta_calib.terms.given_pose import GivenPose
from suta_calib.terms.landmark import seated
from suta_calib.terms.several_chains import over_chain
from suta_calib.units import deg, mm


@dataclass(frozen=True, eq=False)
class Visits:
    """The touches of one file, in order, and a posture for each."""

    name: str  # of the placement or point, and of the file
    labels: dict[str, list[str]]  # label columns, each (n,)
    targets: Targets  # true poses of the tip before any noise, n of them
    oriented: BoolArray  # (n,) whether what is touched fixes the tip's orientation too
    start: FloatArray  # (n, joints) readings that reach the targets
    line: int | None = None  # where the placement or point stands in the simulation's file
    # What is measured beside the touches, each (n,), in SI, before any noise.
    numbers: dict[str, FloatArray] = field(default_factory=dict)

    def what(self, row: int) -> str:
        """Name of the touched place, for messages."""
        if "landmark" in self.labels:
            return f"landmark {self.labels['landmark'][row]!r} of placement {self.name!r}"
        (place,) = self.labels
        return f"{place} {self.name!r}"


@dataclass(frozen=True, eq=False)
class Visitor:
    """Finds postures of the true arm for the places that it visits."""

    spec: SimulationSpec  # the whole simulation, for its messages
    kinematics: InverseKinematics  # of the true arm
    posture: FloatArray  # (joints,) readings from which the search starts
    seed: int  # of the starts and directions

    def artefact(self, plan: SetSpec, label: str, pose: PoseSpec, truth: Artefact) -> Visits:
        """All landmarks of one placement, ``plan.repeats`` times."""
        landmarks = list(truth.landmarks.values())
        names = [mark.name for mark in landmarks]
        sits = seated(truth, names, pose.rotation, pose.position, plan.seating[:2], plan.seating[2])
        assert sits.rotation is not None
        targets = Targets(sits.place, sits.rotation)
        oriented = np.array([mark.rotation is not None for mark in landmarks])
        # How an arm of few joints sits matters only to a kind that looks at it.
        oriented &= plan.term.has_angles or self.kinematics.attainable["pose"]
        first = np.tile(self.posture, (len(names), 1))
        once = Visits(label, {"landmark": names}, targets, oriented, first, pose.line)
        rng = stream(self.seed, plan.name, label, "postures")
        start = self.reach(plan, once, targets, first, rng)
        n, repeats = len(landmarks), plan.repeats
        labels = {
            "placement": [label] * (n * repeats),
            "repeat": [str(k + 1) for k in range(repeats) for _ in range(n)],
            "landmark": names * repeats,
        }
        rows = np.tile(np.arange(n), repeats)
        return Visits(label, labels, targets.take(rows), oriented[rows], start[rows], pose.line)

    def place(self, plan: SetSpec, label: str, pose: PoseSpec) -> Visits:
        """A point, or whatever the kind touches, from so many directions of the cone."""
        # A direction that few starts reach is not worth more: another one is drawn.
        starts_per_direction = 6
        most_batches = 20
        rng = stream(self.seed, plan.name, label, "postures")
        spread = stream(self.seed, plan.name, label, "places")
        axis = -pose.rotation[:, 2] if plan.axis is None else plan.axis
        turned = rotation_from_vector(vector_turning_z_to(axis))
        # A tip that is held keeps its pose: what differs is the posture.
        held = plan.term.has_angles
        turns = np.tile(pose.rotation if held else np.eye(3), (plan.directions, 1, 1))
        q, touched = np.empty((0, len(self.posture))), np.empty((0, 3))
        for batch in range(most_batches):
            where = spread.random((plan.directions, 2))
            position = plan.term.touches(pose.rotation, pose.position, where, plan.settings)
            # Uniform over the cone: the height on a sphere is uniform.
            height = rng.uniform(np.cos(plan.cone), 1.0, plan.directions)
            around = rng.uniform(-np.pi, np.pi, plan.directions)
            radius = np.sqrt(1 - height**2)
            z = np.stack([radius * np.cos(around), radius * np.sin(around), height], axis=1)
            spread_out = turned @ rotation_from_vector(vector_turning_z_to(z))
            # An arm of few joints comes as it can, not from the cone.
            directed = Targets(position, spread_out, self.kinematics.most("axis"))
            # About the posture, so that the turns about the tool axis differ too.
            other = self.kinematics.random_readings(rng, len(directed))
            starts = self.posture + 0.25 * (other - self.posture)
            if held:
                directed, starts = Targets(position, turns, self.kinematics.most("pose")), other
            answer = self.kinematics.solve(directed, starts, rng, starts_per_direction)
            q = np.concatenate([q, answer.q[answer.reached]])
            touched = np.concatenate([touched, position[answer.reached]])
            # A place that none of so many batches reaches is out of reach.
            if len(q) >= plan.directions or (batch == 4 and not len(q)):
                break
        n = plan.directions
        if len(q) < n:
            raise self._refused(
                plan,
                label,
                pose.line,
                f"{len(q)} directions within reach of {plan.term.place} {label!r}",
                f"{n} within {deg(plan.cone):.3g} deg of the axis",
                self._remedy("position")
                if not self.kinematics.attainable["position"]
                else f"move the {plan.term.place}, or ask for fewer directions or a wider cone",
            )
        targets = Targets(touched[:n], turns)
        # Whatever the direction, the place is touched: it alone has to be met again with noise.
        oriented = np.full(n, held)
        numbers = plan.term.measured(pose.position, touched[:n], plan.settings)
        labels = {plan.term.place: [label] * n}
        return Visits(label, labels, targets, oriented, q[:n], pose.line, numbers)

    def reach(
        self,
        plan: SetSpec,
        visits: Visits,
        targets: Targets,
        start: FloatArray,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Readings (n, joints) that reach every target; ``visits`` says what each of them is."""
        q = np.empty_like(start)
        kinds: tuple[tuple[Matching, BoolArray], ...] = (
            ("pose", visits.oriented),
            ("position", ~visits.oriented),
        )
        for matching, chosen in kinds:
            rows = np.flatnonzero(chosen)
            if not len(rows):
                continue
            subset = Targets(targets.position[rows], targets.rotation[rows], matching)
            answer = self.kinematics.solve(subset, start[rows], rng)
            for k in np.flatnonzero(~answer.reached):
                distance, angle = mm(answer.distance[k]), deg(answer.angle[k])
                raise self._refused(
                    plan,
                    visits.name,
                    visits.line,
                    f"{visits.what(int(rows[k]))} out of the arm's reach (closest: "
                    f"{distance:.3g} mm and {angle:.3g} deg away)",
                    "a pose within reach and joint limits",
                    self._remedy(matching),
                )
            q[rows] = answer.q
        return q

    def _remedy(self, matching: Matching) -> str:
        """What to do about a target out of reach."""
        attainable, joints = self.kinematics.attainable, len(self.kinematics.arm.joints)
        if not attainable["position"]:
            return (
                f"an arm of {joints} joints in this arrangement cannot reach most positions: "
                "simulate an instrument that sees it, instead of touching something"
            )
        if not attainable[matching]:
            return (
                f"an arm of {joints} joints in this arrangement cannot reach every orientation: "
                "remove rotation_rpy_deg from the landmarks"
            )
        return "move or turn it"

    def _refused(
        self, plan: SetSpec, label: str, line: int | None, problem: str, expected: str, hint: str
    ) -> JobError:
        """Error about a place of a set, to be raised by the caller."""
        where = f"sets.{plan.name}.{plan.places_key}.{label}"
        return JobError(problem, expected, file=self.spec.path, line=line, where=where, hint=hint)


@dataclass(frozen=True, eq=False)
class TruePose:
    """A frame, or a point, outside the arm."""

    frame: ExternalFrame  # which
    rotation: FloatArray | None  # (3, 3) of ``T_within_what``; None for a point
    position: FloatArray  # (3,) m


def true_poses(
    plan: SetSpec,
    arm: ArmModel,
    samples: Samples,
    artefact: Artefact | None = None,
    laid_out: ArmModel | None = None,
) -> tuple[TruePose, ...]:
    """Of all whose pose a calibration with the samples, of all files of a set, has to find.

    They are called as they are beside other chains, where ``laid_out`` is the chain of a robot.
    """
    setup = Setup(artefact=artefact, settings=plan.settings)
    term = plan.term.over(ArmPoses(arm, samples), setup)
    values = own_values(plan, term)
    named = over_chain(term, laid_out or arm)
    return tuple(
        TruePose(frame, *alone.pose(values))
        for alone, frame in zip(term.outside, named.outside, strict=True)
    )


def own_values(plan: SetSpec, term: Term) -> dict[str, float]:
    """True values, m or rad, of the own unknowns; frames that are not stated coincide.

    An unknown that no key states is at its nominal value.
    """
    here = PoseSpec(np.eye(3), np.zeros(3))
    values = {p.name: p.nominal for p in term.unknowns}
    stated = {frame.key: plan.frames.get(frame.key, here) for frame in term.frames}
    there = {**plan.marks, **(plan.places if term.place_unknown else {})}
    for key, pose in {**stated, **there}.items():
        full = key in stated or term.mark or term.place_turns
        given = GivenPose(pose.position, pose.rotation if full else None)
        values |= {name: prior.value for name, prior in term.prior_from_pose(key, given).items()}
    return values
