"""Matplotlib in the look that all pictures share, and axes to draw on."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from suta_calib.plotting.look import BLUE as BLUE
from suta_calib.plotting.look import GREY as GREY
from suta_calib.plotting.look import LARGE as LARGE
from suta_calib.plotting.look import LINE
from suta_calib.plotting.look import ORANGE as ORANGE
from suta_calib.plotting.look import ROW_HEIGHT as ROW_HEIGHT
from suta_calib.plotting.look import TINT as TINT
from suta_calib.plotting.look import WIDTH as WIDTH

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
    # Room for text that a narrow page enlarges.
    "axes.labelpad": 7.0,
    "legend.columnspacing": 3.5,
    "legend.frameon": False,
}


@contextmanager
def style(name: str) -> Iterator[None]:
    """The look all plots of a page share, whatever the user's own Matplotlib settings are.

    Args:
        name: of the plot, unique on the page: keeps the ids in its SVG its own.
    """
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


def plain_log(axis: Any, set_scale: Any) -> None:
    """A log axis with plain numbers at its decades: mathematical markup is off.

    Between them 2 and 5 are marked: eight marks each take longer to draw than all else.
    """
    set_scale("log")
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
