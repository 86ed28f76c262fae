"""Small simulated problems with known truth, made in milliseconds, for the tests.

Everything the terms see is simulated here: an arm whose true geometry departs from nominal touches
an artefact, touches fixed points, or is watched by an instrument.
"""

from __future__ import annotations

import math
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import (
    rotation_from_rpy,
    rotation_from_vector,
    vector_turning_z_to,
)
from suta_calib.measurements import Artefact, Camera, Chessboard, Landmark, LengthScale, Samples
from suta_calib.measurements.depth_noise import DepthNoise
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import ParameterSet, Selection
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.terms import KINDS, ArmPoses, GivenPose, Noise, Setup, Term
from suta_calib.terms.external_frame import pose_parameters, pose_values
from suta_calib.terms.sample_errors import HandError

SUTA_URDF = Path(__file__).resolve().parents[2] / "urdf" / "suta.urdf"
ROBOTS = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
ROBOT_FILES = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand"),
    "z1": ("z1_description/urdf/z1.urdf", "link06"),
    "tiago": ("tiago_description/robots/tiago.urdf", "arm_tool_link"),
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
}
ARMS = ("suta", *ROBOT_FILES)
# Least squares with a scatter that is learnt.
PLAIN = Noise()
# The lengths of a Denavit-Hartenberg table: d of every joint, and the tool.
DH_LENGTHS = ("joint_2.z", "joint_3.z", "joint_4.z", "joint_5.z", "joint_6.z", "tip.y", "tip.z")


@cache
def arm_named(name: str) -> ArmModel:
    """The SUTA, or somebody else's arm; the test is skipped where that is not installed."""
    if name == "suta":
        return ArmModel.from_urdf(SUTA_URDF, "tip")
    file, tip = ROBOT_FILES[name]
    if not (ROBOTS / file).is_file():
        pytest.skip("example-robot-data is not installed")
    return ArmModel.from_urdf(ROBOTS / file, tip)


def dh_parameters(arm: ArmModel) -> ParameterSet:
    """The SUTA's thirteen: six offsets and seven lengths."""
    offsets = Selection(("joint_*.offset",), bound_rad=math.radians(15))
    return arm.select(offsets, Selection(DH_LENGTHS, bound_m=0.03))


def perturbed(
    parameters: ParameterSet, seed: int, length: float = 2e-3, angle: float = 1e-2
) -> dict[str, float]:
    """True values: nominal plus normal errors of the given standard deviations, m and rad."""
    rng = np.random.default_rng(seed)
    size = {"m": length, "rad": angle}
    return {p.name: p.nominal + size[p.unit] * rng.standard_normal() for p in parameters.values()}


def random_readings(arm: ArmModel, rng: np.random.Generator, n: int) -> FloatArray:
    """(n, joints) anywhere within the limits."""
    return InverseKinematics(arm, {}).random_readings(rng, n)


def artefact(count: int = 8, *, tilt: float = 0.0, oriented: bool = False) -> Artefact:
    """Landmarks spread over 180 mm, met from above; ``tilt`` (rad) makes the pillars differ."""
    rng = np.random.default_rng(count)
    marks = {}
    for k in range(count):
        position = [*rng.uniform(-0.09, 0.09, 2), rng.choice([0.02, 0.04, 0.06])]
        down = rotation_from_rpy([math.pi, 0.0, rng.uniform(-0.5, 0.5)])
        lean = rotation_from_vector(tilt * rng.uniform(-1, 1, 3))
        name = f"L{k + 1}"
        marks[name] = Landmark(name, np.array(position), lean @ down if oriented else None)
    # Touched where it says: it has no scale of its own.
    return Artefact("simulated", marks, LengthScale(0.0))


@dataclass(frozen=True, eq=False)
class Spread:
    """How the simulated measurements scatter: per axis, m and rad, and the gross errors."""

    position: float = 0.0
    rotation: float = 0.0
    outliers: float = 0.0
    gross: float = 0.03


@dataclass(frozen=True, eq=False)
class Scene:
    """What would be measured without noise, and how to measure it with noise.

    Attributes:
        kind: of the term.
        q: (n, joints) true readings.
        touched: whether noise moves the arm (touching) rather than the instrument's answer.
        position, rotation: (n, 3), (n, 3, 3) of the tip when touching, or of what was seen.
        stated: (n, 3) standard deviations that the rows state of what was seen, m; noise is in
            proportion to them.
        up: (3,) which way is up in the base, where a sensor that was turned by ``rotation`` felt
            it.
    """

    kind: str
    arm: ArmModel
    truth: dict[str, float]
    q: FloatArray
    touched: bool
    position: FloatArray
    rotation: FloatArray
    labels: dict[str, list[str]] = field(default_factory=dict)
    seen: tuple[str, ...] = ()
    artefact: Artefact | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    pixels: FloatArray | None = None
    lengths: dict[str, FloatArray] = field(default_factory=dict)
    stated: FloatArray | None = None
    up: FloatArray | None = None

    def samples(self, spread: Spread = Spread(), seed: int = 0, trials: int = 1) -> list[Samples]:
        """Independent repetitions of the measurement."""
        rng = np.random.default_rng(seed)
        n = len(self.q)
        turn = rotation_from_vector(spread.rotation * rng.standard_normal((trials, n, 3)))
        noise = spread.position * rng.standard_normal((trials, n, 3))
        if self.stated is not None:
            noise *= self.stated / np.exp(np.log(self.stated).mean())
        position = self.position + noise
        rotation = self.rotation @ turn
        for rows, turned in zip(position, rotation, strict=True):
            bad = rng.permutation(n)[: round(spread.outliers * n)]
            direction = rng.standard_normal((len(bad), 3))
            off = spread.gross * direction / np.linalg.norm(direction, axis=1)[:, None]
            rows[bad] += off
            if self.up is not None:
                # As many times the scatter as positions are off.
                turned[bad] @= rotation_from_vector(off * spread.rotation / spread.position)
        q = np.tile(self.q, (trials, 1, 1))
        if self.touched and spread != Spread():
            flat = readings_for(self.arm, self.truth, position, rotation, q)
            q = flat.reshape(trials, n, -1)
        if self.pixels is not None:
            return [self._pictured(p - self.position, rng, spread) for p in position]
        return [self._observed(*rows) for rows in zip(q, position, rotation, strict=True)]

    def _pictured(self, off: FloatArray, rng: np.random.Generator, spread: Spread) -> Samples:
        """Corners that scatter one by one, and pictures that are grossly off as a whole."""
        assert self.pixels is not None
        if "pixel" not in self.settings:
            return self._profiled(off, rng, spread)
        per_pixel = self.settings["pixel"]
        gross = np.where(np.linalg.norm(off, axis=1) > spread.gross / 2, 1.0, 0.0)
        scatter = spread.position * rng.standard_normal(self.pixels.shape)
        seen = self.pixels + (scatter + (gross[:, None] * off[:, :2])[:, None]) / per_pixel
        samples = Samples.from_arrays(self.arm.joints, self.q, labels=self.labels)
        return replace(samples, pixels=seen)

    def _profiled(self, off: FloatArray, rng: np.random.Generator, spread: Spread) -> Samples:
        """Points that scatter along the beam, and profiles that are grossly off as a whole."""
        assert self.pixels is not None
        gross = np.linalg.norm(off, axis=1) > spread.gross / 2
        seen = self.pixels + np.where(gross[:, None], off[:, [0, 2]], 0.0)[:, None]
        seen[..., 1] += spread.position * rng.standard_normal(seen.shape[:2])
        samples = Samples.from_arrays(self.arm.joints, self.q, labels=self.labels)
        return replace(samples, pixels=seen)

    def term(self, samples: Samples, noise: Noise = PLAIN, angular: Noise = PLAIN) -> Term:
        setup = Setup(self.artefact, noise, angular, settings=self.settings)
        return KINDS[self.kind].over(ArmPoses(self.arm, samples), setup)

    def exact(self, noise: Noise = PLAIN, angular: Noise = PLAIN) -> Term:
        """The term over samples without any noise."""
        return self.term(self.samples()[0], noise, angular)

    def _observed(self, q: FloatArray, position: FloatArray, rotation: FloatArray) -> Samples:
        measured: dict[str, Any] = {"numbers": self.lengths}
        if "position" in self.seen:
            measured["position"] = position
        if self.stated is not None:
            measured["position_sigma"] = self.stated
        if "rotation" in self.seen:
            measured["rotation"] = rotation
        if self.up is not None:
            felt = self.up @ rotation
            measured["numbers"] = dict(zip(("ax", "ay", "az"), felt.T, strict=True))
        return Samples.from_arrays(self.arm.joints, q, labels=self.labels, **measured)


def readings_for(
    arm: ArmModel,
    truth: dict[str, float],
    position: FloatArray,
    rotation: FloatArray,
    start: FloatArray | None = None,
) -> FloatArray:
    """Readings (n, joints) at which the true arm's tip has the poses asked for."""
    kinematics = InverseKinematics(arm, truth)
    targets = Targets(position.reshape(-1, 3), rotation.reshape(-1, 3, 3))
    begin = kinematics.middle if start is None else start.reshape(len(targets), -1)
    found = kinematics.solve(targets, begin, np.random.default_rng(0))
    assert found.reached.all(), "the simulated target is out of reach"
    return found.q


def placements(count: int) -> list[tuple[FloatArray, FloatArray]]:
    """Upright artefact poses around the SUTA, turned so that its three-joint elbow reaches all."""
    rng = np.random.default_rng(count)
    around = np.linspace(0.0, 2 * math.pi, count, endpoint=False)
    poses = []
    for angle in around:
        radius, height = rng.uniform(0.35, 0.5), rng.uniform(-0.1, 0.2)
        centre = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
        turn = angle + rng.uniform(-0.4, 0.4)
        poses.append((rotation_from_rpy([0.0, 0.0, turn]), centre))
    return poses


def artefact_scene(
    kind: str,
    arm: ArmModel,
    truth: dict[str, float],
    certified: Artefact,
    where: Sequence[tuple[FloatArray, FloatArray]],
    repeats: int = 1,
    *,
    tilt: float = 0.0,
) -> Scene:
    """Every landmark touched at every placement; without seats, from above, leaning by ``tilt``."""
    rng = np.random.default_rng(7)
    rows, labels = [], {"placement": [], "repeat": [], "landmark": []}
    for k, (R, p) in enumerate(where):
        for repeat in range(repeats):
            for mark in certified.landmarks.values():
                seat = mark.rotation
                if seat is None:
                    down = rotation_from_rpy([math.pi, 0.0, rng.uniform(-0.5, 0.5)])
                    seat = rotation_from_vector(tilt * rng.uniform(-1, 1, 3)) @ down
                rows.append((R @ mark.position + p, R @ seat))
                for key, value in zip(labels, (f"P{k}", repeat, mark.name), strict=True):
                    labels[key].append(str(value))
    position, rotation = (np.array(column) for column in zip(*rows, strict=True))
    q = readings_for(arm, truth, position, rotation)
    return Scene(kind, arm, truth, q, True, position, rotation, labels, (), certified)


def fixed_point_scene(
    arm: ArmModel,
    truth: dict[str, float],
    directions: int = 20,
    points: Sequence[Sequence[float]] = ((0.45, 0.1, 0.05), (-0.2, 0.4, 0.2)),
    cone: float = 1.0,
) -> Scene:
    """Each point touched from directions within a cone (rad) about the vertical."""
    rng = np.random.default_rng(3)
    n = directions * len(points)
    position = np.repeat(np.array(points, dtype=float), directions, axis=0)
    lean = np.zeros((n, 3))
    lean[:, :2] = rng.uniform(-1, 1, (n, 2)) * cone / math.sqrt(2)
    down = np.array([rotation_from_rpy([math.pi, 0.0, yaw]) for yaw in rng.uniform(-3, 3, n)])
    rotation = rotation_from_vector(lean) @ down
    labels = {"point": [f"F{k}" for k in range(len(points)) for _ in range(directions)]}
    q = readings_for(arm, truth, position, rotation)
    return Scene("fixed_point", arm, truth, q, True, position, rotation, labels)


def plane_scene(
    arm: ArmModel,
    truth: dict[str, float],
    touches: int = 12,
    radius: float = 0.0,
    planes: Sequence[tuple[Sequence[float], Sequence[float]]] = (
        ((0.45, 0.05, -0.05), (0.0, 0.1, 0.0)),
        ((-0.05, 0.45, 0.1), (0.4, 0.0, 0.3)),
        ((-0.4, -0.2, 0.0), (-0.1, -0.3, 0.0)),
        ((0.2, -0.45, 0.15), (0.5, 0.3, 0.0)),
    ),
) -> Scene:
    """Planes of several attitudes (position, rpy), touched all over from a cone of directions."""
    return places_scene("plane", arm, truth, touches, {"radius": radius}, planes)


def line_scene(arm: ArmModel, truth: dict[str, float]) -> Scene:
    """Edges that lie in several directions."""
    edges = (
        ((0.45, 0.05, -0.05), (0.0, 0.1, 0.2)),
        ((-0.05, 0.45, 0.1), (0.4, 0.0, 1.3)),
        ((-0.4, -0.2, 0.0), (-0.1, -0.3, 2.2)),
        ((0.2, -0.45, 0.15), (0.5, 0.3, 0.9)),
    )
    return places_scene("line", arm, truth, 10, {}, edges)


def range_scene(arm: ArmModel, truth: dict[str, float], *, measured: bool) -> Scene:
    """A draw-wire, or a ball bar of unknown length, from three anchors."""
    lengths = (0.15, 0.4) if measured else (0.3, 0.3)
    anchors = (
        ((0.3, 0.1, -0.25), (0.0, 0.0, 0.0)),
        ((-0.1, 0.3, -0.2), (0.2, 0.0, 0.0)),
        ((-0.2, -0.3, -0.15), (0.0, -0.2, 0.0)),
    )
    settings = {"measured": measured, "lengths": lengths}
    return places_scene("range", arm, truth, 18, settings, anchors)


def gravity_scene(arm: ArmModel, truth: dict[str, float], n: int = 40) -> Scene:
    """A phone that is strapped to the tip in any way, on an arm whose base leans."""
    q = random_readings(arm, np.random.default_rng(8), n)
    rotation, position = arm.forward(q, truth)
    mount, up = rotation_from_vector([0.4, -1.1, 2.0]), rotation_from_vector([0.02, -0.03, 0])
    seen = rotation @ mount
    return Scene("gravity", arm, truth, q, False, position, seen, up=9.81 * up[:, 2])


def contact_scene(
    arm: ArmModel, truth: dict[str, float], *, distance: float, surface: str = "sphere"
) -> Scene:
    """Spots in the base, which is the other tip's link: points, balls or faces."""
    spots = (
        ((0.3, 0.1, -0.25), (0.0, 0.1, 0.0)),
        ((-0.1, 0.3, -0.2), (0.4, 0.0, 0.3)),
        ((-0.2, -0.3, -0.15), (-0.1, -0.3, 0.0)),
        ((0.2, -0.3, -0.1), (0.3, 0.2, 0.0)),
    )
    settings = {"distance": distance, "surface": surface}
    return places_scene("contact", arm, truth, 14, settings, spots)


def closed_loop_scene(arm: ArmModel, truth: dict[str, float], grips: int = 20) -> Scene:
    """Each grip in the postures that six joints have there: the elbow up and down, and others."""
    rng, kinematics = np.random.default_rng(8), InverseKinematics(arm, truth)
    R, p = arm.forward(kinematics.random_readings(rng, grips), truth)
    times, found = 12, []
    for k in range(grips):
        targets = Targets(np.tile(p[k], (times, 1)), np.tile(R[k], (times, 1, 1)))
        start = kinematics.random_readings(rng, times)
        answer = kinematics.solve(targets, start, rng, starts=1)
        q = answer.q[answer.reached]
        q = q[np.unique(np.round(q, 3), axis=0, return_index=True)[1]]
        # Well within the limits, and away from singular postures: noise must be reached too.
        aside = np.vstack([-np.eye(3), np.eye(3)])
        turned = np.tile(R[k] @ rotation_from_vector(5e-3 * aside), (len(q), 1, 1))
        near = Targets(np.tile(p[k] + 0.03 * aside, (len(q), 1)), turned)
        tried = kinematics.solve(near, np.repeat(q, 6, axis=0), rng, starts=1)
        off = np.abs(tried.q - np.repeat(q, 6, axis=0)).max(axis=1) < 0.5
        q = q[(tried.reached & off).reshape(-1, 6).all(axis=1)]
        found += [(k, row) for row in q if len(q) > 1]
    which, q = (np.array(column) for column in zip(*found, strict=True))
    labels = {"grip": [f"G{k}" for k in which]}
    return Scene("closed_loop", arm, truth, q, True, p[which], R[which], labels)


def places_scene(
    kind: str,
    arm: ArmModel,
    truth: dict[str, float],
    touches: int,
    settings: dict[str, Any],
    places: Sequence[tuple[Sequence[float], Sequence[float]]],
) -> Scene:
    """Places of a kind (position, rpy) that touches no artefact, from a cone of directions."""
    rng = np.random.default_rng(4)
    kinematics = InverseKinematics(arm, truth)
    found = []
    for k, (centre, rpy) in enumerate(places):
        R, tried = rotation_from_rpy(list(rpy)), 4 * touches
        where = rng.random((tried, 2))
        position = KINDS[kind].touches(R, np.array(centre), where, settings)
        lean = np.zeros((tried, 3))
        lean[:, :2] = rng.uniform(-0.7, 0.7, (tried, 2))
        yaw = rng.uniform(-3, 3, tried)
        down = np.array([rotation_from_rpy([math.pi, 0.0, each]) for each in yaw])
        rotation = R @ rotation_from_vector(lean) @ down
        # Four are tried for each that is wanted: what few starts reach is not worth more.
        answer = kinematics.solve(Targets(position, rotation), kinematics.middle, rng, starts=8)
        rows = np.flatnonzero(answer.reached)[:touches]
        assert len(rows) == touches, f"{kind} {k} is out of reach"
        at = np.tile(np.array(centre, dtype=float), (touches, 1))
        found.append((position[rows], rotation[rows], answer.q[rows], at))
    position, rotation, q, at = (np.concatenate(column) for column in zip(*found, strict=True))
    labels = {KINDS[kind].place: [f"S{k}" for k in range(len(places)) for _ in range(touches)]}
    lengths = KINDS[kind].measured(at, position, settings)
    return Scene(
        kind, arm, truth, q, True, position, rotation, labels, settings=settings, lengths=lengths
    )


def tracked_scene(
    arm: ArmModel,
    truth: dict[str, float],
    n: int = 30,
    *,
    oriented: bool = False,
    targets: Sequence[Sequence[float]] = (),
    stated: bool = False,
) -> Scene:
    """An instrument somewhere sees the tip, or targets (x y z rx ry rz in it), at any postures.

    Where it is stated how well, from a third to three times 50 µm, by row and by axis.
    """
    q = random_readings(arm, np.random.default_rng(5), n)
    labels = {"target": [f"T{k}" for _ in range(n) for k in range(len(targets))]} if targets else {}
    q = np.repeat(q, max(len(targets), 1), axis=0)
    rotation, position = arm.forward(q, truth)
    if targets:
        six = np.tile(np.array(targets, dtype=float), (n, 1))
        position = position + np.einsum("nij,nj->ni", rotation, six[:, :3])
        rotation = rotation @ rotation_from_vector(six[:, 3:])
    R, p = rotation_from_vector([0.3, -1.2, 0.7]), np.array([1.1, -0.4, 0.6])
    seen = ("position", "rotation") if oriented else ("position",)
    at, turned = position @ R.T + p, R @ rotation
    s = Scene("tracked_point", arm, truth, q, False, at, turned, labels, seen)
    spread = np.exp(np.random.default_rng(6).uniform(-np.log(3.0), np.log(3.0), at.shape))
    return replace(s, stated=5e-5 * spread) if stated else s


def hand_eye_scene(arm: ArmModel, truth: dict[str, float], n: int = 25) -> Scene:
    """A camera on the tip sees a target that stays where it is."""
    q = random_readings(arm, np.random.default_rng(6), n)
    R, p = arm.forward(q, truth)
    Rx, px = rotation_from_vector([0.1, 0.2, -1.5]), np.array([0.02, -0.05, 0.08])
    Rz, pz = rotation_from_vector([2.0, 0.4, 0.3]), np.array([0.6, 0.2, -0.1])
    eye_R = R @ Rx
    eye_p = R @ px + p
    seen_p = np.einsum("nji,nj->ni", eye_R, pz - eye_p)
    seen_R = np.swapaxes(eye_R, 1, 2) @ Rz
    seen = ("position", "rotation")
    return Scene("hand_eye", arm, truth, q, False, seen_p, seen_R, {}, seen)


def camera_scene(
    arm: ArmModel,
    truth: dict[str, float],
    n: int = 20,
    *,
    setup: str = "eye-in-hand",
    hand_error: HandError | None = None,
) -> Scene:
    """A camera on the tip sees a small board, or one beside the arm a board on the tip."""
    board = Chessboard(4, 3, 0.04, scale=LengthScale(1e-3))
    lens = np.array([1000.0, 1005, 639.5, 479.5, -0.1, 0.02, 5e-4, -3e-4, 0.0])
    settings = {"board": board, "camera": Camera(1280, 960, lens), "setup": setup}
    settings |= {"pixel": 5e-4, "hand_error": hand_error}
    # At the first posture the board is half a metre ahead of the camera, its face to it.
    q = random_readings(arm, np.random.default_rng(9), 100 * n)
    (turn,), (place,) = arm.forward(q[:1], truth)
    held = rotation_from_vector([0.1, 0.2, -1.5]), np.array([0.02, -0.05, 0.08])
    ahead = np.array([-0.06, -0.04, 0.5])
    if setup == "eye-in-hand":
        eye = turn @ held[0], turn @ held[1] + place
        own = held, (eye[0], eye[0] @ ahead + eye[1])
    else:
        board_R, board_p = turn @ held[0], turn @ held[1] + place
        own = (board_R, board_p - board_R @ ahead), held
    names = [p.name for frame in ("hand_eye", "target") for p in pose_parameters(frame)]
    six = np.concatenate([pose_values(*pose) for pose in own]).tolist()
    values = dict(truth) | dict(zip(names, six, strict=True))
    kind = KINDS["camera_view"]
    blank = ArmPoses(arm, Samples.from_arrays(arm.joints, q))
    seen = kind.over(blank, Setup(settings=settings)).observed(values, blank)
    rows = np.flatnonzero(np.isfinite(seen.pixels).all(axis=(1, 2)))[:n]
    assert len(rows) == n, f"the board is in sight in {len(rows)} postures"
    labels = {"image": [f"{k}.png" for k in range(n)]}
    return Scene(
        *("camera_view", arm, truth, q[rows], False, seen.position[rows], seen.rotation[rows]),
        labels,
        settings=settings,
        pixels=seen.pixels[rows],
    )


# Centres of balls beside one another, in what carries them, m.
BALLS = ((0.0, 0.0, 0.0), (0.12, 0.02, 0.01), (-0.03, 0.1, 0.05))


def points_scene(
    arm: ArmModel,
    truth: dict[str, float],
    n: int = 20,
    *,
    setup: str = "eye-in-hand",
    board: bool = False,
    stated: bool = False,
) -> Scene:
    """A depth camera on the tip sees balls or a board, or one beside the arm those on the tip."""
    settings: dict[str, Any] = {"setup": setup, "depth_noise": DepthNoise((4e-5, 8e-5), 6e-5)}
    if board:
        settings["board"] = Chessboard(4, 3, 0.04, scale=LengthScale(1e-3))
    q = random_readings(arm, np.random.default_rng(9), 100 * n)
    (turn,), (place,) = arm.forward(q[:1], truth)
    held = rotation_from_vector([0.1, 0.2, -1.5]), np.array([0.02, -0.05, 0.08])
    # At the first posture what is looked at is half a metre ahead of the camera.
    ahead, carried = np.array([-0.06, -0.04, 0.5]), (turn @ held[0], turn @ held[1] + place)
    eye, seen = (
        (held, (carried[0], carried[0] @ ahead + carried[1]))
        if setup == "eye-in-hand"
        else ((carried[0], carried[1] - carried[0] @ ahead), held)
    )
    values = {**truth, **_six("hand_eye", *eye)}
    if board:
        values |= _six("target", *seen)
    for k, at in () if board else enumerate(BALLS):
        point = seen[0] @ np.array(at) + seen[1]
        values |= {f"point[B{k}].{c}": float(x) for c, x in zip("xyz", point, strict=True)}
    marks = [str(m) for m in range(12)] if board else [f"B{k}" for k in range(len(BALLS))]
    kind = KINDS["points"]

    def term(q: FloatArray, names: Sequence[str]) -> Term:
        labels = {"point": [*names] * (len(q) // len(names)), "image": ["0"] * len(q)}
        blank = Samples.from_arrays(arm.joints, q, labels=labels, position=np.zeros((len(q), 3)))
        return kind.over(ArmPoses(arm, blank), Setup(settings=settings))

    first = term(q, marks[:1])
    rows = np.flatnonzero(first.observed(values, first.poses).in_sight)[:n]
    assert len(rows) == n, f"the points are in sight in {len(rows)} postures"
    q = np.repeat(q[rows], len(marks), axis=0)
    all_seen = term(q, marks)
    place = all_seen.observed(values, all_seen.poses).place
    labels = {"point": marks * n, "image": [f"{k}.png" for k in range(n) for _ in marks]}
    turned = np.tile(np.eye(3), (len(q), 1, 1))
    scene = Scene(
        *("points", arm, truth, q, False, place, turned, labels, ("position",)), settings=settings
    )
    spread = np.exp(np.random.default_rng(6).uniform(-np.log(3.0), np.log(3.0), place.shape))
    return replace(scene, stated=5e-5 * spread) if stated else scene


def plane_view_scene(
    arm: ArmModel,
    truth: dict[str, float],
    n: int = 20,
    *,
    setup: str = "eye-in-hand",
    stated: bool = False,
) -> Scene:
    """A depth camera on the tip sees two planes, or one beside the arm those on the tip."""
    settings: dict[str, Any] = {"setup": setup, "depth_noise": DepthNoise((4e-5, 8e-5), 6e-5)}
    q = random_readings(arm, np.random.default_rng(9), 60 * n)
    (turn,), (place,) = arm.forward(q[:1], truth)
    held = rotation_from_vector([0.1, 0.2, -1.5]), np.array([0.02, -0.05, 0.08])
    carried = turn @ held[0], turn @ held[1] + place
    eye, back = (
        (held, carried)
        if setup == "eye-in-hand"
        else ((carried[0], carried[1] - carried[0] @ [0, 0, 0.5]), held)
    )
    values = {**truth, **_six("hand_eye", *eye)}
    # At the first posture both are ahead of the camera.
    for name, normal, away in (("A", [0.2, 0.1, 1.0], 0.6), ("B", [0.8, -0.3, 1.0], 0.5)):
        direction = back[0] @ (normal / np.linalg.norm(normal))
        up = np.where(direction[2] < 0, -1.0, 1.0)
        distance = away + direction @ back[1] if setup == "eye-in-hand" else away - 0.5
        rx, ry, _ = vector_turning_z_to(direction * up)
        values |= {f"plane[{name}].z": float(up * distance)}
        values |= {f"plane[{name}].rx": float(rx), f"plane[{name}].ry": float(ry)}
    kind = KINDS["plane_view"]
    marks = ["A", "B"] * 3

    def term(q: FloatArray) -> Term:
        labels = {"plane": marks * (len(q) // len(marks)), "image": ["0"] * len(q)}
        blank = Samples.from_arrays(arm.joints, q, labels=labels, position=np.zeros((len(q), 3)))
        return kind.over(ArmPoses(arm, blank), Setup(settings=settings))

    every = term(np.repeat(q, len(marks), axis=0))
    seen = every.observed(values, every.poses)
    rows = np.flatnonzero(seen.in_sight.reshape(-1, len(marks)).all(axis=1))[:n]
    assert len(rows) == n, f"the planes are in sight in {len(rows)} postures"
    q = np.repeat(q[rows], len(marks), axis=0)
    place = seen.place.reshape(-1, len(marks), 3)[rows].reshape(-1, 3)
    labels = {"plane": marks * n, "image": [f"{k}.ply" for k in range(n) for _ in marks]}
    turned = np.tile(np.eye(3), (len(q), 1, 1))
    scene = Scene(
        *("plane_view", arm, truth, q, False, place, turned, labels, ("position",)),
        settings=settings,
    )
    spread = np.exp(np.random.default_rng(6).uniform(-np.log(3.0), np.log(3.0), place.shape))
    return replace(scene, stated=5e-5 * spread) if stated else scene


def _six(owner: str, rotation: FloatArray, position: FloatArray) -> dict[str, float]:
    """The unknowns of a pose by name."""
    names = [p.name for p in pose_parameters(owner)]
    return dict(zip(names, pose_values(rotation, position).tolist(), strict=True))


def profile_scene(
    arm: ArmModel, truth: dict[str, float], n: int = 20, *, plane: bool = False, known: bool = True
) -> Scene:
    """A line scanner on the tip sees a ball of 40 mm, or a plane."""
    kind, rng = KINDS["profile"], np.random.default_rng(9)
    settings: dict[str, Any] = {"plane": True} if plane else {"radius": 0.04}
    settings |= {"points": 25, "field": 0.1}
    # About the first posture, in which what is looked at is 0.2 m ahead of the scanner.
    first = random_readings(arm, rng, 1)
    q = first + 0.25 * rng.standard_normal((300 * n, len(arm.joints)))
    (turn,), (place,) = arm.forward(first, truth)
    X = rotation_from_vector([0.1, 0.2, -1.5]), np.array([0.02, -0.05, 0.08])
    eye = turn @ X[0], turn @ X[1] + place
    seen = eye[0] @ np.array([0.005, 0.01, 0.2]) + eye[1]
    values = {**truth, **_six("hand_eye", *X)}
    blank = ArmPoses(arm, Samples.from_arrays(arm.joints, q))
    term = kind.over(blank, Setup(settings=settings))
    pose = GivenPose(seen, eye[0] @ rotation_from_vector([3.0, 0.2, 0.0]))
    values |= {k: v.value for k, v in term.prior_from_pose("target_in_base", pose).items()}
    pixels = term.observed(values, blank).pixels
    rows = np.flatnonzero(np.isfinite(pixels).all(axis=(1, 2)))[:n]
    assert len(rows) == n, f"the target is in sight in {len(rows)} postures"
    if not known:
        settings.pop("radius")
    labels = {"scan": [str(k) for k in range(n)]}
    place, turned = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))
    return Scene(
        *("profile", arm, truth, q[rows], False, place, turned, labels),
        settings=settings,
        pixels=pixels[rows],
    )


def read_again(samples: Samples, times: int, seed: int, jitter: float = 1e-6) -> Samples:
    """Every row read several times without moving (jitter in rad), the rows in any order."""
    rng = np.random.default_rng(seed)
    again = samples.take(rng.permutation(np.repeat(np.arange(len(samples)), times)))
    return replace(again, q=again.q + jitter * rng.standard_normal(again.q.shape))
