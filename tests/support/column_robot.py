"""A robot of our own on a base that sinks: a column with two joints, an arm with six on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from suta_calib import ArmModel, TiltSensor, TrackedPoint
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import write_samples

# Name, parent, child, origin, axis, kind; the column turns, then lifts.
_JOINTS = (
    ("swing", "base_link", "turret", "0.1 0 0.6", "0 0 1", "revolute"),
    ("lift", "turret", "column", "0 0 0.4", "0 0 1", "prismatic"),
    ("joint_1", "column", "link_1", "0.2 0 1.5", "0 0 1", "revolute"),
    ("joint_2", "link_1", "link_2", "0 0.1 0.1", "0 1 0", "revolute"),
    ("joint_3", "link_2", "link_3", "0 0 0.6", "0 1 0", "revolute"),
    ("joint_4", "link_3", "link_4", "0 0 0.5", "1 0 0", "revolute"),
    ("joint_5", "link_4", "link_5", "0.1 0 0", "0 1 0", "revolute"),
    ("joint_6", "link_5", "link_6", "0 0 0.1", "0 0 1", "revolute"),
    ("mount", "link_6", "tip", "0.05 0.03 0.1", "1 0 0", "fixed"),
)
SENSORS = (TiltSensor("base_link"), TiltSensor("column"))


def column_robot_urdf() -> str:
    """The text of its URDF."""
    links = ("base_link", *(joint[2] for joint in _JOINTS))
    parts = [f'<link name="{name}"/>' for name in links]
    for name, parent, child, xyz, axis, kind in _JOINTS:
        limits = "0 0.8" if kind == "prismatic" else "-2.5 2.5"
        lower, upper = limits.split()
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
            f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint>'
        )
    return "\n".join(['<robot name="column">', *parts, "</robot>"])


@cache
def column_robot(*, sensors: bool = True) -> ArmModel:
    """The robot, with an accelerometer on its base and one on its column, or without."""
    arm = ArmModel.from_urdf(column_robot_urdf(), "tip")
    return arm.with_tilt_sensors(SENSORS) if sensors else arm


@dataclass(frozen=True, eq=False)
class Ground:
    """What the robot stands on, and how it bends: turns per N·m of its load, about two axes.

    Attributes:
        sinks: of the base, rad per kg·m of the load's lever about each horizontal axis.
        bends: of the column against its foot, likewise.
        base_share, column_share: where they turn.
        settles: standard deviation of what the base sinks beside, rad.
        lean: (2,) of the base in the mean, rad.
    """

    sinks: float = 8e-5
    bends: float = 5e-5
    base_share: float = 0.25
    column_share: float = 0.4
    settles: float = 8e-4
    lean: tuple[float, float] = (0.01, -0.006)


GROUND = Ground()
# Masses at the tip, kg: with one alone, what a base sinks looks like a scale of lengths.
LOADS = (5.0, 45.0)
# How the sensors are turned in their links, and what their unit is.
MOUNTS = {"base_link": np.array([0.02, -0.01, 0.4]), "column": np.array([-0.015, 0.01, -0.3])}
GRAVITY = 9.81
STATION = np.array([4.0, -1.0, 0.5])


@dataclass(frozen=True, eq=False)
class Measured:
    """Rows: readings, what sensors felt by link, and what the total station saw."""

    q: FloatArray
    felt: dict[str, FloatArray]
    position: FloatArray
    lean: FloatArray


def built(rng: np.random.Generator) -> dict[str, float]:
    """True values of the robot: millimetres and tenths of a degree off the drawing."""
    arm = column_robot(sensors=False)
    size = {"m": 1.5e-3, "rad": 4e-3}
    names = sorted(n for n in (*arm.geometric, *arm.offsets) if not n.startswith("tip."))
    return {
        name: arm.parameters[name].nominal + size[arm.parameters[name].unit] * float(value)
        for name, value in zip(names, rng.standard_normal(len(names)), strict=True)
    }


def postures(rng: np.random.Generator, n: int) -> FloatArray:
    """Readings all over its range."""
    q = rng.uniform(-1.4, 1.4, (n, 8))
    q[:, 1] = rng.uniform(0.0, 0.8, n)
    q[:, 3] = rng.uniform(0.3, 1.4, n)
    return q


def measured(
    rng: np.random.Generator,
    n: int,
    values: dict[str, float],
    *,
    ground: Ground = GROUND,
    noise: float = 2e-4,
    felt_noise: float = 1e-4,
    station: FloatArray = STATION,
) -> Measured:
    """What is measured of the robot as it is built.

    The load is a mass at the tip: the farther out, the more the base sinks and the column bends
    towards it.

    Args:
        rng: of the postures and of the noise.
        n: rows.
        values: of the robot (`built`).
        ground: what it stands on.
        noise: of a coordinate, m.
        felt_noise: of a component of a direction, rad.
        station: (3,) position of the base in the total station; it is turned by a constant.
    """
    plain, q = column_robot(sensors=False), postures(rng, n)
    arm = column_robot()
    tips = plain.forward(q, values)[1]
    # About y towards the tip's x, about -x towards its y.
    levers = np.column_stack([-tips[:, 1], tips[:, 0], np.zeros(n)])
    levers *= rng.uniform(*LOADS, n)[:, None]
    lean = ground.sinks * levers + [*ground.lean, 0.0]
    lean[:, :2] += ground.settles * rng.standard_normal((n, 2))
    base = rotation_from_vector(lean)
    swing = rotation_from_vector(
        np.outer(q[:, 0] + values.get("swing.offset", 0.0), [0.0, 0.0, 1.0])
    )
    bend = np.einsum("nij,nj->ni", swing.transpose(0, 2, 1), ground.bends * levers)
    # The truth by the model itself, from directions that nothing disturbs.
    up = np.array([0.0, 0.0, 1.0])
    felt_base = base.transpose(0, 2, 1) @ up
    shares = {"tilt[base_link].share": ground.base_share, "tilt[column].share": ground.column_share}
    column = base @ plain.link_poses("column", q, values)[0] @ rotation_from_vector(bend)
    felt_column = column.transpose(0, 2, 1) @ up
    tilt = {"tilt": np.hstack([felt_base, felt_column])}
    position = arm.forward(q, {**values, **shares}, tilt)[1]
    R = rotation_from_vector([0.0, 0.0, 2.0])
    seen = position @ R.T + station + noise * rng.standard_normal((n, 3))
    felt = {}
    for link, vectors in (("base_link", felt_base), ("column", felt_column)):
        mounted = vectors @ rotation_from_vector(MOUNTS[link])
        felt[link] = GRAVITY * (mounted + felt_noise * rng.standard_normal((n, 3)))
    return Measured(q, felt, seen, lean)


def tracked(arm: ArmModel, data: Measured, **more: object) -> TrackedPoint:
    """The rows as a total station saw them, with what the sensors felt where the arm has them."""
    felt = data.felt if arm.tilt_sensors else None
    return TrackedPoint.from_arrays(arm, data.q, position=data.position, felt=felt, **more)


def written(folder: Path, sets: Mapping[str, Measured], *, sensors: bool = True) -> Path:
    """A job's folder: the URDF, a samples file for each set, and ``calibration.yaml``.

    The first set is fitted, the others are held out. The columns of the accelerometers are in the
    files in any case.
    """
    (folder / "robot.urdf").write_text(column_robot_urdf())
    arm = column_robot()
    for name, data in sets.items():
        samples = tracked(arm, data).poses.samples
        write_samples(folder / f"{name}.csv", samples)
    rows = {"observations": [*sets][:1], "validation": [*sets][1:]}
    lines = ["arm:", "  urdf: robot.urdf", "  tip: tip"]
    if sensors:
        lines.append("  tilt_sensors:")
        lines += [f"    - {{link: {s.link}, columns: [{', '.join(s.columns)}]}}" for s in SENSORS]
    lines += ["parameters:", "  - {select: geometric, prior_mm: 2, prior_deg: 0.5}"]
    lines += ['  - {select: "*.offset", prior_mm: 2, prior_deg: 1}']
    for key, names in rows.items():
        lines += [f"{key}:"] if names else []
        lines += [
            f"  - {{kind: tracked_point, samples: {name}.csv, label: {name}}}" for name in names
        ]
    path = folder / "calibration.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path
