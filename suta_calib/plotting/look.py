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
BLACK: Final = "#000000"
WHITE: Final = "#ffffff"
# ColorBrewer's Blues (Brewer, 2003, https://colorbrewer2.org), in ten steps: sizes.
SHADES: Final = (
    *("#f7fbff", "#e3eef8", "#d0e1f2", "#b7d4ea", "#94c4df"),
    *("#6aaed6", "#4a98c9", "#2e7ebc", "#1764ab", "#08306b"),
)
WIDTH: Final = 7.2  # of a plot on the page, inch
LARGE: Final = 1.3 * WIDTH  # of one of several panels
ROW_HEIGHT: Final = 0.19  # of a name in a list, inch


def shade(share: float) -> str:
    """The colour of a size, as a part of the largest."""
    return SHADES[min(int(share * len(SHADES)), len(SHADES) - 1)]


def shortened(text: str, most: int = 40) -> str:
    """A label of no more than so many characters."""
    return text if len(text) <= most else f"{text[: most - 1]}…"
