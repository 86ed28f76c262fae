"""A base, an instrument or an artefact that creeps while rows are measured."""

from suta_calib.trust.in_time import BaseInTime


class BaseCreep(BaseInTime):
    """Every tip is displaced and turned ever more, along the axes of the base, row by row."""

    name = "base creep"
    about = "The base, the instrument or the artefact creeps row by row."
    sort = "base creep"
