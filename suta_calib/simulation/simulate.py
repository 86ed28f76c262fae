"""From a simulation's description to samples, with the truth they were made from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suta_calib.errors import JobError
from suta_calib.geometry import FloatArray
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
from suta_calib.simulation.schema import TOUCHED_ARTEFACT, SetSpec, SimulationSpec
from suta_calib.simulation.truth import true_values


@dataclass(frozen=True, eq=False)
class SimulatedFile:
    """One samples file.

    Attributes:
        path: relative to the output folder, such as ``calibration/P1.csv``.
        samples: what it holds; the origins name its lines.
        displacement: (n, 3) gross error of each row in the base's (tracked: the instrument's)
            frame, m; zero for all but the outliers.
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
        values: true values, m or rad, of the parameters that depart from nominal.
        artefacts: true artefacts by the name of the set, where they differ from the certified.
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
    visitor = Visitor(spec, kinematics, _posture(spec, arm, kinematics), seed)
    files: list[SimulatedFile] = []
    artefacts: dict[str, Artefact] = {}
    for plan in spec.sets:
        if plan.kind == "tracked_point":
            progress(f"{plan.name}/samples.csv")
            files.append(_tracked(plan, kinematics, values, seed))
            continue
        if plan.artefact is not None:
            certified = read_artefact(plan.artefact)
            truth = _true_artefact(certified, plan, seed)
            if plan.noise.artefact:
                artefacts[plan.name] = truth
        for label in (plan.placements or plan.points or {}):
            progress(f"{plan.name}/{label}.csv")
            if plan.kind in TOUCHED_ARTEFACT and plan.placements:
                visits = visitor.artefact(plan, label, plan.placements[label], truth)
            else:
                visits = visitor.fixed_point(plan, label, (plan.points or {})[label])
            files.append(_touched(plan, visits, visitor))
    return Simulation(spec, seed, arm, values, artefacts, tuple(files))
