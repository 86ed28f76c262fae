"""How far the spread of a few trials may be from the predicted one by chance."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

RISK = 1e-3


def is_as_predicted(ratio: float, numbers: int) -> bool:
    """Whether a found over a predicted standard deviation of so many numbers may be chance.

    With honest standard deviations one seed of a thousand is beyond.
    """
    least, most = np.sqrt(chi2.ppf([RISK / 2, 1 - RISK / 2], numbers) / numbers)
    return bool(least < ratio < most)
