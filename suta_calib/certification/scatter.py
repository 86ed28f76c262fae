"""What touches scatter, and from what on a departure is no chance, or a fault."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import chdtri, fdtri, ndtri, stdtrit

# Chance that anything is named of an artefact with nothing wrong.
FALSE_ALARM: Final = 0.001
# Chance of wrongly proving nonconformity, for each quantity.
RISK: Final = 0.025
# Scatter among the pillars, beyond the touches', that a departure must exceed so many times.
STANDS_OUT: Final = 6.0
# Finer than any instrument: what exact, made-up points scatter (m).
FINEST: Final = 1e-8


@dataclass(frozen=True)
class Scatter:
    """What touches of one kind of feature scatter: sum of squares, m², and degrees of freedom."""

    squared: float
    freedom: int

    @property
    def sigma(self) -> float:
        """Standard deviation of one coordinate, m."""
        return float(np.sqrt(self.squared / self.freedom)) if self.freedom > 0 else 0.0

    def __add__(self, other: Scatter) -> Scatter:
        return Scatter(self.squared + other.squared, self.freedom + other.freedom)

    def exceeds(self, sigma: float, freedom: float, chance: float) -> bool:
        """Whether it is more than a noise (m; known where ``freedom`` is inf), but for a chance."""
        if self.freedom < 1:
            return False
        most = chdtri(self.freedom, chance) / self.freedom
        if np.isfinite(freedom):
            most = fdtri(self.freedom, freedom, 1.0 - chance)
        return bool(self.squared > self.freedom * most * sigma**2)


def deviates(chance: float, freedom: float) -> float:
    """Standard deviations exceeded on one side with this chance; known where ``freedom`` is inf."""
    return float((-ndtri(chance)) if np.isinf(freedom) else (-stdtrit(freedom, chance)))
