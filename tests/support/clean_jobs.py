"""Sound jobs of every kind of observation of one arm, simulated anew with every seed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from simulated import perturbed, tracked_scene

from suta_calib import (
    ArmModel,
    Noise,
    Problem,
    Robot,
    Selection,
    SolverOptions,
    Term,
    TrackedPoint,
    solve,
)
from suta_calib.assessment import Assessment
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import LengthScale
from suta_calib.model.parameters import ParameterSet
from suta_calib.model.robot import AnyArm
from suta_calib.registry import shipped
from suta_calib.terms import KINDS, ArmPoses, CameraView
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.rich_data import RichData, Sort

SORTS = [
    (kind, oriented)
    for kind, of in shipped(KINDS).items()
    for oriented in (False, True)
    if not of.between_chains
    and (of.has_angles or not oriented)
    and (oriented or of.columns.orientation != "required")
]


def as_init_frees(arm: AnyArm) -> ParameterSet:
    offsets = Selection(("*.offset",), bound_rad=math.radians(15))
    return arm.select(offsets, Selection(("geometric",), bound_m=0.03, bound_rad=math.radians(5)))


def with_priors(arm: AnyArm) -> ParameterSet:
    offsets = Selection(("*.offset",), prior_rad=0.013)
    return arm.select(offsets, Selection(("geometric",), prior_m=1e-3, prior_rad=0.003))


def measured(arm: ArmModel, unknown: ParameterSet, sort: Sort, seed: int) -> tuple[Term, Term]:
    """Rich data of an arm that is a little off, with noise: to fit, and to hold out."""
    random = np.random.default_rng(seed)
    truth = perturbed(unknown, seed, 1e-3, 3e-3)
    problem = Problem([tracked_scene(arm, truth).exact()], unknown)
    exact, _ = RichData(problem, problem.start(truth)).observations(sort, "data")
    if isinstance(exact, CameraView):
        # Its owner measured it.
        exact = replace(exact, board=replace(exact.board, scale=LengthScale(1e-4)))
    return shaken(exact, random)


def shaken(exact: Term, random: np.random.Generator) -> tuple[Term, Term]:
    """Exact data with noise: to fit, and to hold out."""
    samples = exact.poses.samples
    if samples.position is None:
        assert isinstance(exact.poses, ArmPoses)
        read = np.isin(samples.joints, exact.poses.arm.own_joints)
        flicker = 2e-4 * random.standard_normal(samples.q.shape)
        noisy = replace(samples, q=samples.q + flicker * read)
    else:
        # As a term believes that rows scatter: those of a depth camera by their distance.
        sigma = 1e-4 * exact.blocks[0].relative
        noise = sigma * random.standard_normal(samples.position.shape)
        noisy = replace(samples, position=samples.position + noise)
        if samples.rotation is not None:
            turn = rotation_from_vector(1e-3 * random.standard_normal((len(samples), 3)))
            noisy = replace(noisy, rotation=samples.rotation @ turn)
    term: Any = exact.over_poses(exact.poses.with_samples(noisy))
    held_out = np.arange(len(samples)) % 3 == 0
    if term.place in samples.labels:
        places = samples.labels[term.place]
        held_out = np.isin(places, np.unique(places)[:2])
    # What has no lengths is robust by its angles.
    key = "noise" if hasattr(term, "noise") else "angular_noise"
    return replace(term.take(~held_out), **{key: Noise(None, 1.35e-3)}), term.take(held_out)


def judged(
    arm: ArmModel, unknown: ParameterSet, kind: str, oriented: bool, seed: int
) -> Assessment:
    term, held_out = measured(arm, unknown, Sort(KINDS[kind], oriented), seed)
    solution = solve(Problem([term], unknown), SolverOptions())
    return assess_calibration(CalibrationExamination.of(solution, [held_out]))


# What the chains of the robot in examples/whole_robot do in one job: kinds, and whether
# orientations are seen.
MIXED: dict[str, dict[str, tuple[str, bool]]] = {
    "both hands tracked": {"left": ("tracked_point", True), "right": ("tracked_point", True)},
    "both hands tracked, positions": {
        "left": ("tracked_point", False),
        "right": ("tracked_point", False),
    },
    "tracked and points": {"left": ("tracked_point", True), "right": ("fixed_point", False)},
    "landmarks and tracked": {"left": ("landmark", False), "right": ("tracked_point", True)},
    "landmarks of both": {"left": ("landmark", False), "right": ("landmark", False)},
    "distances and plane": {"left": ("pairwise_distance", False), "right": ("plane", False)},
    "head camera and tracked": {"camera": ("hand_eye", True), "right": ("tracked_point", True)},
    "head camera and both": {
        "camera": ("hand_eye", True),
        "left": ("tracked_point", False),
        "right": ("fixed_point", False),
    },
}
WHOLE_ROBOT = Path(__file__).parents[2] / "examples" / "whole_robot" / "robot.urdf"


def judged_chains(kinds: Mapping[str, tuple[str, bool]], seed: int) -> Assessment:
    """Of a sound job of several chains of one robot, each with a kind of its own."""
    links = {side: side if side == "camera" else f"{side}_hand" for side in kinds}
    robot = Robot.from_urdf(WHOLE_ROBOT, {side: (link, None) for side, link in links.items()})
    unknown, random = with_priors(robot), np.random.default_rng(seed)
    truth = perturbed(unknown, seed, 1e-3, 3e-3)
    at_rest = [
        TrackedPoint.from_arrays(arm, np.zeros((3, len(arm.joints))), position=np.zeros((3, 3)))
        for arm in robot.arms
    ]
    problem = Problem(at_rest, unknown)
    rich = RichData(problem, problem.start(truth))
    pairs = []
    for k, (kind, oriented) in enumerate(kinds.values()):
        exact, _ = rich.observations(Sort(KINDS[kind], oriented), f"data {k}", k)
        pairs.append(shaken(exact, random))
    solution = solve(Problem([fitted for fitted, _ in pairs], unknown), SolverOptions())
    held_out = [held for _, held in pairs]
    return assess_calibration(CalibrationExamination.of(solution, held_out))
