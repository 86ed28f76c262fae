"""Simulated measurements: any arm, any artefact, known truth.

Names are imported when they are first used: who only asks where an arm can go simulates nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.simulation.inverse_kinematics import InverseKinematics as InverseKinematics
    from suta_calib.simulation.inverse_kinematics import Postures as Postures
    from suta_calib.simulation.inverse_kinematics import Targets as Targets
    from suta_calib.simulation.noise import NoiseLevels as NoiseLevels
    from suta_calib.simulation.noise import OutlierSpec as OutlierSpec
    from suta_calib.simulation.output import still_empty as still_empty
    from suta_calib.simulation.output import truth_text as truth_text
    from suta_calib.simulation.output import write_simulation as write_simulation
    from suta_calib.simulation.schema import ErrorRow as ErrorRow
    from suta_calib.simulation.schema import PoseSpec as PoseSpec
    from suta_calib.simulation.schema import SetSpec as SetSpec
    from suta_calib.simulation.schema import SimulationSpec as SimulationSpec
    from suta_calib.simulation.schema import read_simulation as read_simulation
    from suta_calib.simulation.simulated import SimulatedFile as SimulatedFile
    from suta_calib.simulation.simulated import Simulation as Simulation
    from suta_calib.simulation.simulated import simulate as simulate
    from suta_calib.simulation.simulated import true_values as true_values

__getattr__, __all__ = public(__name__)
