"""What is odd of joint readings by themselves: what stands still, repeats, was copied or rounded.

None of it needs the arm to be known well, and no fit shows it as what it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.diagnostics.held_out import robust_level
from suta_calib.diagnostics.tip_uncertainty import sensitivity
from suta_calib.measurements import Samples
from suta_calib.measurements.samples import hashed, joined
from suta_calib.model.arm import ArmModel
from suta_calib.solver.solution import Solution
from suta_calib.terms import ArmPoses, Term
from suta_calib.terms.block import grouped, grouped_rows, numbered
from suta_calib.terms.poses import resolutions
from suta_calib.units import from_deg, text
from suta_calib.words import listed

# Travel of a joint, rad, below which it is as good as dead where others move ten times more.
TRAVEL: Final = 1e-4
# Rows from which on the order of a column is no chance: one in some thousands.
FEWEST: Final = 8
# Steps that somebody who rounds would choose, rad and m; encoders divide a turn by powers of two.
STEPS: Final = tuple(unit * 10.0**k for k in (0, -1, -2, -3) for unit in (from_deg(1.0), 1.0))
LENGTH_STEPS: Final = tuple(10.0**-k for k in (1, 2, 3, 4))
# Share of the rows that stand at a column's end from which on that is worth a word.
AT_END: Final = 0.1
# Part of a step that is no rounding of the digits that are left.
EXACT: Final = 1e-3
# Residuals over what rounding alone would make of them: less, and the readings were exact.
LEAST, MOST = 0.5, 3.0
# Rows that read the same from which on it is their readings that are wrong, not what was observed.
ALIKE: Final = 3
# Distance, m and pixels, of what is seen from one posture that no instrument's noise makes.
APART: Final = 0.01
APART_PX: Final = 20.0
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
    joints = arm.joints
    q = np.vstack([term.poses.samples.q for term in terms])
    travel = np.ptp(q, axis=0)
    others_move = np.sort(travel)[-2:].min() > 10 * TRAVEL
    dead = [joint for joint, moved in zip(joints, travel, strict=True) if moved < TRAVEL]
    if dead and others_move:
        yield (
            f"{', '.join(dead)} reads the same in every row, to "
            f"{np.degrees(TRAVEL):.3f} deg: is its encoder alive? If it was locked, say "
            "so by leaving its parameters out."
        )
    for a, b in combinations(range(len(joints)), 2):
        moving = min(travel[a], travel[b]) > 10 * TRAVEL and len(q) >= FEWEST
        if moving and np.abs(q[:, a] - q[:, b]).max() < TRAVEL:
            yield (
                f"{joints[a]} and {joints[b]} read the same as one another in every row: was one "
                "column copied over the other?"
            )


def read_again(terms: Sequence[Term]) -> Iterator[str]:
    """Rows whose joints all read, to the last digit, as in others that were elsewhere.

    As where a bus repeats its last answer, or readings that never came were written as zeros. What
    is seen of one posture may be wrong in some of its rows, but agrees in most; and a tip that
    touches one place is not at another.

    Args:
        terms: whose samples are looked at, over one arm.
    """
    for term in terms:
        samples = term.poses.samples
        posture = hashed(samples.q)
        if _arm([term]) is None or len(np.unique(posture)) == len(samples):
            continue
        alike = numbered(posture)[1]
        columns = [name for name in samples.labels if name != "repeat"]
        place = grouped(joined(samples.labels, columns))[1] if columns else np.zeros_like(alike)
        if samples.pixels is not None:
            again = _scattered(alike, np.nanmean(samples.pixels, axis=1), APART_PX)
        elif samples.position is not None:
            # What has another label may be another target, or seen from elsewhere.
            alike = grouped_rows(np.column_stack([alike, place]))[0]
            again = _scattered(alike, samples.position, APART)
        elif term.medium == "touch" and not samples.numbers and not may_read_alike(samples):
            again = _extent(alike, place[:, None].astype(float)) > 0
        else:
            continue
        if again.any():
            yield (
                f"{np.sum(again)} rows of {term.kind.replace('_', ' ')}, "
                f"{samples.origin[int(np.argmax(again))]} the first, read the same in all joints "
                "to the last digit as others do that were elsewhere: did the bus repeat its last "
                "answer, or do zeros stand for readings that never came? Leave them out."
            )


def _scattered(group: IntArray, where: FloatArray, reach: float) -> BoolArray:
    """(n,) rows of groups (n,) most of which are farther than that from their middle, (n, d)."""
    found = _extent(group, where) > reach
    order = np.argsort(group, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        if not found[rows[0]]:
            continue
        away = np.linalg.norm(where[rows] - np.median(where[rows], axis=0), axis=1) > reach
        found[rows] = len(rows) >= ALIKE and 2 * int(np.sum(away)) > len(rows)
    return found


def _extent(group: IntArray, where: FloatArray) -> FloatArray:
    """(n,) how far apart (n, d) the rows of each one's group (n,) are."""
    low, high = (np.full((group.max() + 1, where.shape[1]), end) for end in (np.inf, -np.inf))
    np.minimum.at(low, group, where)
    np.maximum.at(high, group, where)
    return np.asarray(np.linalg.norm(high - low, axis=1)[group])


def may_read_alike(samples: Samples) -> bool:
    """Whether an arm that comes back may read the same to the last digit: encoders all coarse."""
    moving = samples.q[:, np.ptp(samples.q, axis=0) > 0]
    return samples.position is None and bool(np.all(resolutions(moving) > 0))


def odd_where_nothing_fits(terms: Sequence[Term]) -> Iterator[str]:
    """What honest columns do as well, and is a cause only where the data fit nothing.

    A column whose readings only rise, or only fall, in every file, where no other's do: a sweep
    does that. One that stays at its end for many rows: so does a joint that is sent there.

    Args:
        terms: whose samples are looked at, over one arm.
    """
    arm = _arm(terms)
    if arm is None:
        return
    yield from _sorted_alone(arm.joints, terms)
    q = np.vstack([term.poses.samples.q for term in terms])
    moving = np.ptp(q, axis=0) > 10 * TRAVEL
    for joint, readings in zip(np.compress(moving, arm.joints), q[:, moving].T, strict=True):
        for end, which in ((readings.max(), "above"), (readings.min(), "below")):
            times = int(np.sum(readings == end))
            if times >= max(FEWEST, AT_END * len(readings)):
                where = text(float(end), arm.units[joint], with_unit=True)
                yield (
                    f"{times} of {len(readings)} readings of {joint} are {where} to the last "
                    f"digit, and none is {which}: does its encoder, or what reads it, end there?"
                )


def _sorted_alone(joints: Sequence[str], terms: Sequence[Term]) -> Iterator[str]:
    found = list[list[int]]()
    for samples in (term.poses.samples for term in terms):
        files = samples.file_names
        for file in np.unique(files):
            q = samples.q[files == file]
            steps, moves = np.diff(q, axis=0), np.ptp(q, axis=0) > 10 * TRAVEL
            ordered = np.all(steps >= 0, axis=0) | np.all(steps <= 0, axis=0)
            if len(q) >= FEWEST and moves.sum() > 1:
                found.append(np.flatnonzero(ordered & moves).tolist())
    if found and len(found[0]) == 1 and all(each == found[0] for each in found):
        yield (
            f"The readings of {joints[found[0][0]]} stand in order, those of no other joint do: "
            "was its column sorted by itself?"
        )


def rounded(solution: Solution) -> Iterator[str]:
    """What was rounded when it was written, where that alone makes such residuals.

    Args:
        solution: converged or not, of terms over an arm.
    """
    problem = solution.problem
    lengths = [
        robust_level(line.residual)
        for line in problem.linearise(solution.x, problem.assumed_sigmas())
        if line.view.block.unit == "m"
    ]
    if problem.arm is None or not lengths:
        return
    for what, step, scatter in (
        *_rounded_joints(solution, problem.arm),
        *_rounded_positions(problem.terms),
    ):
        if LEAST * scatter < lengths[0] < MOST * scatter:
            yield (
                f"{what} are in steps of {step}: so rounded, they scatter the tip by "
                f"{text(scatter, 'm', with_unit=True)} per axis, and the residuals are "
                f"{text(lengths[0], 'm', with_unit=True)}. Write every digit."
            )


def _rounded_joints(solution: Solution, arm: ArmModel) -> Iterator[tuple[str, str, float]]:
    """The joints whose readings have steps, the largest step, and what steps do to the tip, m."""
    q = np.vstack([term.poses.samples.q for term in solution.problem.terms])
    turning = [joint.type != "prismatic" for joint in arm.chain.moving]
    steps = np.array([_step(c, STEPS) if t else 0.0 for c, t in zip(q.T, turning, strict=True)])
    if not steps.any():
        return
    names = [f"{joint}.offset" for joint in arm.joints]
    shown = q[:: math.ceil(len(q) / SHOWN)]
    jacobian = sensitivity(arm, solution.values, names, shown).jacobian
    # Anywhere within a step is as likely; of one axis of three.
    variance = np.sum((jacobian * steps) ** 2, axis=(1, 2)) / 12.0 / 3.0
    coarse = listed([joint for joint, step in zip(arm.joints, steps, strict=True) if step])
    yield (
        f"The readings of {coarse}",
        f"{np.degrees(steps.max()):.3g} deg",
        math.sqrt(float(variance.mean())),
    )


def _rounded_positions(terms: Sequence[Term]) -> Iterator[tuple[str, str, float]]:
    """The same of the positions that were measured."""
    for term in terms:
        position = term.poses.samples.position
        if position is not None and (step := _step(position.reshape(-1), LENGTH_STEPS)):
            what = f"The positions of {term.kind.replace('_', ' ')}"
            yield what, text(step, "m", with_unit=True), step / math.sqrt(12.0)


def _arm(terms: Sequence[Term]) -> ArmModel | None:
    """Whose readings these are; None without an arm."""
    poses = terms[0].poses
    return poses.arm if isinstance(poses, ArmPoses) else None


def _step(readings: FloatArray, steps: Sequence[float]) -> float:
    """The largest of ``steps`` whose multiples all readings (n,) are; zero where there is none.

    Nor is there one to speak of where nothing moved, or hardly.
    """
    found = np.unique(readings)
    for step in sorted(steps, reverse=True):
        times = found / step
        if np.abs(times - np.round(times)).max() < EXACT:
            return step if len(np.unique(np.round(times))) > 2 else 0.0
    return 0.0
