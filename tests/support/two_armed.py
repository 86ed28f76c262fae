"""Sound data of two arms on one torso, new with every seed; faults are put into one arm's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from suta_calib import Problem, Selection, Solution, SolverOptions, Term, TrackedPoint, solve
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.terms.several_chains import over_chain
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.hypothesis import Hypothesis, SpoiltData
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
    terms, truth = both_hands(
        seed,
        150 if hypothesis.name == "time offset" else 60,
        moving=hypothesis.name == "time offset",
    )
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
