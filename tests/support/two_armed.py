"""Sound data of two arms on one torso, new with every seed; faults are put into one arm's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from suta_calib import (
    ArmModel,
    Problem,
    Robot,
    Selection,
    Solution,
    SolverOptions,
    Term,
    TrackedPoint,
    solve,
)
from suta_calib.assessment import Assessment
from suta_calib.geometry import register_points
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.terms.several_chains import over_chain
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.hypothesis import Hypothesis, SpoiltData
from suta_calib.trust.tip import Sensitivity, sensitivity
from tests.support.torso_robot import SEEN, built, torso_robot

ROBOT = torso_robot()
UNKNOWN = ROBOT.select(
    Selection(("geometric",), bound_m=0.03, bound_rad=0.09), Selection(("*.offset",), bound_rad=0.2)
)


def both_hands(
    seed: int, n: int = 60, *, moving: bool = False
) -> tuple[list[Term], dict[str, float]]:
    """An instrument sees position and orientation of each hand; and the truth."""
    rng = np.random.default_rng(seed)
    truth, terms = built(ROBOT, rng), list[Term]()
    for name, arm in ROBOT.chains.items():
        q = rng.uniform(-1.5, 1.5, (n, len(arm.joints)))
        if moving:
            phase, period = rng.uniform(0, 2 * np.pi, q.shape[1]), rng.uniform(20, 60, q.shape[1])
            q = 1.5 * np.sin(2 * np.pi * np.arange(n)[:, None] / period + phase)
        rotation, position = arm.forward(q, truth)
        shaken = rotation @ rotation_from_vector(2e-4 * rng.standard_normal((n, 3)))
        term = TrackedPoint.from_arrays(
            arm,
            q,
            position=position @ SEEN[0].T + SEEN[1] + 2e-4 * rng.standard_normal((n, 3)),
            orientation=SEEN[0] @ shaken,
        )
        origin = tuple(f"{name}.csv:{row + 2}" for row in range(n))
        samples = replace(term.poses.samples, origin=origin)
        named = term.over_poses(term.poses.with_samples(samples))
        terms.append(over_chain(named, ROBOT.laid_out[name]))
    return terms, truth


def spoilt(hypothesis: Hypothesis, arm: int, seed: int = 1) -> tuple[SpoiltData, list[Term]]:
    """The fault of a hypothesis in one arm's data, and the data of both."""
    moving = hypothesis.name in ("time offset", "late clock")
    terms, truth = both_hands(seed, 150 if moving else 60, moving=moving)
    fault = hypothesis.spoil(terms[arm], truth, np.random.default_rng(seed))
    terms[arm] = fault.data
    return fault, terms


def fitted(terms: list[Term]) -> Solution:
    """An answer, converged or not."""
    few = SolverOptions(starts=1, confirm=False, max_iterations=30)
    return solve(Problem(terms, UNKNOWN), few)


def examined(terms: list[Term]) -> CalibrationExamination:
    """A converged answer."""
    solution = solve(Problem(terms, UNKNOWN), SolverOptions(starts=1, confirm=False))
    assert solution.converged
    return CalibrationExamination.of(solution)


def judged_hands(terms: Sequence[Term]) -> tuple[Solution, Assessment]:
    """The answer with its robust fit, and the whole judgement of it."""
    solution = solve(Problem(terms, UNKNOWN))
    return solution, assess_calibration(CalibrationExamination.of(solution))


def anywhere(arm: ArmModel, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(n, joints) readings anywhere within the limits, no joint beyond three quarters of a turn."""
    ends = [(max(j.lower, -2.4), min(j.upper, 2.4)) for j in arm.readings]
    low, high = np.array(ends).T
    return rng.uniform(low, high, (n, len(ends)))


def both_tips(
    robot: Robot, values: dict[str, float], n: int, rng: np.random.Generator, sigma: float = 2e-4
) -> list[Term]:
    """An instrument sees the tip of every chain in n postures of its own."""
    terms = list[Term]()
    for arm in robot.chains.values():
        q = anywhere(arm, n, rng)
        position = arm.forward(q, values)[1] @ SEEN[0].T + SEEN[1]
        seen = position + rng.normal(0.0, sigma, position.shape)
        terms.append(TrackedPoint.from_arrays(arm, q, position=seen))
    return terms


class TipError(NamedTuple):
    """Of one hand, m: RMS over postures.

    Attributes:
        error: distance from the truth.
        stated: what the answer says of it.
    """

    error: float
    stated: float


def tip_errors(
    robot: Robot, solution: Solution, truth: dict[str, float], rng: np.random.Generator
) -> dict[str, TipError]:
    """Of every hand in 100 postures each, all of them registered together."""
    values = solution.values
    count = solution.problem.arm_count
    free = solution.free[solution.free < count]
    names = [solution.problem.names[k] for k in free]
    covariance = solution.covariance[np.ix_(free, free)]
    assert isinstance(solution.problem.arm, Robot)
    found, true = list[Sensitivity](), list[NDArray[np.float64]]()
    for lone, arm in zip(robot.chains.values(), solution.problem.arm.arms, strict=True):
        own = anywhere(lone, 100, rng)
        q = np.zeros((len(own), len(arm.joints)))
        q[:, [arm.joints.index(joint) for joint in lone.joints]] = own
        found.append(sensitivity(arm, values, names, q))
        true.append(lone.forward(own, truth)[1])
    parts = ("q", "position", "rotation", "jacobian")
    every = Sensitivity(*(np.concatenate([getattr(s, p) for s in found]) for p in parts))
    rotation, position = register_points(every.position, np.concatenate(true))
    off = every.position @ rotation.T + position - np.concatenate(true)
    std = every.std(covariance, every.registered())
    errors = np.split(np.linalg.norm(off, axis=1), len(found))
    return {
        name: TipError(*(float(np.sqrt(np.mean(part**2))) for part in both))
        for name, *both in zip(robot.chains, errors, np.split(std, len(found)), strict=True)
    }
