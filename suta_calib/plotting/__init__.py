"""Pictures of numbers: what ``plot`` methods and the report draw, one file for each thing shown.

Nothing here knows an arm, a solution or an answer: these hand over arrays and names. Names are
imported when they are first used: who draws nothing need not wait for Matplotlib.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.plotting.change import Change as Change
    from suta_calib.plotting.on_axes import draw_changes as draw_changes
    from suta_calib.plotting.on_axes import draw_histogram as draw_histogram
    from suta_calib.plotting.on_axes import draw_prospects as draw_prospects
    from suta_calib.plotting.scene import Arrows as Arrows
    from suta_calib.plotting.scene import Line as Line
    from suta_calib.plotting.scene import Points as Points
    from suta_calib.plotting.scene import Scene as Scene
    from suta_calib.plotting.spatial import draw_scene as draw_scene
    from suta_calib.plotting.style import BLUE as BLUE
    from suta_calib.plotting.style import GREY as GREY
    from suta_calib.plotting.style import ORANGE as ORANGE
    from suta_calib.plotting.style import ROW_HEIGHT as ROW_HEIGHT
    from suta_calib.plotting.style import axes_or_new as axes_or_new
    from suta_calib.plotting.style import figure_or_new as figure_or_new

__getattr__, __all__ = public(__name__)
