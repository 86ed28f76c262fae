"""How much a picture holds: who tells what it leaves out need not draw it."""

from __future__ import annotations

from typing import Final

# Of many samples so many are drawn, evenly spread over their order.
MOST_DRAWN: Final = 1500
# Groups with a box each, worst first.
MOST_GROUPS: Final = 30
# Parameters of a map of correlations, most correlated first, and of one with numbers in it.
MOST_CORRELATED: Final = 30
MOST_WRITTEN: Final = 14
