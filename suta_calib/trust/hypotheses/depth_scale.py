"""A camera that sees all targets too far or too near, by a constant factor."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from suta_calib.terms.hand_eye import HandEye
from suta_calib.trust import (
    AddedVariable,
    Effect,
    Evidence,
    Examination,
    SpoiltData,
    Truth,
    weigh_effects,
)
from suta_calib.trust.simulated_faults import with_columns


class DepthScale(AddedVariable):
    """``seen = expected (1 + s)`` along the eye's axis: a focal length or a target's size is wrong.

    The answer follows most of it, and what is left scatters little: ± from the scatter alone is
    several times too small. The depth is the expected one. That which was seen holds the same noise
    as the residuals, which would seem to grow with it.
    """

    name = "scale of depth"
    about = "A camera sees its target too far or too near, by a constant factor."
    applies_to = (HandEye,)
    needs_arm = False
    by_itself = True
    # One number, tested by itself: its p-value says all.
    worth = 0.0
    times_std = 0.0

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One number."""
        (term,), columns = answer.problem.terms, list[Any]()
        expected = term.observed(answer.solution.values, term.poses).position
        assert expected is not None
        depth = expected[:, 2]
        for r in answer.rows:
            column = np.zeros(r.line.residual.shape)
            if r.line.view.block.unit == "m":
                column[:, 2] = depth / r.line.sigma
            columns.append(column.reshape(-1, 1))
        yield Effect("depth", np.vstack(columns))

    def weigh(self, answer: Examination) -> list[Evidence]:
        """The share, with every pair believed."""
        return weigh_effects(answer.plain_fit, self.effects(answer))

    def sentence(self, evidence: Evidence) -> str:
        """The factor, and what to do."""
        share, std = float(evidence.size[0]), float(evidence.std[0])
        return (
            f"The camera or tracker seems to see the target {abs(share):.2%} ± {std:.2%} too "
            f"{'far' if share > 0 else 'near'}. Either the focal length of the camera is wrong, or "
            "the target has another size. X is wrong by this error, and ± includes it. Calibrate "
            "the camera again and measure the target, or give the corners in the pictures "
            "(--corners), which also corrects the camera."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """All targets 1 % too far, or too near."""
        samples, share = data.poses.samples, float(rng.choice([-0.01, 0.01]))
        rescaled = with_columns(data, position=samples.position * [1.0, 1.0, 1.0 + share])
        return SpoiltData(rescaled, np.array([share]))
