"""Joint readings in degrees that are taken for radians."""

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

DESCRIPTION = "the joints' columns are in degrees, not rad"


class JointUnit(MisreadJoints):
    """``q → q π / 180`` for all revolute joints together."""

    name = "unit of the joints"
    about = "Joint readings are in degrees, but are read as radians."
    precedence = 13

    def of_joints(self, arm: ArmModel, joints: Sequence[str]) -> Iterator[tuple[str, Change]]:
        """One for the arm."""
        yield DESCRIPTION, partial(mapped, np.diag(_factors(arm)), 0.0)

    def fault(self, term: Term) -> tuple[str, Samples]:
        """Every revolute joint in degrees."""
        samples, arm = term.poses.samples, arm_of(term)
        return DESCRIPTION, replace(samples, q=samples.q / _factors(arm))


def _factors(arm: ArmModel) -> list[float]:
    return [1.0 if joint.type == "prismatic" else from_deg(1.0) for joint in arm.readings]
