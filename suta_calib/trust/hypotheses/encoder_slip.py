"""An encoder that slipped, or whose zero was set anew, between two rows."""

from typing import Any

import numpy as np

from suta_calib.trust import SpoiltData, Truth
from suta_calib.trust.in_time import ChangeInTime, EncoderInTime, later_half
from suta_calib.trust.simulated_faults import middle_joint_changed


class EncoderSlip(EncoderInTime):
    """``q_j → q_j + s`` from a row on, or in a file."""

    name = "encoder slip"
    about = "From some row on, a joint's encoder reads too much by a constant angle."
    sort = "slip"
    at_once = True

    def statement(self, change: ChangeInTime) -> str:
        """From where to where, by how much."""
        when = f"from {change.since} on than before"
        if change.until:
            when = f"from {change.since} to {change.until} than in other rows"
        return (
            f"{change.joint} reads {change.amount} more {when}. Did its encoder slip, or was its "
            "zero set anew? Calibrate these rows apart."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """The middle joint reads 4 mrad too much from the middle on."""
        return middle_joint_changed(data, lambda q: q + 4e-3 * later_half(data), "slip {}", 4e-3)
