"""An emulated arm: everything a passive arm on a serial cable does, without the arm.

A *motion* says what the joints truly do, a *stream* turns it into the bytes a device would send,
with noise and faults, and a *player* sends them in real time on a pseudo-terminal. `EmulatedArm`
does all of it in a process of its own.

Names are imported when they are first used: that process needs neither CasADi nor Pinocchio.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.emulation.device import device_of
    from suta_calib.emulation.emulated import (
        EmulatedDevice,
        EmulationOptions,
        PlayOptions,
        emulated_device,
    )
    from suta_calib.emulation.emulated_arm import EmulatedArm
    from suta_calib.emulation.faults import Faults, Flag, Gap, Window
    from suta_calib.emulation.motion import Curve, Motion, Still, Stops, Sweep, ThereAndBack
    from suta_calib.emulation.player import Played, Player, TrueTrajectory
    from suta_calib.emulation.script import (
        Timing,
        artefact_set,
        placement_within_reach,
        point_set,
        read_script,
        stops,
    )
    from suta_calib.emulation.stream import Emulation, frames
    from suta_calib.emulation.terminal import PseudoTerminal
    from suta_calib.emulation.trajectories import pivoting, posture_of, recorded, sweep
    from suta_calib.emulation.truth import drawn_truth, nominal_values, read_truth

_HOMES = {
    "device": ("device_of",),
    "emulated": ("EmulatedDevice", "EmulationOptions", "PlayOptions", "emulated_device"),
    "emulated_arm": ("EmulatedArm",),
    "faults": ("Faults", "Flag", "Gap", "Window"),
    "motion": ("Curve", "Motion", "Still", "Stops", "Sweep", "ThereAndBack"),
    "player": ("Played", "Player", "TrueTrajectory"),
    "script": (
        "Timing",
        "artefact_set",
        "placement_within_reach",
        "point_set",
        "read_script",
        "stops",
    ),
    "stream": ("Emulation", "frames"),
    "terminal": ("PseudoTerminal",),
    "trajectories": ("pivoting", "posture_of", "recorded", "sweep"),
    "truth": ("drawn_truth", "nominal_values", "read_truth"),
}

__all__ = [
    "Curve",
    "EmulatedArm",
    "EmulatedDevice",
    "Emulation",
    "EmulationOptions",
    "Faults",
    "Flag",
    "Gap",
    "Motion",
    "PlayOptions",
    "Played",
    "Player",
    "PseudoTerminal",
    "Still",
    "Stops",
    "Sweep",
    "ThereAndBack",
    "Timing",
    "TrueTrajectory",
    "Window",
    "artefact_set",
    "device_of",
    "drawn_truth",
    "emulated_device",
    "frames",
    "nominal_values",
    "pivoting",
    "placement_within_reach",
    "point_set",
    "posture_of",
    "read_script",
    "read_truth",
    "recorded",
    "stops",
    "sweep",
]

__getattr__ = lazily(__name__, _HOMES)
