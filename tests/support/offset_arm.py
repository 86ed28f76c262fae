"""An arm whose joints' offsets are off, what is unknown of it, and its tip as it was seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from simulated import Scene, Spread, arm_named, random_readings, tracked_scene

from suta_calib import ArmModel, ParameterSet, Selection, SolverOptions

NOISE = Spread(position=1e-4, rotation=1e-3)
ONCE = SolverOptions(starts=1, max_iterations=60)


def truth_of(arm: ArmModel) -> dict[str, float]:
    """An arm whose offsets are some tenths of a degree off."""
    rng = np.random.default_rng(8)
    return {f"{joint}.offset": 0.01 * rng.standard_normal() for joint in arm.joints}


def unknowns(arm: ArmModel, *, priors: bool) -> ParameterSet:
    """All of its geometry with priors, or the offsets alone."""
    if priors:
        return arm.select(
            Selection(("geometric",), prior_m=1e-3, prior_rad=0.003),
            Selection(("*.offset",), prior_rad=0.013),
        )
    return arm.select(Selection(("*.offset",), bound_rad=0.26))


def fitted_and_held_out() -> tuple[Scene, Scene]:
    """The tip, seen with its orientation: to fit, and to hold out."""
    arm = arm_named("suta")
    fitted = tracked_scene(arm, truth_of(arm), 40, oriented=True)
    q = random_readings(arm, np.random.default_rng(99), 30)
    again = tracked_scene(arm, truth_of(arm), 30, oriented=True)
    R, p = fitted.arm.forward(q, truth_of(arm))
    first_R, first_p = arm.forward(fitted.q[:1], truth_of(arm))
    turn = fitted.rotation[0] @ first_R[0].T
    shift = fitted.position[0] - turn @ first_p[0]
    return fitted, replace(again, q=q, rotation=turn @ R, position=p @ turn.T + shift)
