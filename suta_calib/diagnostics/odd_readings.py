"""What is odd of joint readings by themselves: columns that stand still, copied or rounded ones.

None of it needs the arm to be known well, and no fit shows it as what it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.held_out import robust_level
from suta_calib.diagnostics.tip_uncertainty import sensitivity
from suta_calib.solver.solution import Solution
from suta_calib.terms import ArmPoses, Term
from suta_calib.units import from_deg, text
from suta_calib.words import listed

# Travel of a joint, rad, below which it is as good as dead where others move ten times more.
TRAVEL: Final = 1e-4
# Rows from which on the order of a column is no chance: one in some thousands.
FEWEST: Final = 8
# Steps that somebody who rounds would choose, rad; encoders divide a turn by powers of two.
STEPS: Final = tuple(unit * 10.0**k for k in (0, -1, -2, -3) for unit in (from_deg(1.0), 1.0))
# Part of a step that is no rounding of the digits that are left.
EXACT: Final = 1e-3
# Residuals over what rounding alone would make of them: less, and the readings were exact.
LEAST, MOST = 0.5, 3.0
# Rows whose postures show how the tip hangs on the joints.
SHOWN: Final = 200


def odd_columns(terms: Sequence[Term]) -> Iterator[str]:
    """Joints that read the same in every row while others move, or the same as another joint.

    Args:
        terms: whose samples are looked at, over one arm.
    """
    arm = _arm(terms)
    if arm is None:
        return
    q = np.vstack([term.poses.samples.q for term in terms])
    travel = np.ptp(q, axis=0)
    others_move = np.sort(travel)[-2:].min() > 10 * TRAVEL
    dead = [joint for joint, moved in zip(arm, travel, strict=True) if moved < TRAVEL]
    if dead and others_move:
        yield (
            f"{', '.join(dead)} reads the same in every row, to "
            f"{np.degrees(TRAVEL):.3f} deg: is its encoder alive? If it was locked, say "
            "so by leaving its parameters out."
        )
    for a, b in combinations(range(len(arm)), 2):
        moving = min(travel[a], travel[b]) > 10 * TRAVEL and len(q) >= FEWEST
        if moving and np.abs(q[:, a] - q[:, b]).max() < TRAVEL:
            yield (
                f"{arm[a]} and {arm[b]} read the same as one another in every row: was one column "
                "copied over the other?"
            )


def sorted_alone(terms: Sequence[Term]) -> Iterator[str]:
    """A column whose readings only rise, or only fall, in every file, where no other's do.

    A sweep does that too: it is a cause only where the data fit nothing.

    Args:
        terms: whose samples are looked at, over one arm.
    """
    arm = _arm(terms)
    if arm is None:
        return
    found = list[list[int]]()
    for samples in (term.poses.samples for term in terms):
        files = np.array([origin.rpartition(":")[0] for origin in samples.origin])
        for file in np.unique(files):
            q = samples.q[files == file]
            steps, moves = np.diff(q, axis=0), np.ptp(q, axis=0) > 10 * TRAVEL
            ordered = np.all(steps >= 0, axis=0) | np.all(steps <= 0, axis=0)
            if len(q) >= FEWEST and moves.sum() > 1:
                found.append(np.flatnonzero(ordered & moves).tolist())
    if found and len(found[0]) == 1 and all(joints == found[0] for joints in found):
        yield (
            f"The readings of {arm[found[0][0]]} stand in order, those of no other joint do: was "
            "its column sorted by itself?"
        )


def rounded(solution: Solution) -> Iterator[str]:
    """Readings that were rounded when they were written, where that alone makes such residuals.

    Args:
        solution: converged or not, of terms over an arm.
    """
    problem = solution.problem
    if problem.arm is None:
        return
    q = np.vstack([term.poses.samples.q for term in problem.terms])
    turning = [joint.type != "prismatic" for joint in problem.arm.chain.moving]
    steps = np.array([_step(c) if t else 0.0 for c, t in zip(q.T, turning, strict=True)])
    lengths = [
        robust_level(line.residual)
        for line in problem.linearise(solution.x, problem.assumed_sigmas())
        if line.view.block.unit == "m"
    ]
    if not steps.any() or not lengths:
        return
    joints = problem.arm.joints
    names = [f"{joint}.offset" for joint in joints]
    shown = q[:: math.ceil(len(q) / SHOWN)]
    jacobian = sensitivity(problem.arm, solution.values, names, shown).jacobian
    # Anywhere within a step is as likely; of one axis of three.
    variance = np.sum((jacobian * steps) ** 2, axis=(1, 2)) / 12.0 / 3.0
    scatter = math.sqrt(float(variance.mean()))
    if LEAST * scatter < lengths[0] < MOST * scatter:
        coarse = listed([joint for joint, step in zip(joints, steps, strict=True) if step])
        yield (
            f"The readings of {coarse} are in steps of {np.degrees(steps.max()):.3g} deg: so "
            f"rounded, they scatter the tip by {text(scatter, 'm', with_unit=True)} per axis, and "
            f"the residuals are {text(lengths[0], 'm', with_unit=True)}. Write every digit."
        )


def _arm(terms: Sequence[Term]) -> Sequence[str] | None:
    """Names of the joints; None without an arm."""
    poses = terms[0].poses
    return poses.arm.joints if isinstance(poses, ArmPoses) else None


def _step(readings: FloatArray) -> float:
    """The largest step of `STEPS` whose multiples all readings (n,) are; zero where there is none.

    Nor is there one to speak of where the joint stood still, or nearly.
    """
    found = np.unique(readings)
    for step in sorted(STEPS, reverse=True):
        times = found / step
        if np.abs(times - np.round(times)).max() < EXACT:
            return step if len(np.unique(np.round(times))) > 2 else 0.0
    return 0.0
