"""A joint whose zero is wrong by a quarter or half of a turn."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.terms import Term
from suta_calib.trust.misreadings import Change, MisreadJoints, mapped
from suta_calib.trust.simulated_faults import arm_of
from suta_calib.units import from_deg


class JointZero(MisreadJoints):
    """``q_j → q_j ± 90°`` or ``+ 180°`` for one revolute joint after another."""

    name = "zero of a joint"
    about = "A joint's zero is wrong by a quarter or half of a turn."
    precedence = 11

    def of_joints(self, arm: ArmModel, joints: Sequence[str]) -> Iterator[tuple[str, Change]]:
        """Three for each revolute joint."""
        identity = np.eye(len(arm.joints))
        for k, joint in enumerate(arm.readings):
            turns = joint.type != "prismatic" and joint.name in joints
            for angle in (90.0, -90.0, 180.0) if turns else ():
                change = partial(mapped, identity, from_deg(angle) * identity[k])
                yield f"{arm.joints[k]} reads {-angle:g}° too much", change

    def fault(self, term: Term) -> tuple[str, Samples]:
        """One of the inner joints reads 90° too much."""
        samples, arm = term.poses.samples, arm_of(term)
        joint = arm.own_joints[len(arm.own_joints) // 2]
        q = samples.q + from_deg(90.0) * np.eye(len(arm.joints))[arm.joints.index(joint)]
        return f"{joint} reads 90° too much", replace(samples, q=q)
