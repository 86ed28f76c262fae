"""A tool, or a target on it, that creeps while rows are measured."""

from suta_calib.trust.in_time import TipInTime


class TipCreep(TipInTime):
    """Every tip is displaced and turned ever more, along the axes of the tip, row by row."""

    name = "tip creep"
    about = "The tool, or a target on it, creeps row by row."
    sort = "tip creep"
