"""From what on a departure from the drawing, or from the other pillars, is a fault."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import ndtri, stdtrit

# Chance that anything is named of an artefact with nothing wrong.
FALSE_ALARM: Final = 0.001
# Chance of wrongly proving nonconformity, for each quantity.
RISK: Final = 0.025
# Scatter among the pillars, beyond the touches', that a departure must exceed so many times.
STANDS_OUT: Final = 6.0


def deviates(chance: float, freedom: float) -> float:
    """Standard deviations exceeded on one side with this chance; known where ``freedom`` is inf."""
    return float((-ndtri(chance)) if np.isinf(freedom) else (-stdtrit(freedom, chance)))
