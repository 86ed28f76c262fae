"""Which side of its play each joint is on, in simulated samples of an arm that has some."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import BACKLASH


def last_motions(
    arm: ArmModel, values: Mapping[str, float], q: FloatArray, rng: np.random.Generator
) -> FloatArray | None:
    """Each joint's last motion before it was read, as a samples file has it.

    The arm goes from one row to the next straight away, so a joint's last motion is the difference;
    one that stands still keeps its side. Where it came from before the first row is drawn.

    Args:
        arm: the nominal arm.
        values: its true parameters.
        q: (n, joints) readings in the order in which they are taken.
        rng: for the first row.

    Returns:
        (n, joints) of -1 and 1; None where no joint has backlash.
    """
    if not backlashes(arm, values).any():
        return None
    sides = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    sides[0] = rng.choice([-1.0, 1.0], q.shape[1])
    for before, now in pairwise(sides):
        now[now == 0.0] = before[now == 0.0]
    return sides


def backlashes(arm: ArmModel, values: Mapping[str, float]) -> FloatArray:
    """(joints,) backlash of each joint that is read, rad."""
    return np.array([values.get(f"{joint}.{BACKLASH}", 0.0) for joint in arm.joints])


def readings_beside(
    arm: ArmModel, values: Mapping[str, float], q: FloatArray, sides: FloatArray | None
) -> FloatArray:
    """Readings (n, joints) of joints that stand as they would at readings ``q`` without play.

    ``(1 + gain) q + … - ½ backlash · side`` is the joint's angle: the reading runs ahead of the
    link by half of the play.
    """
    if sides is None:
        return q
    gains = np.array([values.get(f"{joint}.gain", 0.0) for joint in arm.joints])
    return np.asarray(q + 0.5 * backlashes(arm, values) * sides / (1.0 + gains))
