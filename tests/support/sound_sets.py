"""Sound data with known truth, new with every seed: an arm that an instrument watches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from simulated import (
    DH_LENGTHS,
    PLAIN,
    Scene,
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    camera_scene,
    dh_parameters,
    perturbed,
    placements,
    points_scene,
    tracked_scene,
)
from terms_cases import given_as_it_is, scene

from suta_calib import (
    ParameterSet,
    Problem,
    Selection,
    Solution,
    SolverOptions,
    TiltSensor,
    solve,
)
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Artefact, Samples
from suta_calib.pose_calibration.hand_eye import calibrate_hand_eye
from suta_calib.pose_calibration.pivot import calibrate_pivot
from suta_calib.pose_calibration.registration import register
from suta_calib.pose_calibration.robust_answer import RobustAnswer
from suta_calib.terms import (
    ArmPoses,
    FixedPoint,
    HandEye,
    MeasuredPoses,
    Noise,
    Term,
    TrackedPoint,
)
from suta_calib.terms.synthetic import PoseNoise
from suta_calib.trust import Examination
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.hypotheses.leaning_link import LeaningLink
from suta_calib.trust.rereading import shifted_parameters

ARM = arm_named("ur5")
UNKNOWN: ParameterSet = ARM.select("geometric", Selection("*.offset", bound_rad=0.2))
TRUTH = perturbed(UNKNOWN, 3, length=1e-3, angle=3e-3)
NOISE = Spread(position=1e-4, rotation=2e-4)


@dataclass(frozen=True, eq=False)
class Sound:
    """Sound data of one sort, simulated anew with every seed.

    Attributes:
        make: the term of a seed.
        values: the truth.
        unknown: parameters of the arm that are estimated; none for measured poses.
    """

    make: Callable[[int], Term]
    values: dict[str, float]
    unknown: ParameterSet = field(default_factory=ParameterSet)

    def examined(self, term: Term) -> Examination:
        if isinstance(term.poses, MeasuredPoses):
            examination = answer_on_poses(term).examination
            assert examination is not None
            return examination
        solution = solve(Problem([term], self.unknown), SolverOptions(starts=1, confirm=False))
        assert solution.converged
        return CalibrationExamination.of(solution)

    def fitted(self, term: Term) -> Solution:
        """An answer, converged or not: what is wrong with the data is asked in any case."""
        few = SolverOptions(starts=1, confirm=False, max_iterations=30)
        unknown = shifted_parameters([term], Problem([self.make(1)], self.unknown))
        return solve(Problem([term], unknown), few)


def answer_on_poses(term: Term) -> RobustAnswer:
    """What the command for this kind of poses answers."""
    rotation, position = term.poses.at({})
    samples = term.poses.samples
    if isinstance(term, FixedPoint):
        return calibrate_pivot(rotation, position)
    assert samples.position is not None
    if samples.rotation is None:
        return register(position, samples.position)
    return calibrate_hand_eye((rotation, position), (samples.rotation, samples.position))


def of_scene(source: Scene, unknown: ParameterSet = UNKNOWN, noise: Noise = PLAIN) -> Sound:
    def make(seed: int) -> Term:
        return source.term(source.samples(NOISE, seed)[0], noise, PLAIN)

    return Sound(make, source.truth, unknown)


def moving_scene(n: int = 150) -> Scene:
    """The arm moves smoothly through its range while an instrument follows the tip."""
    rest, time = tracked_scene(ARM, TRUTH, n, oriented=True), np.arange(n)[:, None]
    rng = np.random.default_rng(11)
    phase, period = rng.uniform(0, 2 * np.pi, 6), rng.uniform(20, 60, 6)
    q = 1.5 * np.sin(2 * np.pi * time / period + phase)
    values = TRUTH | rest.exact().start_values(TRUTH)
    seen = rest.exact().observed(values, ArmPoses(ARM, replace(rest.samples()[0], q=q)))
    assert seen.rotation is not None
    return replace(rest, q=q, position=seen.position, rotation=seen.rotation)


def sheet_scene(kind: str = "landmark") -> Scene:
    """A flat sheet of landmarks in several places before the SUTA."""
    drawn = artefact(8).landmarks.items()
    marks = {name: replace(m, position=m.position * [1, 1, 0]) for name, m in drawn}
    sheet = Artefact("sheet", marks)
    return artefact_scene(kind, SUTA, SUTA_TRUTH, sheet, placements(5), tilt=0.4)


SUTA = arm_named("suta")
SUTA_UNKNOWN: ParameterSet = SUTA.select(
    Selection("*.offset", bound_rad=0.26), Selection(DH_LENGTHS, bound_m=0.02)
)
SUTA_TRUTH = perturbed(SUTA_UNKNOWN, 3, length=1e-3, angle=5e-3)
TRACKED = of_scene(tracked_scene(ARM, TRUTH, 80, oriented=True))
MOVING = of_scene(moving_scene())
MARKED = of_scene(
    tracked_scene(ARM, TRUTH, 40, targets=[(0.05, 0, 0.02, 0, 0, 0), (-0.03, 0.04, 0.03, 0, 0, 0)])
)
SHEET = of_scene(sheet_scene(), SUTA_UNKNOWN)
BOUNDED = of_scene(tracked_scene(SUTA, SUTA_TRUTH, 40, oriented=True), SUTA_UNKNOWN)
TOUCHES = artefact_scene("landmark", SUTA, SUTA_TRUTH, artefact(8), placements(5), tilt=0.4)
TOUCHED = of_scene(TOUCHES, SUTA_UNKNOWN)
# The same, rows that are far off counting less.
ROBUST = of_scene(TOUCHES, SUTA_UNKNOWN, Noise(huber=3e-4))


def surveyed(seed: int) -> Term:
    """Draw-wire lengths from anchors whose positions are given."""
    rest = scene("range")
    return given_as_it_is(rest.term(rest.samples(NOISE, seed)[0], PLAIN, PLAIN), rest.truth)


SURVEYED = Sound(surveyed, scene("range").truth, dh_parameters(scene("range").arm))
PIVOT = Sound(
    lambda seed: FixedPoint.simulate(60, spread=PoseNoise(1e-4, 2e-4), seed=seed).term,
    FixedPoint.simulate(60).truth,
)


def points(seed: int) -> Term:
    """Twelve points in one frame, measured in another."""
    rng = np.random.default_rng(seed)
    placed = rng.uniform(-0.08, 0.08, (12, 3))
    seen = placed @ rotation_from_vector(rng.standard_normal(3)).T + rng.uniform(-0.3, 0.3, 3)
    samples = Samples.from_arrays(
        [], np.zeros((12, 0)), position=seen + 1e-4 * rng.standard_normal((12, 3))
    )
    upright = np.tile(np.eye(3), (12, 1, 1))
    return TrackedPoint(MeasuredPoses(upright, placed, samples, exact=True), PLAIN)


POINTS = Sound(points, {})
PAIRS = Sound(
    lambda seed: (
        HandEye.simulate(40, hand=PoseNoise(1e-4, 1e-3), eye=PoseNoise(1e-4, 1e-3), seed=seed).term
    ),
    HandEye.simulate(40).truth,
)
BOARD = of_scene(camera_scene(ARM, TRUTH, 20), UNKNOWN)
DEPTH = of_scene(points_scene(ARM, TRUTH, 20, board=True), UNKNOWN)
SENSOR = TiltSensor("base_link", ("ax", "ay", "az"))
FELT = ARM.with_tilt_sensors([SENSOR])


def leaning(seed: int) -> Term:
    """The tracked arm on a base that leans, as its sensor feels."""
    sound = LeaningLink().spoil(TRACKED.make(seed), TRUTH, np.random.default_rng(seed)).data
    return sound.over_poses(ArmPoses(FELT, sound.poses.samples))


LEANING = Sound(
    leaning,
    TRUTH,
    FELT.select("geometric", Selection("*.offset", bound_rad=0.2), *SENSOR.selections),
)

SORTS: dict[str, Sound] = {
    "tracked": TRACKED,
    "board": BOARD,
    "pivot": PIVOT,
    "points": POINTS,
    "pairs": PAIRS,
    "marked": MARKED,
    "moving": MOVING,
    "sheet": SHEET,
    "touched": TOUCHED,
    "robust": ROBUST,
    "surveyed": SURVEYED,
    "bounded": BOUNDED,
    "leaning": LEANING,
    "depth": DEPTH,
}
# Sorts of data that can have the fault, by the hypothesis's name, where a tracked arm cannot.
SCENES: dict[str, tuple[str, ...]] = {
    "bent tip": ("pivot",),
    "scale between two sets": ("points",),
    "strain between two sets": ("points",),
    "scale of depth": ("pairs",),
    "depth camera": ("depth",),
    "moved": ("pivot", "points", "pairs"),
    "outliers in a block": ("pivot", "points", "pairs"),
    "exchanged targets": ("marked",),
    "time offset": ("moving",),
    "late clock": ("moving",),
    "stretched body": ("sheet",),
    "landmark names": ("touched",),
    "wrong labels": ("robust",),
    "mirrored artefact": ("touched",),
    "mirrored survey": ("surveyed",),
    "given pose": ("surveyed",),
    "misread observations": ("board",),
    "unit of a length": ("bounded",),
    "unknown mount": ("bounded",),
    "misread tilt sensor": ("leaning",),
    "transposed rotations": ("pairs",),
}


def sorts_of(name: str) -> tuple[str, ...]:
    """Sorts of data that can have the fault of a hypothesis."""
    return SCENES.get(name, ("tracked",))


def scene_of(name: str) -> Sound:
    """The first of them."""
    return SORTS[sorts_of(name)[0]]
