"""From a simulation's description to samples, with the truth they were made from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Artefact, Samples, read_artefact
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.simulation.noise import (
    encoder_readings,
    outlier_displacements,
    scattered_rotations,
    stream,
    wrapped,
)
from suta_calib.simulation.protocol import Visitor, Visits
from suta_calib.simulation.schema import SEEN_FROM_AFAR, SetSpec, SimulationSpec
from suta_calib.simulation.truth import true_values


@dataclass(frozen=True, eq=False)
class SimulatedFile:
    """One samples file.

    Attributes:
        path: relative to the output folder, such as ``calibration/P1.csv``.
        samples: what it holds; the origins name its lines.
        displacement: (n, 3) gross error of each row in the base's frame (what was seen from afar:
            in the instrument's or the camera's), m; zero for all but the outliers.
    """

    path: str
    samples: Samples
    displacement: FloatArray

    @property
    def outliers(self) -> NDArray[np.intp]:
        """Numbers of the rows that are grossly wrong, from 0."""
        return np.flatnonzero(self.displacement.any(axis=1))


@dataclass(frozen=True, eq=False)
class Simulation:
    """Simulated samples and the truth behind them.

    Attributes:
        spec: the description.
        seed: that was used.
        arm: the nominal arm.
        values: true values of all the arm's parameters, m or rad.
        artefacts: by the name of the set, the true artefact it was made with.
        files: the samples.
    """

    spec: SimulationSpec
    seed: int
    arm: ArmModel
    values: dict[str, float]
    artefacts: dict[str, Artefact]
    files: tuple[SimulatedFile, ...]


def simulate(
    spec: SimulationSpec, seed: int | None = None, progress: Callable[[str], Any] = lambda _: None
) -> Simulation:
    """Simulate every set; the same specification and seed give the same numbers.

    Args:
        spec: what to simulate.
        seed: in place of the specification's.
        progress: called with the path of each file before it is made.

    Raises:
        JobError: a key contradicts the arm, or a target is out of reach.
        UrdfError, ArtefactError: a file it names cannot be used.
    """
    seed = spec.seed if seed is None else seed
    arm = ArmModel.from_urdf(spec.urdf, spec.tip, spec.base)
    values = true_values(arm, spec, seed)
    kinematics = InverseKinematics(arm, values)
    visitor = Visitor(spec, kinematics, _posture(spec, kinematics), seed)
    artefacts = {p.name: _true_artefact(p, seed) for p in spec.sets if p.artefact is not None}
    files: list[SimulatedFile] = []
    for plan in spec.sets:
        for label in plan.placements or plan.points or ("samples",):
            progress(f"{plan.name}/{label}.csv")
            if plan.kind in SEEN_FROM_AFAR:
                files.append(_seen(plan, label, kinematics, values, seed))
            else:
                visits = _visits(plan, label, visitor, artefacts)
                files.append(_touched(plan, visits, visitor))
    return Simulation(spec, seed, arm, values, artefacts, tuple(files))


def _posture(spec: SimulationSpec, kinematics: InverseKinematics) -> FloatArray:
    posture = kinematics.middle
    arm = kinematics.arm
    for row in spec.posture:
        place: dict[str, Any] = {"file": spec.path, "line": row.line, "where": row.key}
        if row.joint not in arm.joints:
            raise JobError(f"no joint {row.joint!r}", f"one of {', '.join(arm.joints)}", **place)
        unit = arm.parameters[f"{row.joint}.offset"].unit
        if row.unit != unit:
            raise JobError(f"a reading in {row.unit}", f"one in {unit} for this joint", **place)
        posture[arm.joints.index(row.joint)] = row.reading
    return posture


def _true_artefact(plan: SetSpec, seed: int) -> Artefact:
    """The certified artefact, or one that departs from it: the same for every set that uses it."""
    assert plan.artefact is not None
    certified = read_artefact(plan.artefact)
    if not plan.noise.artefact:
        return certified
    landmarks = {
        name: replace(mark, position=mark.position + mark.sigma * rng.standard_normal(3))
        for name, mark in certified.landmarks.items()
        for rng in [stream(seed, "artefact", plan.artefact.name, name)]
    }
    return Artefact(certified.name, landmarks)


def _visits(
    plan: SetSpec, label: str, visitor: Visitor, artefacts: Mapping[str, Artefact]
) -> Visits:
    if plan.placements is not None:
        return visitor.artefact(plan, label, plan.placements[label], artefacts[plan.name])
    return visitor.fixed_point(plan, label, (plan.points or {})[label])


def _touched(plan: SetSpec, visits: Visits, visitor: Visitor) -> SimulatedFile:
    """Readings at every touch: seated imperfectly, reached exactly, read with noise."""
    n, arm = len(visits.targets), visitor.kinematics.arm
    rng = stream(visitor.seed, plan.name, visits.name, "seating")
    displacement = _displacement(plan, visits.name, n, visitor.seed)
    position = visits.targets.position + plan.noise.seating * rng.standard_normal((n, 3))
    tilt = scattered_rotations(rng, plan.noise.seating_angle, n)
    shift = visits.targets.rotation @ np.array([*plan.seating[:2], 0.0])
    turned = visits.targets.rotation @ rotation_from_vector([0.0, 0.0, plan.seating[2]])
    targets = Targets(position + shift + displacement, turned @ tilt)
    again = stream(visitor.seed, plan.name, visits.name, "touches")
    q = visitor.reach(visits, targets, visits.start, again, f"sets.{plan.name}.{plan.places}")
    noise = stream(visitor.seed, plan.name, visits.name, "encoders")
    readings = encoder_readings(noise, plan.noise, arm, q)
    path = f"{plan.name}/{visits.name}.csv"
    origin = _origins(path, n)
    samples = Samples.from_arrays(arm.joints, readings, labels=visits.labels, origin=origin)
    return SimulatedFile(path, samples, displacement)


def _seen(
    plan: SetSpec,
    label: str,
    kinematics: InverseKinematics,
    values: Mapping[str, float],
    seed: int,
) -> SimulatedFile:
    """What an external instrument sees of the tip, or a camera on it, in random configurations."""
    arm, n, noise = kinematics.arm, plan.samples, plan.noise
    rng = stream(seed, plan.name, "configurations")
    q = wrapped(arm, kinematics.random_readings(rng, n))
    rotation, position = _observed(plan, *arm.forward(q, values))
    rng = stream(seed, plan.name, "instrument")
    displacement = _displacement(plan, label, n, seed)
    seen = position + displacement + noise.instrument * rng.standard_normal((n, 3))
    turned = rotation @ scattered_rotations(rng, noise.instrument_angle, n)
    readings = encoder_readings(stream(seed, plan.name, "encoders"), noise, arm, q)
    path = f"{plan.name}/{label}.csv"
    samples = Samples.from_arrays(
        arm.joints,
        readings,
        position=seen,
        rotation=turned if plan.orientation or plan.kind == "hand_eye" else None,
        origin=_origins(path, n),
    )
    return SimulatedFile(path, samples, displacement)


def _observed(
    plan: SetSpec, rotation: FloatArray, position: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """From tip poses in the base: tip in the instrument, or target in the camera."""
    eye, target, base = plan.eye_in_tip, plan.target_in_base, plan.base_in_instrument
    if eye is not None and target is not None:
        back = np.swapaxes(rotation @ eye.rotation, 1, 2)
        at_eye = position + rotation @ eye.position
        return back @ target.rotation, np.einsum("nij,nj->ni", back, target.position - at_eye)
    if base is not None:
        return base.rotation @ rotation, position @ base.rotation.T + base.position
    return rotation, position


def _displacement(plan: SetSpec, label: str, n: int, seed: int) -> FloatArray:
    return outlier_displacements(stream(seed, plan.name, label, "outliers"), plan.outliers, n)


def _origins(path: str, n: int) -> list[str]:
    """``folder/file.csv:2`` for the first row: the header is line 1."""
    return [f"{path}:{row + 2}" for row in range(n)]
