"""Make the simulated example files of this folder again: ``python data/accuracy/make.py``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements import Artefact, Samples, read_artefact, write_samples, write_text
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Selection
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.simulation.inverse_kinematics import Matching

FOLDER = Path(__file__).resolve().parent
ARM = ArmModel.from_urdf(FOLDER / "../../urdf/suta.urdf", "tip")
# Where a hand would hold the arm; the first search starts from here.
POSTURE = np.radians([15.0, 175.0, 160.0, 110.0, -90.0, -125.0])
STEP = 2 * np.pi / 2**22
DOWN = rotation_from_rpy([np.pi, 0.0, 0.2])
POINT = np.array([0.42, 0.1, 0.05])
# The arm of the acceptance test was calibrated: what is left of its errors, m and rad.
LEFT_LENGTH, LEFT_ANGLE = 25e-6, 4e-5


def main() -> None:
    """Write all files."""
    protocols()
    pushes()
    stationary()
    acceptance()


def protocols() -> None:
    """One point visited thirty times freely, and thirty times along a guide."""
    random = np.random.default_rng(1)
    protocol = ["free"] * 30 + ["guided"] * 30
    size = np.where(np.array(protocol) == "free", 0.95e-3, 0.45e-3)[:, None] / np.sqrt(3)
    position = POINT + size * random.standard_normal((60, 3))
    write("visits", reached({}, position, tilted(random, 60, 0.3)), protocol=protocol)


def pushes() -> None:
    """One seat, the tip pushed four ways: joint 4 has 0.1° of play, which its encoder sees."""
    random = np.random.default_rng(2)
    direction = [("left", "right", "back", "front")[k % 4] for k in range(48)]
    position = POINT + 0.05e-3 * random.standard_normal((48, 3))
    q = reached({}, position, tilted(random, 48, 0.05))
    sign = {"left": 0.5, "right": -0.5}
    q[:, 3] += np.radians(0.1) * np.array([sign.get(each, 0.0) for each in direction])
    write("pushes", q, direction=direction)


def stationary() -> None:
    """A hundred seconds at rest, 20 Hz: joint 4 drifts, joint 5 rests at ±π, joint 6 is noisy."""
    random = np.random.default_rng(3)
    time = np.arange(2000) / 20.0
    mean = np.array([0.26, 2.2, -0.3, 1.9, np.pi, -2.1])
    std = np.radians([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1.5e-3])
    q = mean + std * random.standard_normal((2000, 6))
    q[:, 3] += np.radians(0.03) * time / 3600.0 * 10
    q = np.angle(np.exp(1j * STEP * np.round(q / STEP)))
    rows = [
        ",".join([f"{t:.6f}", *(f"{value:.9f}" for value in row)])
        for t, row in zip(time, q, strict=True)
    ]
    write_text(
        FOLDER / "stationary.csv", "\n".join([",".join(["time", *ARM.joints]), *rows]) + "\n"
    )


def acceptance() -> None:
    """Lengths of the artefact, a seat from many elbows, and two spheres probed."""
    random = np.random.default_rng(4)
    truth = left_errors(random)
    artefact = read_artefact(FOLDER / "../suta/artefact.yaml")
    rows, labels = lengths(random, artefact)
    write("lengths", reached(truth, *rows), **labels)
    elbows(random, truth)
    spheres(random, truth)
    position = POINT + 12e-6 * random.standard_normal((30, 3))
    write("repeated", reached(truth, position, tilted(random, 30, 0.02)), point=["seat"] * 30)


def left_errors(random: np.random.Generator) -> dict[str, float]:
    """True parameters of the calibrated arm: its URDF is a little wrong everywhere."""
    every = ARM.select(Selection(("*.offset", "geometric")))
    size = {"m": LEFT_LENGTH, "rad": LEFT_ANGLE}
    return {p.name: p.nominal + size[p.unit] * random.standard_normal() for p in every.values()}


def lengths(
    random: np.random.Generator, artefact: Artefact
) -> tuple[tuple[FloatArray, FloatArray], dict[str, list[str]]]:
    """Seven landmarks of the artefact, seated twice at each of five places."""
    marks = {name: artefact.landmark(name) for name in ("O", "M1", "M3", "L3", "L4", "S1", "S4")}
    places = {"A": (0.5125, 0.0125, -105), "B": (0.4625, -0.0375, 15), "C": (0.4625, 0.0625, 30)}
    places |= {"D": (0.5125, 0.1125, 30), "E": (0.5125, -0.0875, -120)}
    true = {n: m.position + m.sigma * random.standard_normal(3) for n, m in marks.items()}
    position, rotation = [], []
    labels: dict[str, list[str]] = {"placement": [], "repeat": [], "landmark": []}
    for place, (x, y, yaw) in places.items():
        turn = rotation_from_rpy([0.0, 0.0, np.radians(yaw)])
        for repeat in "12":
            for name, mark in marks.items():
                seat = turn @ true[name] + [x, y, 0.0] + 10e-6 * random.standard_normal(3)
                position.append(seat)
                rotation.append(turn @ mark.rotation)
                for key, value in zip(labels, (place, repeat, name), strict=True):
                    labels[key].append(value)
    return (np.array(position), np.array(rotation)), labels


def elbows(random: np.random.Generator, truth: dict[str, float]) -> None:
    """Two seats, each from five elbow positions, five touches of each."""
    position, rotation = [], []
    labels: dict[str, list[str]] = {"point": [], "articulation": []}
    for point, place in {"near": (0.35, 0.05, 0.05), "far": (0.5, -0.1, 0.1)}.items():
        for elbow in range(5):
            lean = Rotation.from_euler("xy", random.uniform(-30, 30, 2), degrees=True)
            for _ in range(5):
                position.append(np.array(place) + 10e-6 * random.standard_normal(3))
                rotation.append(lean.as_matrix() @ DOWN)
                labels["point"].append(point)
                labels["articulation"].append(f"elbow_{elbow + 1}")
    write("articulation", reached(truth, np.array(position), np.array(rotation), "axis"), **labels)


def spheres(random: np.random.Generator, truth: dict[str, float]) -> None:
    """A sphere of 25 mm probed with a ball of 6 mm at 25 points, in two places."""
    position, labels = [], []
    for name, place in {"near": (0.35, 0.0, 0.1), "far": (0.52, 0.1, 0.1)}.items():
        for k in range(25):
            height, around = 1.0 - k / 25.0, k * np.pi * (3 - np.sqrt(5))
            flat = np.sqrt(1 - height**2)
            normal = np.array([flat * np.cos(around), flat * np.sin(around), height])
            radius = (25e-3 + 6e-3) / 2 + 5e-6 * random.standard_normal()
            position.append(np.array(place) + radius * normal)
            labels.append(name)
    rotation = np.broadcast_to(DOWN, (len(position), 3, 3))
    write("probing", reached(truth, np.array(position), rotation, "axis"), sphere=labels)


def tilted(random: np.random.Generator, n: int, limit: float) -> FloatArray:
    """Orientations (n, 3, 3) about that of a seat, ``limit`` degrees off on each axis."""
    turns = Rotation.from_rotvec(np.radians(limit) * random.standard_normal((n, 3)))
    return turns.as_matrix() @ DOWN


def reached(
    truth: dict[str, float],
    position: FloatArray,
    rotation: FloatArray,
    matching: Matching = "pose",
) -> FloatArray:
    """Readings (n, 6) of 22-bit encoders at which the true arm's tip has these poses."""
    search, random = InverseKinematics(ARM, truth), np.random.default_rng(0)
    first = search.solve(Targets(position[:1], rotation[:1], matching), POSTURE, random).q
    found = search.solve(Targets(position, rotation, matching), first[0], random)
    assert found.reached.all(), "out of reach"
    return np.angle(np.exp(1j * STEP * np.round(found.q / STEP)))


def write(name: str, q: FloatArray, **labels: list[str]) -> None:
    """A samples file."""
    write_samples(
        FOLDER / f"{name}.csv", Samples.from_arrays(ARM.joints, q.round(9), labels=labels)
    )


if __name__ == "__main__":
    main()
