"""Simulated samples as easy_handeye2 keeps them: `python examples/ros_hand_eye/make.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.measurements import write_text

FILE = Path(__file__).parent / "samples.yaml"
BESIDE_FILE = Path(__file__).parent / "camera_beside.yaml"
# T_hand_eye and T_base_target: position, m, and roll pitch yaw, deg.
EYE = (0.045, -0.020, 0.062), (-1.5, 2.0, 89.0)
TARGET = (0.550, 0.080, 0.020), (0.4, -0.7, 25.0)
# The other setup: T_base_eye of a camera beside the robot, and T_hand_target.
BESIDE = (0.850, 0.120, 0.620), (-115.0, 2.0, 88.0)
HELD = (0.010, -0.020, 0.060), (3.0, -4.0, 45.0)
# Of what the camera sees: a coordinate, m, and the turn about an axis, rad.
NOISE, TURN_NOISE = 0.4e-3, np.radians(0.08)
SAMPLES = 25


def transform(place: tuple[float, ...], rpy_deg: tuple[float, ...]) -> np.ndarray:
    """A 4x4 matrix."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix()
    T[:3, 3] = place
    return T


def lines_of(name: str, T: np.ndarray, indent: str) -> list[str]:
    """A ``geometry_msgs/Transform`` as YAML."""
    q = Rotation.from_matrix(T[:3, :3]).as_quat()
    parts = ("translation", "xyz", T[:3, 3]), ("rotation", "xyzw", q)
    lines = [f"{indent}{name}:"]
    for part, keys, values in parts:
        lines.append(f"    {part}:")
        lines += [f"      {key}: {value:.9f}" for key, value in zip(keys, values, strict=True)]
    return lines


def noisy(T: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """As the camera reports it."""
    shaken = T.copy()
    shaken[:3, 3] += NOISE * random.standard_normal(3)
    turn = Rotation.from_rotvec(TURN_NOISE * random.standard_normal(3)).as_matrix()
    shaken[:3, :3] = shaken[:3, :3] @ turn
    return shaken


def main() -> None:
    """Write the samples of a camera on the hand, and of one beside the robot."""
    random = np.random.default_rng(11)
    eye, target = transform(*EYE), transform(*TARGET)
    lines = ["samples:"]
    for _ in range(SAMPLES):
        # The camera looks at the target from 0.35 to 0.5 m, leaning by up to 35 degrees.
        lean = Rotation.from_euler(
            "xyz", random.uniform((-35, -35, -70), (35, 35, 70)), degrees=True
        )
        seen = np.eye(4)
        seen[:3, :3] = (lean * Rotation.from_euler("x", 180, degrees=True)).as_matrix()
        seen[:3, 3] = random.uniform((-0.05, -0.05, 0.35), (0.05, 0.05, 0.5))
        robot = target @ np.linalg.inv(seen) @ np.linalg.inv(eye)
        seen = noisy(seen, random)
        lines += [*lines_of("robot", robot, "- "), *lines_of("tracking", seen, "  ")]
    write_text(FILE, "\n".join(lines) + "\n")

    beside, held = transform(*BESIDE), transform(*HELD)
    lines = ["samples:"]
    for _ in range(SAMPLES):
        place = random.uniform((0.35, -0.15, 0.25), (0.60, 0.15, 0.50))
        lean = random.uniform((145, -35, -60), (215, 35, 60))
        hand = transform(tuple(place), tuple(lean))
        seen = noisy(np.linalg.inv(beside) @ hand @ held, random)
        # The base in the hand, as easy_handeye2 records it in this setup.
        lines += lines_of("robot", np.linalg.inv(hand), "- ")
        lines += lines_of("tracking", seen, "  ")
    write_text(BESIDE_FILE, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
