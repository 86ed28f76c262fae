"""A base, an instrument or an artefact that was moved between two rows."""

from suta_calib.trust.in_time import BaseInTime


class BaseMoved(BaseInTime):
    """Every tip is displaced and turned alike, along the axes of the base, from a row on."""

    name = "base moved"
    about = "The base, the instrument or the artefact was moved at a row."
    sort = "base"
    at_once = True
