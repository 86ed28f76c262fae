"""An emulated arm: everything a passive arm on a serial cable does, without the arm.

A *motion* says what the joints truly do, a *stream* turns it into the bytes a device would send,
with noise and faults, and a *player* sends them in real time on a pseudo-terminal. `EmulatedArm`
does all of it in a process of its own.

Names are imported when they are first used: that process needs neither CasADi nor Pinocchio.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.emulation.device import device_of as device_of
    from suta_calib.emulation.emulated import EmulatedDevice as EmulatedDevice
    from suta_calib.emulation.emulated import EmulationOptions as EmulationOptions
    from suta_calib.emulation.emulated import PlayOptions as PlayOptions
    from suta_calib.emulation.emulated import emulated_device as emulated_device
    from suta_calib.emulation.emulated_arm import EmulatedArm as EmulatedArm
    from suta_calib.emulation.faults import Faults as Faults
    from suta_calib.emulation.faults import Flag as Flag
    from suta_calib.emulation.faults import Gap as Gap
    from suta_calib.emulation.faults import Window as Window
    from suta_calib.emulation.motion import Curve as Curve
    from suta_calib.emulation.motion import Motion as Motion
    from suta_calib.emulation.motion import Still as Still
    from suta_calib.emulation.motion import Stops as Stops
    from suta_calib.emulation.motion import Sweep as Sweep
    from suta_calib.emulation.motion import ThereAndBack as ThereAndBack
    from suta_calib.emulation.player import Played as Played
    from suta_calib.emulation.player import Player as Player
    from suta_calib.emulation.player import TrueTrajectory as TrueTrajectory
    from suta_calib.emulation.script import Timing as Timing
    from suta_calib.emulation.script import artefact_set as artefact_set
    from suta_calib.emulation.script import placement_within_reach as placement_within_reach
    from suta_calib.emulation.script import point_set as point_set
    from suta_calib.emulation.script import read_script as read_script
    from suta_calib.emulation.script import stops as stops
    from suta_calib.emulation.stream import Emulation as Emulation
    from suta_calib.emulation.stream import frames as frames
    from suta_calib.emulation.terminal import PseudoTerminal as PseudoTerminal
    from suta_calib.emulation.trajectories import pivoting as pivoting
    from suta_calib.emulation.trajectories import posture_of as posture_of
    from suta_calib.emulation.trajectories import recorded as recorded
    from suta_calib.emulation.trajectories import sweep as sweep
    from suta_calib.emulation.truth import drawn_truth as drawn_truth
    from suta_calib.emulation.truth import nominal_values as nominal_values
    from suta_calib.emulation.truth import read_truth as read_truth

__getattr__, __all__ = public(__name__)
