"""Simulate a tracked pointer that pivots on two posts: `python examples/pivot_tool/make.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.measurements import write_text

FILE = Path(__file__).parent / "poses.csv"
# In the pointer's frame, and in the tracker's, m.
TIP = np.array([0.0021, -0.0187, 0.1634])
POSTS = {"near": np.array([0.08, -0.05, -1.10]), "far": np.array([-0.06, 0.07, -1.62])}
POSES_PER_POST = 40
# Of a coordinate, m, and of the turn about an axis, rad: what optical trackers state.
NOISE, TURN_NOISE = 0.15e-3, np.radians(0.05)
# Rows in which the tip had slipped off its post, by 4 to 12 mm.
SLIPPED = (11, 52, 53)


def main() -> None:
    """Write the poses."""
    random = np.random.default_rng(5)
    labels = [name for name in POSTS for _ in range(POSES_PER_POST)]
    # Leaning up to 40 degrees to any side, and turned about the pointer's own axis.
    heading, lean = random.uniform(0, 2 * np.pi, len(labels)), random.uniform(0, 40, len(labels))
    axes = np.column_stack([np.cos(heading), np.sin(heading), np.zeros(len(labels))])
    about_axis = Rotation.from_euler("z", random.uniform(-90, 90, (len(labels), 1)), degrees=True)
    turned = Rotation.from_rotvec(np.radians(lean)[:, None] * axes) * about_axis
    post = np.array([POSTS[label] for label in labels])
    post[list(SLIPPED)] += random.uniform(4e-3, 12e-3, (len(SLIPPED), 3))
    position = post - turned.apply(TIP) + NOISE * random.standard_normal(post.shape)
    seen = turned * Rotation.from_rotvec(TURN_NOISE * random.standard_normal(post.shape))
    rows = np.hstack([position, seen.as_quat(canonical=True)])
    lines = [
        ",".join([label, *(f"{x:.7f}" for x in row)])
        for label, row in zip(labels, rows, strict=True)
    ]
    write_text(FILE, "\n".join(["point,x,y,z,qx,qy,qz,qw", *lines]) + "\n")


if __name__ == "__main__":
    main()
