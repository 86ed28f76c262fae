"""Colours and sizes that all pictures share, whoever draws them."""

from __future__ import annotations

from typing import Final

# Okabe, Ito (2008), https://jfly.uni-koeln.de/color/: told apart by colour-blind people, and these
# three also by their grey.
BLUE: Final = "#0072B2"
ORANGE: Final = "#E69F00"
GREY: Final = "#999999"
TINT: Final = "#CFE3F1"  # of surfaces that something stands on
LINE: Final = "#dddddd"  # of a grid
# A box behind letters, so that they stand out from the marks below them.
BEHIND: Final = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
WIDTH: Final = 7.2  # of a plot on the page, inch
LARGE: Final = 1.3 * WIDTH  # of one of several panels
ROW_HEIGHT: Final = 0.19  # of a name in a list, inch


def shortened(text: str, most: int = 40) -> str:
    """A label of no more than so many characters."""
    return text if len(text) <= most else f"{text[: most - 1]}…"
