"""Which landmark, placement, set, point or row does not agree with the rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.analysis.outliers.answer import AGREEMENT as AGREEMENT
    from suta_calib.analysis.outliers.answer import GROUPING_NOUN as GROUPING_NOUN
    from suta_calib.analysis.outliers.answer import METRICS as METRICS
    from suta_calib.analysis.outliers.answer import Displacement as Displacement
    from suta_calib.analysis.outliers.answer import GrossTouch as GrossTouch
    from suta_calib.analysis.outliers.answer import Group as Group
    from suta_calib.analysis.outliers.answer import HeldOut as HeldOut
    from suta_calib.analysis.outliers.answer import Level as Level
    from suta_calib.analysis.outliers.answer import Metric as Metric
    from suta_calib.analysis.outliers.answer import Move as Move
    from suta_calib.analysis.outliers.answer import Outliers as Outliers
    from suta_calib.analysis.outliers.answer import TermOutliers as TermOutliers
    from suta_calib.analysis.outliers.answer import Thresholds as Thresholds
    from suta_calib.analysis.outliers.plots import draw_metrics as draw_metrics
    from suta_calib.analysis.outliers.search import find_outliers as find_outliers

__getattr__, __all__ = public(__name__)
