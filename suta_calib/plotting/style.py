"""Matplotlib in the look that all pictures share, and axes to draw on."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.plotting.look import LINE

STYLE: Final[dict[str, Any]] = {
    "svg.fonttype": "none",
    "text.parse_math": False,
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.axisbelow": True,
    "grid.color": LINE,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    # A narrow page enlarges letters: names beside an axis come nearer to its label.
    "axes.labelpad": 10.0,
    "legend.columnspacing": 3.5,
}


@contextmanager
def style(name: str) -> Iterator[None]:
    """The look of all plots of a page, whatever the user's settings are; by the plot's name."""
    with mpl.rc_context(), warnings.catch_warnings():
        mpl.rcdefaults()
        settings: Any = STYLE | {"svg.hashsalt": name}
        mpl.rcParams.update(settings)
        # The browser has glyphs that Matplotlib's font may lack.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


def axes_or_new(ax: Axes | None, size: tuple[float, float], projection: str | None = None) -> Any:
    """The axes that were given, or those of a new figure that pyplot shows.

    Args:
        ax: to draw on, or None.
        size: width and height of a new figure, inch.
        projection: of new axes, such as ``3d``.

    Raises:
        ValueError: axes of another projection were given.
    """
    if ax is None:
        from matplotlib import pyplot

        figure = pyplot.figure(figsize=size, layout="constrained")
        return figure.add_subplot(projection=projection)
    if ax.name != (projection or "rectilinear"):
        raise ValueError(
            f"found axes of projection {ax.name!r}; expected {projection or 'rectilinear'!r}; "
            f"make them with figure.add_subplot(projection={projection!r})"
        )
    return ax


def figure_or_new(figure: Any, size: tuple[float, float]) -> Any:
    """The figure that was given, or a new one that pyplot shows, so wide and high, inch."""
    if figure is None:
        from matplotlib import pyplot

        figure = pyplot.figure(figsize=size, layout="constrained")
    return figure


def legend_above(
    axes: Any, handles: Sequence[Any] | None = None, columns: int = 2, title: str = ""
) -> None:
    """Put the legend over the panel, where it hides nothing, and the title over that."""
    handles = axes.get_legend_handles_labels()[0] if handles is None else handles
    # A row of a legend in letters of 8 points, and room about it.
    axes.set_title(title, pad=13.0 * -(-len(handles) // columns) + 6.0)
    if handles:
        look: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1), "frameon": False}
        axes.legend(handles=handles, ncols=columns, fontsize=8, **look)


def shades() -> Any:
    """Colours of sizes from 0 to 1: ColorBrewer's Blues (Brewer, 2003) in ten steps."""
    return mpl.colormaps["Blues"].resampled(10)


def thinned(x: FloatArray, y: FloatArray) -> IntArray:
    """Rows of marks (n,) to draw: where thousands hide each other, one of each small cell."""
    if len(x) <= 2000:
        return np.arange(len(x))
    # Cells of a 300th: about two points of a panel, less than a mark.
    cells = [np.floor(300 * (v - v.min()) / (np.ptp(v) or 1.0)) for v in (x, y)]
    return np.sort(np.unique(np.stack(cells), axis=1, return_index=True)[1])


def plain_log(axis: Any, set_scale: Any) -> None:
    """A log axis with plain numbers at its decades: mathematical markup is off.

    Between them 2 and 5 are marked: eight marks each take longer to draw than all else.
    """
    set_scale("log")
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
