"""What all pictures share: colours, sizes, how much each holds, factors that enlarge.

It needs no Matplotlib: who tells what a picture leaves out need not draw it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.units import Unit

# Okabe, Ito (2008), https://jfly.uni-koeln.de/color/: told apart by colour-blind people, and these
# three also by their grey.
BLUE: Final = "#0072B2"
ORANGE: Final = "#E69F00"
GREY: Final = "#999999"
TINT: Final = "#CFE3F1"  # of surfaces that something stands on
LINE: Final = "#dddddd"  # of a grid
# What does not agree with the rest.
OUTLIER: Final = {"marker": "X", "color": ORANGE, "linestyle": "none", "mec": "black"}
# A box behind letters, so that they stand out from the marks below them.
BEHIND: Final = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
WIDTH: Final = 7.2  # of a plot on the page, inch
LARGE: Final = 1.3 * WIDTH  # of one of several panels
ROW_HEIGHT: Final = 0.19  # of a name in a list, inch
# Of many samples so many are drawn, evenly spread over their order.
MOST_DRAWN: Final = 1500
# Of many arrows so many are drawn: more hide each other.
MOST_ARROWS: Final = 120
# Places whose labels stand beside them; of more none does.
MOST_LABELLED: Final = 12
# Groups with a box each, worst first.
MOST_GROUPS: Final = 30
# Parameters of a map of correlations, most correlated first, and of one with numbers in it.
MOST_CORRELATED: Final = 30
MOST_WRITTEN: Final = 14


def shortened(text: str, most: int = 40) -> str:
    """A label of no more than so many characters."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def round_down(value: float) -> float:
    """1, 2 or 5 times a power of ten, at most a positive value: a factor that can be told."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in (1, 2, 5) if step * decade <= value * (1 + 1e-9)))


@dataclass(frozen=True)
class Change:
    """How far a parameter moved.

    Attributes:
        name: the parameter's.
        unit: its SI unit.
        change: from nominal, SI.
        std: its standard deviation, SI.
        by_prior: whether most of what is known of it was known before.
    """

    name: str
    unit: Unit
    change: float
    std: float
    by_prior: bool = False
