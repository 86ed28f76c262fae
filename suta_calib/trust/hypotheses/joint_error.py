"""An error of a joint beside geometry: one of the families of `model.parameters`."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from suta_calib.model.parameters import COUPLING
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData, Truth
from suta_calib.trust.extended_problem import LOOKS_LIKE, offered_beside
from suta_calib.trust.simulated_faults import arm_of, with_columns


class JointError(AddedVariable):
    """Eccentric encoders, wrong gains, joints that yield, backlash, thermal expansion."""

    name = "joint error"
    about = "A joint has an eccentric encoder, compliance, bending, backlash or a wrong gain."

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each joint and family that the answer does not estimate."""
        assert answer.arm is not None
        fitted = answer.solution.problem.parameters
        place = {name: k for k, name in enumerate(answer.problem.names)}
        plausible = answer.problem.parameters.array("plausible")
        for (joint, family), offered in offered_beside(answer.problem).items():
            at = [place[name] for name in offered if name in place and name not in fitted]
            if not at or family in (COUPLING, "cable"):
                continue
            columns = np.vstack([r.jacobian[:, at] for r in answer.rows])
            names = tuple(answer.problem.names[k] for k in at)
            name = f"{joint} {family}"
            yield Effect(name, columns, plausible[at], parameters=names, about=(joint, family))

    def sentence(self, evidence: Evidence) -> str:
        """The joint, and what its residuals look like."""
        joint, family = evidence.effect.about
        return (
            f"The residuals of {joint} look like {LOOKS_LIKE[family]}. Run suta-calib extend: it "
            "checks whether such a term predicts left-out data better."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """An encoder disc off its axis: 0.2° once a turn."""
        arm = arm_of(data)
        turning = [arm.joints.index(j) for j in arm.own_joints if arm.units[j] == "rad"]
        joint = int(rng.choice(turning))
        size = np.radians(0.2) * np.array([0.6, 0.8])
        q = data.poses.samples.q.copy()
        # The reading misses what the parameters add to it.
        q[:, joint] -= size @ [np.cos(q[:, joint]), np.sin(q[:, joint])]
        return SpoiltData(with_columns(data, q=q), size, f"{arm.joints[joint]} ecc_1")
