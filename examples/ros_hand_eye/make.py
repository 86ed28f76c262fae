"""Simulated samples as easy_handeye2 keeps them: `python examples/ros_hand_eye/make.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.measurements import write_text

FILE = Path(__file__).parent / "samples.yaml"
# T_hand_eye and T_base_target: position, m, and roll pitch yaw, deg.
EYE = (0.045, -0.020, 0.062), (-1.5, 2.0, 89.0)
TARGET = (0.550, 0.080, 0.020), (0.4, -0.7, 25.0)
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


def main() -> None:
    """Write the samples."""
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
        seen[:3, 3] += NOISE * random.standard_normal(3)
        turn = Rotation.from_rotvec(TURN_NOISE * random.standard_normal(3)).as_matrix()
        seen[:3, :3] = seen[:3, :3] @ turn
        lines += [*lines_of("robot", robot, "- "), *lines_of("tracking", seen, "  ")]
    write_text(FILE, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
