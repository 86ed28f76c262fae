"""What others answer to the same poses: OpenCV's hand-eye, scikit-surgerycalibration's pivot.

Every function takes and gives this project's conventions, m; what a peer cannot solve is an
exception or a number that is not finite. Peers that are not installed are left out. Of pictures
the peer is plain least squares of the reprojection errors, in SciPy.
"""

from __future__ import annotations

import contextlib
import io
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module, metadata
from types import ModuleType

import numpy as np
from scipy.optimize import least_squares

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.geometry import homogeneous, rotation_from_vector
from suta_calib.measurements import Camera
from suta_calib.terms import EyeSetup, Poses, inverse_poses
from suta_calib.units import from_mm, mm

# X from the hand's poses and what the eye saw.
HandEyeMethod = Callable[[Poses, Poses], tuple[FloatArray, FloatArray]]
# The tip from the tool's poses.
PivotMethod = Callable[[Poses], FloatArray]

HAND_EYE = ("TSAI", "PARK", "HORAUD", "DANIILIDIS")
ROBOT_WORLD = ("SHAH", "LI")
# scikit-surgerycalibration's own defaults but for the iterations, of which it takes ten.
RANSAC = {
    "method": "ransac",
    "number_iterations": 100,
    "error_threshold": 4,
    "consensus_threshold": 0.25,
}


def hand_eye_peers() -> tuple[dict[str, HandEyeMethod], str]:
    """OpenCV's methods by name, and who answers: a version, or why nobody does."""
    cv2 = _module("cv2")
    if cv2 is None:
        return {}, "OpenCV is not installed (pip install -e .[bench]): ours runs alone"
    methods = {f"OpenCV {n.title()}": _hand_eye(cv2, n) for n in HAND_EYE}
    methods |= {f"OpenCV {n.title()}, AX = ZB": _robot_world(cv2, n) for n in ROBOT_WORLD}
    return methods, f"OpenCV {cv2.__version__}"


def pivot_peers() -> tuple[dict[str, PivotMethod], str]:
    """scikit-surgerycalibration's methods by name, and who answers, or why nobody does."""
    module = _module("sksurgerycalibration.algorithms.pivot")
    if module is None:
        return (
            {},
            "scikit-surgerycalibration is not installed (pip install -e .[bench]): ours runs alone",
        )
    configurations = {
        "algebraic one step": {"method": "aos"},
        "RANSAC, 100 iterations": RANSAC,
        "sphere fitting": {"method": "sphere_fitting"},
    }
    methods = {f"sksurgery {n}": _pivot(module, c) for n, c in configurations.items()}
    return methods, f"scikit-surgerycalibration {metadata.version('scikit-surgerycalibration')}"


@dataclass(frozen=True, eq=False)
class Pictures:
    """Corners of a board in pictures that a robot took, or was in.

    Attributes:
        setup: where the camera is; the board is on the other.
        hand: (n, 4, 4) ``T_base_hand`` of every picture, m.
        picture: (m,) row of ``hand`` for every corner.
        points: (m, 3) corners on the board, m.
        pixels: (m, 2) where they were seen, px.
    """

    setup: EyeSetup
    hand: FloatArray
    picture: IntArray
    points: FloatArray
    pixels: FloatArray

    def take(self, rows: BoolArray) -> Pictures:
        """Some pictures (n,) alone."""
        used = rows[self.picture]
        return replace(
            self,
            picture=self.picture[used],
            points=self.points[used],
            pixels=self.pixels[used],
        )

    def errors(self, X: FloatArray, Z: FloatArray, camera: Camera) -> FloatArray:
        """Reprojection errors (m, 2), px, with the robot's poses as they are."""
        seen = (
            np.linalg.inv(self.hand @ X) @ Z
            if self.setup == "eye-in-hand"
            else np.linalg.inv(X) @ self.hand @ Z
        )[self.picture]
        there = np.einsum("nij,nj->ni", seen[:, :3, :3], self.points) + seen[:, :3, 3]
        return np.asarray(camera.project(there) - self.pixels)

    def least_squares(
        self, X: FloatArray, Z: FloatArray, camera: Camera, *, free: bool
    ) -> tuple[FloatArray, FloatArray, Camera]:
        """X, Z and the camera with the least squared errors, begun at those given.

        The robot's poses are taken as exact. ``free`` estimates the intrinsics too.
        """
        unit = np.array([100.0] * 4 + [0.1] * (len(camera.intrinsics) - 4))

        def frames(step: FloatArray) -> tuple[FloatArray, FloatArray, Camera]:
            moved = [
                T @ homogeneous(rotation_from_vector(part[3:]), part[:3])
                for T, part in ((X, step[:6]), (Z, step[6:12]))
            ]
            values = camera.intrinsics + (unit * step[12:] if free else 0.0)
            return moved[0], moved[1], replace(camera, intrinsics=values, covariance=None)

        start = np.zeros(12 + (len(unit) if free else 0))
        found = least_squares(lambda step: self.errors(*frames(step)).ravel(), start, x_scale="jac")
        return frames(found.x)


def _module(name: str) -> ModuleType | None:
    try:
        return import_module(name)
    except ImportError:
        return None


def _hand_eye(cv2: ModuleType, name: str) -> HandEyeMethod:
    """``gripper2base`` is ``T_base_hand``; the answer ``cam2gripper`` is ``T_hand_eye``."""
    method = getattr(cv2, f"CALIB_HAND_EYE_{name}")

    def solve(hand: Poses, seen: Poses) -> tuple[FloatArray, FloatArray]:
        R, t = cv2.calibrateHandEye(*_lists(hand), *_lists(seen), method=method)
        return R, np.ravel(t)

    return solve


def _robot_world(cv2: ModuleType, name: str) -> HandEyeMethod:
    """``base2gripper`` is ``T_hand_base``; the answer ``gripper2cam`` is ``T_eye_hand``."""
    method = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}")

    def solve(hand: Poses, seen: Poses) -> tuple[FloatArray, FloatArray]:
        found = cv2.calibrateRobotWorldHandEye(
            *_lists(seen), *_lists(inverse_poses(hand)), method=method
        )
        return inverse_poses((found[2], np.ravel(found[3])))

    return solve


def _lists(poses: Poses) -> tuple[list[FloatArray], list[FloatArray]]:
    return list(poses[0]), [p.reshape(3, 1) for p in poses[1]]


def _pivot(module: ModuleType, configuration: dict[str, object]) -> PivotMethod:
    """It works in mm, and draws from Python's own random numbers."""

    def solve(poses: Poses) -> FloatArray:
        matrices = np.tile(np.eye(4), (len(poses[1]), 1, 1))
        matrices[:, :3, :3], matrices[:, :3, 3] = poses[0], mm(poses[1])
        random.seed(0)
        with contextlib.redirect_stdout(io.StringIO()):
            tip = module.pivot_calibration(matrices, configuration)[0]
        return from_mm(np.ravel(tip))

    return solve
