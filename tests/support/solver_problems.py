"""Problems for the solver: distances with outliers among them, and a start far from the minimum."""

from __future__ import annotations

from functools import cache

from simulated import (
    Scene,
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    dh_parameters,
    perturbed,
    placements,
    tracked_scene,
)

from suta_calib.model.parameters import Selection
from suta_calib.solver.problem import Problem
from suta_calib.terms import Noise

SIGMA = 1e-4
DIRTY = Spread(position=SIGMA, outliers=0.1, gross=0.01)
HUBER = Noise(SIGMA, 1.35 * SIGMA)


@cache
def distances() -> Scene:
    arm = arm_named("suta")
    truth = perturbed(dh_parameters(arm), seed=1)
    return artefact_scene("pairwise_distance", arm, truth, artefact(8), placements(4))


def dirty_problem() -> Problem:
    scene = distances()
    return Problem([scene.term(scene.samples(DIRTY)[0], HUBER)], dh_parameters(scene.arm))


def far_problem() -> Problem:
    """Offsets up to 2.25 rad from nominal: one start is not enough."""
    arm = arm_named("suta")
    parameters = arm.select(Selection(("joint_[2-6].offset",), bound_rad=2.5))
    far = dict(zip(parameters.names, (1.5, -1.5, 1.5, 2.1, -2.25), strict=True))
    return Problem([tracked_scene(arm, far, 25).exact(Noise(1e-3))], parameters)
