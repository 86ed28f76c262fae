"""Which landmark, placement, set, point or row does not agree with the rest."""

from suta_calib.analysis.outliers.answer import (
    AGREEMENT,
    GROUPING_NOUN,
    METRICS,
    Displacement,
    GrossTouch,
    Group,
    HeldOut,
    Level,
    Metric,
    Outliers,
    TermOutliers,
    Thresholds,
)
from suta_calib.analysis.outliers.search import find_outliers

__all__ = [
    "AGREEMENT",
    "GROUPING_NOUN",
    "METRICS",
    "Displacement",
    "GrossTouch",
    "Group",
    "HeldOut",
    "Level",
    "Metric",
    "Outliers",
    "TermOutliers",
    "Thresholds",
    "find_outliers",
]
