"""A joint's column that was sorted by itself."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from suta_calib.terms import Term
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.patterns import ENOUGH_ROWS, STILL
from suta_calib.trust.simulated_faults import arm_of, middle_joint_changed


class SortedColumn(Pattern):
    """Readings only rise, or only fall, in every file, where no other joint's do.

    A sweep does that too.
    """

    name = "sorted column"
    about = "The column of one joint was sorted, the others were not."
    precedence = 30
    role = "suspicion"

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """One, of one joint."""
        # Joints that are in order in each file, of all that it has.
        ordered = list[tuple[list[str], tuple[str, ...]]]()
        for term in terms:
            samples, arm = term.poses.samples, arm_of(term)
            own = np.isin(arm.joints, arm.own_joints)
            for file in np.unique(samples.file_names):
                q = samples.q[samples.file_names == file]
                steps, moves = np.diff(q, axis=0), own & (np.ptp(q, axis=0) > 10 * STILL)
                monotonic = np.all(steps >= 0, axis=0) | np.all(steps <= 0, axis=0)
                if len(q) >= ENOUGH_ROWS and moves.sum() > 1:
                    in_order = np.compress(monotonic & moves, arm.joints).tolist()
                    ordered.append((in_order, arm.own_joints))
        joints = dict.fromkeys(joint for in_order, _ in ordered for joint in in_order)
        alone = [j for j in joints if all(file == [j] for file, own in ordered if j in own)]
        if len(alone) == 1:
            yield (
                f"The readings of {alone[0]} are sorted, those of no other joint are. Was its "
                "column sorted without the others? Export the readings again."
            )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The middle column sorted."""
        return middle_joint_changed(data, np.sort, "The readings of {} are sorted")
