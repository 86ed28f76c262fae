"""Raw points that an instrument would write of a known artefact: simulated, for tests and examples.

The artefact stands anywhere, as on a laboratory's floor plate; its true frame is that of the
landmarks given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector, rpy_from_rotation
from suta_calib.measurements import Artefact, Landmark

HEADER: Final = "feature,landmark,index,x,y,z"
Row = tuple[str, str, int, FloatArray]


@dataclass(frozen=True, eq=False)
class ProbingPattern:
    """Where the instrument touches, m."""

    half: float = 0.09  # half of the plate's edge
    ground: int = 5  # touches of the ground along either edge of a square grid
    top: float = 0.004  # distance of the four outer touches of a top from its centre
    hole: float = 0.007  # distance of a reference hole from the pillar's axis
    hole_depth: float = 0.012  # of the holes under the top
    flat: float = 0.005  # distance of a flat from the pillar's axis
    side: int = 12  # touches of the side plane, at y = -half, in two rows
    # Lengths by name.
    spacers: Mapping[str, float] = field(default_factory=lambda: {"A": 0.04, "B": 0.1})


def exact_rows(truth: Artefact, design: ProbingPattern = ProbingPattern()) -> list[Row]:
    """Touches without noise in the artefact's own frame: feature, landmark, index, (3,) in m."""
    grid = np.linspace(-0.95, 0.95, design.ground) * design.half
    rows: list[Row] = [
        ("ground", "", k, np.array([x, y, 0.0]))
        for k, (x, y) in enumerate((x, y) for x in grid for y in grid)
    ]
    for name, mark in truth.landmarks.items():
        rows += _pillar_rows(name, mark, design)
    along = np.linspace(-0.9, 0.9, (design.side + 1) // 2) * design.half
    for k in range(design.side):
        height = -0.004 if k % 2 else -0.012
        rows.append(("side", "", k, np.array([along[k // 2], -design.half, height])))
    for name, length in design.spacers.items():
        ends = (np.array([0.2, 0.05, 0.0]), np.array([0.2, 0.05 + length, 0.0]))
        rows += [("spacer", name, k, end) for k, end in enumerate(ends)]
    return rows


def _pillar_rows(name: str, mark: Landmark, design: ProbingPattern) -> list[Row]:
    x, y, z = mark.position
    yaw = 0.0 if mark.rotation is None else float(rpy_from_rotation(mark.rotation)[2])
    around = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]], dtype=float)
    c, s = np.cos(yaw), np.sin(yaw)
    turned = around @ np.array([[c, s], [-s, c]])
    places = np.vstack([[0.0, 0.0], turned])
    rows: list[Row] = []
    for k, (dx, dy) in enumerate(design.top * places):
        rows.append(("top", name, k, np.array([x + dx, y + dy, z])))
    for k, (dx, dy) in enumerate(design.hole * turned):
        rows.append(("hole", name, k, np.array([x + dx, y + dy, z - design.hole_depth])))
    if mark.rotation is not None:
        for k, sign in enumerate((1.0, -1.0)):
            dx, dy = sign * design.flat * turned[0]
            rows.append(("flat", name, k, np.array([x + dx, y + dy, z - design.hole_depth / 2])))
    return rows


def csv_text(
    rows: list[Row], sigma: float, random: np.random.Generator, note: str = "simulated"
) -> str:
    """The file an instrument with this noise would write of these touches, from where it stands.

    Args:
        rows: exact touches in the artefact's frame.
        sigma: standard deviation of each coordinate, m.
        random: of the noise and of where the artefact stands.
        note: comment in the first line.
    """
    position = np.array([row[3] for row in rows])
    turn = rotation_from_vector(random.uniform(-1.5, 1.5, 3))
    measured = position @ turn.T + random.uniform(-2.0, 2.0, 3)
    measured += sigma * random.standard_normal(measured.shape)
    lines = [
        f"{feature},{name},{index}," + ",".join(f"{v:.9f}" for v in point)
        for (feature, name, index, _), point in zip(rows, measured, strict=True)
    ]
    return "\n".join([f"# {note}", HEADER, *lines]) + "\n"
