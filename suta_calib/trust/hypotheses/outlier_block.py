"""Consecutive outliers at the beginning or at the end: something was moved there."""

from typing import Any, Final

import numpy as np

from suta_calib.arrays import BoolArray
from suta_calib.trust import Effect, Evidence, Examination, Hypothesis, Rule, SpoiltData, Truth
from suta_calib.trust.hypotheses.moved_at_a_row import Moved
from suta_calib.trust.simulated_faults import random_shift, seen_elsewhere

# Outliers in one block that are no chance.
FEWEST: Final = 3


class OutlierBlock(Hypothesis):
    """Nearly all outliers are the first rows, or the last, and nearly all of these are outliers.

    Where something was moved late or early, few rows disagree with the rest. A robust fit leaves
    them out one by one, and the fit of the others does not show the change.
    """

    name = "outliers in a block"
    about = "The first rows, or the last, do not agree with the other rows."
    applies_to = Moved.applies_to
    needs_arm = False
    by_itself = True

    def weigh(self, answer: Examination) -> list[Evidence]:
        """The first block among all rows, or among those that look at one unknown."""
        measured = answer.measured
        assert measured is not None
        owners = dict.fromkeys(p.owner for p in answer.problem.parameters.values())
        called = {owner: measured.called.get(owner, owner) for owner in owners}
        every = np.arange(len(measured.inliers), dtype=np.intp)
        groups = {" or ".join(called.values()): every}
        groups |= {called[owner]: rows for owner, rows in measured.seen_by.items()}
        for what, rows in groups.items():
            outlier = ~measured.inliers[rows]
            block = _block(outlier)
            if block is None:
                continue
            border, share = block
            about = what, int(measured.numbers[rows[border]]), measured.rows
            effect = Effect(what, np.zeros((0, 1)), about=about)
            size, nothing = np.array([float(border)]), np.zeros((1, 1))
            return [Evidence(effect, None, size, nothing, 0.0, share, 1, 1.0, 1.0, 0.0, 0.0, size)]
        return []

    def supported(self, evidence: Evidence, rule: Rule = Rule()) -> bool:
        """Whether it is reported: by counting only, because sound data have no outliers."""
        return True

    def sentence(self, evidence: Evidence) -> str:
        """Where the block ends, and what may have been moved."""
        what, border, rows = evidence.effect.about
        return (
            f"The {rows} that do not agree are nearly all before row {border}, or nearly all after "
            f"it (rows from 0). Was {what} moved in between?"
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """What was seen is 50 mm elsewhere in the last fourth of the rows."""
        count = len(data.poses)
        late = np.arange(count) >= count - max(FEWEST + 1, count // 4)
        elsewhere = seen_elsewhere(data, late[:, None] * random_shift(rng, 50e-3))
        return SpoiltData(elsewhere, np.array([float(np.flatnonzero(late)[0])]))


def _block(outlier: BoolArray) -> tuple[int, float] | None:
    """Row at the border of the block, and the share of all outliers (n,) that are inside."""
    count = len(outlier)
    for backwards in (False, True):
        # The block in which outliers most outnumber the others.
        excess = np.cumsum(np.where(outlier[::-1] if backwards else outlier, 1, -1))
        length = int(np.argmax(excess)) + 1
        block = outlier[count - length :] if backwards else outlier[:length]
        inside = int(block.sum())
        # Of the rows in the block, and of all outliers, a tenth may be elsewhere.
        if inside >= FEWEST and inside >= 0.9 * max(length, int(outlier.sum())):
            border = count - length if backwards else length
            return (border, inside / int(outlier.sum())) if border < count else None
    return None
