"""Simulated answers of the commands that have a certificate: whether value ± U holds the truth."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from camera_scenes import CAMERA, SECOND, pictures, solved
from camera_scenes import X as EYE
from certified_artefact import TRUE_POSITIONS, certified, positions
from depth_scenes import BOARD, depth_scene
from hand_eye_scenes import noisy
from line_scans import X as SCANNER
from line_scans import line_scans
from many_eyes import EYES, scene
from pose_scenes import B_A, TIP, pivot_numbers, point_numbers
from scipy import stats
from scipy.spatial.transform import Rotation
from simulated import arm_named, artefact, artefact_scene, placements

from suta_calib import calibrate_hand_eye, calibrate_pivot, register
from suta_calib.analysis.iso10360 import AcceptanceMeasurements, LengthErrors, accept
from suta_calib.analysis.repeatability.scatter import PositionScatter
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.certificate.answer import factor_of
from suta_calib.geometry.numbers import homogeneous, vector_from_rotation
from suta_calib.job.limits import LengthLimit, Limits
from suta_calib.measurements import Artefact, Landmark
from suta_calib.pose_calibration.depth_camera import calibrate_depth_camera
from suta_calib.pose_calibration.line_scanner import calibrate_line_scanner
from suta_calib.pose_calibration.many_eyes import calibrate_many_eyes
from suta_calib.pose_calibration.rig import rig_from_pictures
from suta_calib.terms import ArmPoses, PairwiseDistance

# Whether the truth is inside, by the quantity.
Held = Mapping[str, BoolArray]


class Case(NamedTuple):
    """A kind of answer.

    Attributes:
        command: that gives it.
        data: that it is given, in words.
        answers: how many are simulated.
        answer: whether the truth is inside, of a seed.
    """

    command: str
    data: str
    answers: int
    answer: Callable[[int], Held]


def _pose(found: FloatArray, truth: tuple[FloatArray, FloatArray], u: FloatArray) -> Held:
    """Of a pose (4, 4) with expanded uncertainties (6,)."""
    turn = vector_from_rotation(truth[0].T @ found[:3, :3])
    inside = np.abs(np.concatenate([found[:3, 3] - truth[1], turn])) <= u
    return {"position": inside[:3], "turn": inside[3:]}


def _joined(parts: list[Held]) -> Held:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _scaled(seed: int, std: float) -> float:
    """A factor on lengths, as it is stated: 1 with this standard deviation."""
    return 1.0 + std * float(np.random.default_rng([seed, 99]).standard_normal())


def _pivot(count: int, ppm: float, noise: float) -> Callable[[int], Held]:
    def answer(seed: int) -> Held:
        numbers = pivot_numbers(["left"] * count, seed, noise)
        position = numbers[:, :3] * _scaled(seed, 1e-6 * ppm)
        turns = Rotation.from_quat(numbers[:, 3:]).as_matrix()
        found = calibrate_pivot(turns, position, scale_ppm=ppm)
        return {"tip": np.abs(found.tip - TIP) <= factor_of([found.budget]) * found.tip_std}

    return answer


def _register(count: int) -> Callable[[int], Held]:
    def answer(seed: int) -> Held:
        a, b = point_numbers(count, seed)
        # Lengths of one set are off, as is stated of the factor between both.
        found = register(a * _scaled(seed, 1e-4), b, scale_ppm=100.0)
        u = factor_of(found.budgets) * found.origin_std
        pose = homogeneous(found.rotation, found.position)
        return _pose(pose, (B_A[0].as_matrix(), B_A[1]), u)

    return answer


def _hand_eye(count: int, **more: Any) -> Callable[[int], Held]:
    def answer(seed: int) -> Held:
        data = noisy(count, seed=seed, **more)
        found = calibrate_hand_eye(data.poses, data.seen)
        return _pose(found.X, data.true_pose("hand_eye"), factor_of(found.budgets) * found.std["X"])

    return answer


def _many_eyes(count: int) -> Callable[[int], Held]:
    def answer(seed: int) -> Held:
        s = scene(2, 2, count, seed=seed)
        found = calibrate_many_eyes(s.hand, s.seen, eye=s.eye, target=s.target)
        k, parts = factor_of(found.budgets), []
        for pose, name in zip(found.eyes, found.sight.eyes, strict=True):
            at = EYES.tolist().index(name)
            parts.append(_pose(pose.pose, (s.X[0][at], s.X[1][at]), k * pose.std6))
        return _joined(parts)

    return answer


def _pictures(count: int) -> Callable[[int], Held]:
    def answer(seed: int) -> Held:
        found = solved(pictures(count, pixel=0.2, robot=(3e-4, 3e-4), seed=seed)).cameras[0]
        return _pose(found.X, EYE, factor_of(found.budgets("X")) * found.std["X"])

    return answer


def _depth(what: str, count: int) -> Callable[[int], Held]:
    def answer(seed: int) -> Held:
        s = depth_scene(seed, what, count=count)
        seen: dict[str, Any] = {"planes": s.seen} if what == "room" else {"points": s.seen}
        board: dict[str, Any] = {"board": BOARD} if what == "board" else {}
        found = calibrate_depth_camera(s.hand, s.images, **seen, **board)
        return _pose(found.X, s.camera, factor_of(found.budgets) * found.std)

    return answer


def _line(radius: float | None, count: int) -> Callable[[int], Held]:
    def answer(seed: int) -> Held:
        s = line_scans(seed, radius=radius, count=count)
        hand = s.rotation, s.position
        found = calibrate_line_scanner(
            hand, s.scans, s.profiles, radius=radius, plane=radius is None
        )
        return _pose(found.X, SCANNER, factor_of(found.budgets) * found.std)

    return answer


# How well the files know the cameras of a rig: fx, fy, cx, cy, px; a lens that is known.
_KNOWN = np.array([2.0, 2.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def _rig(count: int) -> Callable[[int], Held]:
    truth = np.linalg.inv(homogeneous(*EYE)) @ homogeneous(*SECOND)

    def answer(seed: int) -> Held:
        views, factor = [], _scaled(seed, pictures(1).views[0].board.length_scale.std)
        for k, view in enumerate(pictures(count, pixel=0.1, eyes=(EYE, SECOND), seed=seed).views):
            error = _KNOWN * np.random.default_rng([seed, k]).standard_normal(len(_KNOWN))
            given = replace(
                CAMERA, intrinsics=CAMERA.intrinsics + error, covariance=np.diag(_KNOWN**2)
            )
            views.append(replace(view, label="ab"[k], camera=given))
        found = rig_from_pictures(views)
        (other,) = found.others
        # A board that is larger than it says makes every distance too short.
        true = truth[:3, :3], truth[:3, 3] * factor
        return _pose(other.pose, true, factor_of(other.budgets) * other.std6)

    return answer


def _certify(noise: float) -> Callable[[int], Held]:
    def answer(seed: int) -> Held:
        with tempfile.TemporaryDirectory() as folder:
            found = certified(Path(folder), noise=noise, seed=seed)
        std = np.array([mark.std for mark in found.landmarks])
        # The coordinates that define the frame have no uncertainty.
        known = std > 0.0
        error = np.abs(positions(found) - TRUE_POSITIONS)
        return {"coordinates": (error <= found.coverage_factor * std)[known]}

    return answer


def _acceptance(seed: int) -> Held:
    """Errors of a true arm on an artefact whose certified coordinates are off as they state."""
    arm, true, sigma = arm_named("suta"), artefact(6), 10e-6
    random = np.random.default_rng(seed)
    marks = {
        name: Landmark(
            name, mark.position + sigma * random.standard_normal(3), mark.rotation, sigma
        )
        for name, mark in true.landmarks.items()
    }
    samples = artefact_scene("pairwise_distance", arm, {}, true, placements(1)).samples()[0]
    pairs = PairwiseDistance(ArmPoses(arm, samples), Artefact("certified", marks))
    found = accept(
        AcceptanceMeasurements(LengthErrors.of(pairs)), Limits(LengthLimit(None, 0.0, 100e-6))
    )
    lengths = found.measured.lengths
    assert lengths is not None
    return {"error of a length": np.abs(lengths.error) <= found.length_expanded}


def _repeatability(visits: int) -> Callable[[int], Held]:
    # Distances from the middle of visits that scatter alike along each axis (Maxwell).
    maxwell = stats.maxwell(scale=1e-3)
    rp, rms = maxwell.mean() + 3.0 * maxwell.std(), 1e-3 * math.sqrt(3.0)

    def answer(seed: int) -> Held:
        random = np.random.default_rng(seed)
        found = PositionScatter.of(1e-3 * random.standard_normal((visits, 3)))
        return {
            "RP": np.array([rp in found.rp.interval()]),
            "RMS": np.array([rms in found.rms.interval()]),
        }

    return answer


CASES: Final[dict[str, Case]] = {
    "pivot-8": Case("pivot", "8 poses", 1000, _pivot(8, 100.0, 1e-4)),
    "pivot-40": Case("pivot", "40 poses", 1000, _pivot(40, 100.0, 1e-4)),
    "pivot-scale": Case(
        "pivot", "40 poses, tracker known to 500 ppm", 1000, _pivot(40, 500.0, 1e-4)
    ),
    "register-6": Case("register", "6 points", 1000, _register(6)),
    "register-20": Case("register", "20 points", 1000, _register(20)),
    "hand-eye-8": Case("hand-eye", "8 pairs of poses", 1000, _hand_eye(8)),
    "hand-eye-20": Case("hand-eye", "20 pairs of poses", 1000, _hand_eye(20)),
    "hand-eye-two": Case("hand-eye", "two eyes, two targets, 12 instants", 1000, _many_eyes(12)),
    "pictures": Case("hand-eye", "14 pictures", 200, _pictures(14)),
    "depth-planes": Case(
        "hand-eye", "depth camera, table and wall, 16 pictures", 200, _depth("room", 16)
    ),
    "depth-board": Case("hand-eye", "depth camera, board, 14 pictures", 200, _depth("board", 14)),
    "line-ball": Case("hand-eye", "line scanner, ball, 16 scans", 200, _line(0.02, 16)),
    "line-plane": Case("hand-eye", "line scanner, plane, 24 scans", 200, _line(None, 24)),
    "rig": Case("rig", "two cameras, 16 instants", 200, _rig(16)),
    "certify": Case("certify", "six landmarks, touches of 1 µm", 200, _certify(1e-6)),
    "iso10360": Case("iso10360", "15 lengths, landmarks known to 10 µm", 200, _acceptance),
    "repeatability-15": Case("repeatability", "15 visits", 1000, _repeatability(15)),
    "repeatability-30": Case("repeatability", "30 visits", 1000, _repeatability(30)),
}
