"""Simulated measurements: any arm, any artefact, known truth."""

from suta_calib.simulation.inverse_kinematics import InverseKinematics, Postures, Targets
from suta_calib.simulation.noise import NoiseLevels, OutlierSpec
from suta_calib.simulation.output import truth_text, write_simulation
from suta_calib.simulation.schema import (
    ErrorRow,
    PoseSpec,
    SetSpec,
    SimulationSpec,
    read_simulation,
)
from suta_calib.simulation.simulate import SimulatedFile, Simulation, simulate, true_values

__all__ = [
    "ErrorRow",
    "InverseKinematics",
    "NoiseLevels",
    "OutlierSpec",
    "PoseSpec",
    "Postures",
    "SetSpec",
    "SimulatedFile",
    "Simulation",
    "SimulationSpec",
    "Targets",
    "read_simulation",
    "simulate",
    "true_values",
    "truth_text",
    "write_simulation",
]
