"""A joint that counts in the wrong direction."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from suta_calib.model.arm import ArmModel
from suta_calib.trust.misreadings import Change, MisreadJoints, mapped


class JointSign(MisreadJoints):
    """``q_j → -q_j`` for one joint after another."""

    name = "sign of a joint"
    about = "A joint counts in the wrong direction."
    precedence = 10

    def of_joints(self, arm: ArmModel, joints: Sequence[str]) -> Iterator[tuple[str, Change]]:
        """One for each joint."""
        identity = np.eye(len(arm.joints))
        for joint in joints:
            flipped = identity * np.where(identity[arm.joints.index(joint)], -1.0, 1.0)
            yield f"{joint} counts the other way (sign: -1)", partial(mapped, flipped, 0.0)
