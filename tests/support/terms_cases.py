"""Each kind of observation with a scene, a gauge and parameters to find."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from simulated import (
    DH_LENGTHS,
    Scene,
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    camera_scene,
    closed_loop_scene,
    contact_scene,
    dh_parameters,
    fixed_point_scene,
    gravity_scene,
    hand_eye_scene,
    line_scene,
    perturbed,
    placements,
    plane_scene,
    plane_view_scene,
    points_scene,
    profile_scene,
    range_scene,
    tracked_scene,
)

from suta_calib.model.arm import ArmModel
from suta_calib.solver.losses import huber_threshold
from suta_calib.solver.problem import Problem
from suta_calib.terms import KINDS, GivenPose, Noise, Term
from suta_calib.terms.sample_errors import HandError

GAUGE = {"joint_1.offset", "joint_2.z"}
SIGMA = Spread(position=1e-4, rotation=1e-3)
Make = Callable[[ArmModel, dict[str, float]], Scene]


@dataclass(frozen=True)
class Case:
    """A set-up of one kind, and what of the SUTA's thirteen parameters it cannot tell.

    Attributes:
        alone: how many of them it tells by themselves, at least. Of a closed loop all lengths hang
            on the one that is held; gravity tells no length.
    """

    kind: str
    make: Make
    unidentified: frozenset[str]

    @property
    def alone(self) -> int:
        return 4 if self.kind in ("closed_loop", "gravity") else 5


def over_artefact(kind: str, oriented: bool) -> Make:
    certified = artefact(8, oriented=oriented)
    return lambda arm, truth: artefact_scene(kind, arm, truth, certified, placements(4))


def case(kind: str, make: Make, *names: str) -> Case:
    return Case(kind, make, frozenset(GAUGE | set(names)))


# x y z (m) and turn (rad) in the tip.
TARGETS = ((0.05, 0.02, 0.03, 0.3, -0.1, 2.0), (-0.04, 0.03, -0.02, 0.0, 1.0, 0.0))
# Parallel pillars hide the tool's length; one point hides the scale, held by one of the lengths;
# a camera's unknown pose on the tip takes up whatever follows the last joint.
CASES = {
    "pairwise_distance": case(
        "pairwise_distance", over_artefact("pairwise_distance", False), "tip.y"
    ),
    "landmark": case("landmark", over_artefact("landmark", False), "tip.y"),
    "landmark with seats": case("landmark", over_artefact("landmark", True), "tip.y"),
    "fixed_point": case("fixed_point", fixed_point_scene, "joint_4.z"),
    "plane": case("plane", plane_scene, "joint_4.z"),
    "plane with a ball": case(
        "plane", lambda arm, truth: plane_scene(arm, truth, radius=0.02), "joint_4.z"
    ),
    "line": case("line", line_scene, "joint_4.z"),
    "range": case("range", lambda arm, truth: range_scene(arm, truth, measured=True)),
    "range of unknown radius": case(
        "range", lambda arm, truth: range_scene(arm, truth, measured=False), "joint_4.z"
    ),
    "contact with points": case(
        "contact", lambda arm, truth: contact_scene(arm, truth, distance=0.0), "joint_4.z"
    ),
    "contact with balls": case(
        "contact", lambda arm, truth: contact_scene(arm, truth, distance=0.25)
    ),
    "contact with planes": case(
        "contact",
        lambda arm, truth: contact_scene(arm, truth, distance=0.0, surface="plane"),
        "joint_4.z",
    ),
    "closed_loop": case(
        "closed_loop", closed_loop_scene, "joint_4.z", "joint_6.offset", "tip.y", "tip.z"
    ),
    "tracked_point": case("tracked_point", tracked_scene),
    "tracked_point with targets": case(
        "tracked_point",
        lambda arm, truth: tracked_scene(arm, truth, 20, targets=TARGETS),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "tracked_point with targets and orientation": case(
        "tracked_point",
        lambda arm, truth: tracked_scene(arm, truth, 20, oriented=True, targets=TARGETS[:1]),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "tracked_point with orientation": case(
        "tracked_point", lambda arm, truth: tracked_scene(arm, truth, oriented=True)
    ),
    "tracked_point that states its noise": case(
        "tracked_point", lambda arm, truth: tracked_scene(arm, truth, stated=True)
    ),
    # No length, no turn about the vertical, and nothing past the last joint.
    "gravity": case("gravity", gravity_scene, "joint_6.offset", *DH_LENGTHS),
    "hand_eye": case("hand_eye", hand_eye_scene, "joint_6.offset", "tip.y", "tip.z"),
    "camera_view": case("camera_view", camera_scene, "joint_6.offset", "tip.y", "tip.z"),
    "camera_view beside": case(
        "camera_view",
        lambda arm, truth: camera_scene(arm, truth, setup="eye-to-hand"),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "camera_view of a hand with play": case(
        "camera_view",
        lambda arm, truth: camera_scene(arm, truth, hand_error=HandError(2e-4, 5e-4)),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "points": case("points", points_scene, "joint_6.offset", "tip.y", "tip.z"),
    "points on the tip": case(
        "points",
        lambda arm, truth: points_scene(arm, truth, setup="eye-to-hand"),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "points of a board": case(
        "points",
        lambda arm, truth: points_scene(arm, truth, board=True),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "points that state their noise": case(
        "points",
        lambda arm, truth: points_scene(arm, truth, stated=True),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "plane_view": case("plane_view", plane_view_scene, "joint_6.offset", "tip.y", "tip.z"),
    "plane_view of planes on the tip": case(
        "plane_view",
        lambda arm, truth: plane_view_scene(arm, truth, setup="eye-to-hand"),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "plane_view that states its noise": case(
        "plane_view",
        lambda arm, truth: plane_view_scene(arm, truth, stated=True),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "profile of a ball": case("profile", profile_scene, "joint_6.offset", "tip.y", "tip.z"),
    "profile of a ball of unknown radius": case(
        "profile",
        lambda arm, truth: profile_scene(arm, truth, known=False),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
    "profile of a plane": case(
        "profile",
        lambda arm, truth: profile_scene(arm, truth, 40, plane=True),
        *("joint_6.offset", "tip.y", "tip.z"),
    ),
}
AVAILABLE = [name for name, c in CASES.items() if c.kind in KINDS]
each_case = pytest.mark.parametrize("name", AVAILABLE)


@cache
def scene(name: str) -> Scene:
    arm = arm_named("suta")
    return CASES[name].make(arm, perturbed(dh_parameters(arm), seed=1))


def noises(spread: Spread, robust: bool) -> tuple[Noise, Noise]:
    """Lengths and angles: known scatter, and Huber's threshold where it is robust."""
    found = []
    for sigma in (spread.position, spread.rotation):
        found.append(Noise(sigma, huber_threshold(3) * sigma) if robust else Noise(sigma))
    return found[0], found[1]


def problem_of(name: str, spread: Spread = SIGMA, seed: int = 0, robust: bool = False) -> Problem:
    s = scene(name)
    term = s.term(s.samples(spread, seed)[0], *noises(SIGMA, robust))
    return Problem([term], dh_parameters(s.arm))


def truth_of(problem: Problem, name: str) -> np.ndarray:
    """The parameter vector at which the exact samples of a case were made."""
    return problem.start(scene(name).truth)


def given_as_it_is(term: Term, truth: dict[str, float], std: float | None = None) -> Term:
    """The term with every place or frame of its own given where it truly is."""
    values, given = term.start_values(truth), {}
    poses = {frame.owner: frame.pose(values) for frame in term.outside}
    for owner in dict.fromkeys(p.owner for p in term.own_parameters if p.key):
        label = owner.partition("[")[2].rstrip("]")
        names = getattr(term, "frame_names", [f.owner for f in term.frames])
        frames = [f.key for f, name in zip(term.frames, names, strict=True) if name == owner]
        if frames or (label in term.places[0] if term.place else label):
            turn, position = poses[owner]
            unsure = None if std is None else np.full(3, std)
            given[frames[0] if frames else label] = GivenPose(position, turn, unsure)
    return replace(term, given=given)
