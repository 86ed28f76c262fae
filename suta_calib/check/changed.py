"""What of the parameters changed, in the directions that rows tell of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag

from suta_calib.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class ChangedParameters:
    """Parameters that changed, along what rows tell of them.

    Of a link with six numbers few rows may tell two: the others stay.

    Attributes:
        at: (k,) numbers of the parameters.
        along: (k, r) directions in which they move.
    """

    at: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    along: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def count(self) -> int:
        """How many directions there are."""
        return int(self.along.shape[1])

    def beside(self, at: Sequence[int], along: FloatArray) -> ChangedParameters:
        """These, and others (k',) in their own directions (k', r')."""
        both = block_diag(self.along, along) if self.count else along
        return ChangedParameters(
            np.concatenate([self.at, np.array(at, dtype=np.intp)]), np.asarray(both)
        )

    def columns(self, jacobian: FloatArray) -> FloatArray:
        """(m, r) derivative of rows, of which the one by every parameter is (m, p)."""
        return np.asarray(jacobian[:, self.at] @ self.along)
