"""The kinds of observation, by name. A new one is one new file here, and one line below."""

from __future__ import annotations

from typing import Final

from suta_calib.terms.camera_view import CameraView
from suta_calib.terms.fixed_point import FixedPoint
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.landmark import TouchedLandmark
from suta_calib.terms.line import TouchedLine
from suta_calib.terms.pairwise_distance import PairwiseDistance
from suta_calib.terms.plane import TouchedPlane
from suta_calib.terms.range import MeasuredRange
from suta_calib.terms.term import Term
from suta_calib.terms.tracked_point import TrackedPoint

# In the order in which they are offered; where one of a sort is needed, the first is taken.
KINDS: Final[dict[str, type[Term]]] = {
    cls.kind: cls
    for cls in (
        PairwiseDistance,
        TouchedLandmark,
        FixedPoint,
        TouchedPlane,
        TouchedLine,
        MeasuredRange,
        TrackedPoint,
        HandEye,
        CameraView,
    )
}
# What one group of samples is called, in any kind, and the label columns that name it.
GROUPINGS: Final = {
    noun: columns for kind in KINDS.values() for noun, columns in kind.groupings.items()
}


def first_kind(*, artefact: bool) -> type[Term]:
    """The first kind whose tip touches an artefact, or a place without one."""
    touching = (kind for kind in KINDS.values() if kind.medium == "touch")
    return next(kind for kind in touching if kind.needs_artefact == artefact)
