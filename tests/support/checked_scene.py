"""A tracked arm that was calibrated, rows of later days, and what may happen to them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from simulated import Spread, arm_named, dh_parameters, perturbed, tracked_scene

from suta_calib import Problem, Solution, Term, solve
from suta_calib.check import Checker
from suta_calib.terms import ArmPoses

NOISE = 1e-4


@cache
def scene() -> tuple[Any, Term, list[Term]]:
    """A tracked arm: what was calibrated, and twenty times ten rows of later days."""
    arm = arm_named("suta")
    truth = perturbed(dh_parameters(arm), 1, 1e-3, 3e-3)
    tracked = tracked_scene(arm, truth, 240)
    samples = tracked.samples(Spread(NOISE), seed=1)[0]
    every = tracked.term(samples)
    later = [every.take(np.arange(60 + 9 * k, 69 + 9 * k)) for k in range(20)]
    return arm, every.take(np.arange(60)), later


@cache
def checker() -> Checker:
    arm, fitted, _ = scene()
    solution: Solution = solve(Problem([fitted], dh_parameters(arm)))
    return Checker(solution)


def with_joint_off(term: Term, joint: int, angle: float) -> Term:
    assert isinstance(term.poses, ArmPoses)
    samples = term.poses.samples
    q = samples.q.copy()
    q[:, joint] += angle
    return term.over_poses(ArmPoses(term.poses.arm, replace(samples, q=q)))


def shifted(term: Term, by: Any, rows: Any = slice(None)) -> Term:
    samples = term.poses.samples
    assert samples.position is not None
    position = samples.position.copy()
    position[rows] += by
    return term.over_poses(term.poses.with_samples(replace(samples, position=position)))
