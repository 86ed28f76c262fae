"""Which patterns the samples have that honest ones have not: the mechanism behind `Pattern`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.measurements import Samples
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term
from suta_calib.terms.poses import resolutions
from suta_calib.trust.hypothesis import Pattern, known_hypotheses
from suta_calib.trust.simulated_faults import arm_of

# Travel of a joint, rad, below which it stands still where others move ten times more.
STILL: Final = 1e-4
# Rows from which on the order of a column is no chance: one in some thousands.
ENOUGH_ROWS: Final = 8


def matches(answer: Solution, *roles: str) -> list[str]:
    """Where the samples of an answer have patterns of these roles (`Pattern.role`), what to do."""
    patterns = [h for h in known_hypotheses().values() if isinstance(h, Pattern)]
    return [
        sentence
        for hypothesis in sorted(patterns, key=lambda h: h.precedence)
        if hypothesis.role in roles and hypothesis.applies(answer.problem)
        for sentence in hypothesis.matches(answer)
    ]


def readings_of(terms: Sequence[Term], joints: Iterable[str]) -> FloatArray:
    """(samples, joints) readings of all terms over chains that have these joints.

    The columns of another chain's joints hold no readings.
    """
    wanted = [*joints]
    read = [np.zeros((0, len(wanted)))]
    for term in terms:
        arm = arm_of(term)
        if set(wanted) <= set(arm.own_joints):
            read.append(term.poses.samples.q[:, [arm.joints.index(j) for j in wanted]])
    return np.vstack(read)


def readings_by_joint(terms: Sequence[Term]) -> dict[str, FloatArray]:
    """(samples,) readings of each joint, of all terms over chains that have it."""
    joints = dict.fromkeys(joint for term in terms for joint in arm_of(term).own_joints)
    return {joint: readings_of(terms, [joint])[:, 0] for joint in joints}


def may_read_alike(samples: Samples) -> bool:
    """Whether an arm that comes back may read the same to the last digit: encoders all coarse."""
    moving = samples.q[:, np.ptp(samples.q, axis=0) > 0]
    return samples.position is None and bool(np.all(resolutions(moving) > 0))
