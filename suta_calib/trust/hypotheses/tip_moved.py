"""A tool, or a target on it, that was moved between two rows."""

from suta_calib.trust.in_time import TipInTime


class TipMoved(TipInTime):
    """Every tip is displaced and turned alike, along the axes of the tip, from a row on."""

    name = "tip moved"
    about = "The tool, or a target on it, was moved at a row."
    sort = "tip"
    at_once = True
