"""A joint that the motor of its neighbour moves too: a belt, a tendon, a differential wrist."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData, Truth
from suta_calib.trust.extended_problem import neighbours
from suta_calib.trust.simulated_faults import arm_of, with_columns


class Coupling(AddedVariable):
    """``moved = q_moved + c · q_other``: c is what `joint.coupling[other]` estimates.

    Only neighbours are tested, and joints that a ``<transmission>`` of the URDF couples: any two
    joints together would explain any error.
    """

    name = "joint coupling"
    about = "A joint moves when the motor of its neighbour turns."

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each ordered pair of neighbouring joints of the same kind."""
        arm = answer.arm
        assert arm is not None
        fitted = answer.solution.problem.parameters
        movers = [segment.owner for segment in arm.movers]
        for name, (moved, other) in neighbours(arm).items():
            if name in fitted:
                continue
            turn = answer.motion[:, :, [movers.index(moved)]]
            reading = answer.q[:, arm.joints.index(other)]
            # Those of chains that it is no part of stay where they are.
            mean = reading[np.any(turn, axis=(1, 2))].mean()
            parameter = arm.nongeometric[name]
            yield Effect(
                name,
                answer.by_motion(turn * (reading - mean)[:, None, None]),
                plausible=np.array([parameter.plausible]),
                parameters=(name,),
                about=(moved, other),
            )

    def sentence(self, evidence: Evidence) -> str:
        """Both joints, the ratio, and how to look further."""
        moved, other = evidence.effect.about
        ratio, std = float(evidence.size[0]), float(evidence.std[0])
        return (
            f"The residuals look like a coupling of two joints: {moved} moves by {ratio:+.4f} ± "
            f"{std:.4f} of the motion of {other} (1:{1.0 / abs(ratio):.0f}). Run suta-calib "
            f"extend: it prints what to add to the job ({evidence.effect.name})."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """Readings of one joint that lack what its neighbour moves it by: 1:100."""
        arm, ratio = arm_of(data), 0.01
        pairs = neighbours(arm)
        name = str(rng.choice([*pairs]))
        moved, other = (arm.joints.index(joint) for joint in pairs[name])
        q = data.poses.samples.q.copy()
        q[:, moved] -= ratio * q[:, other]
        return SpoiltData(with_columns(data, q=q), np.array([ratio]), name)
