"""What a fit and its data say of each other: errors, repeats, what is missing, what is open.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.diagnostics.accuracy import Accuracy as Accuracy
    from suta_calib.diagnostics.accuracy import BlockErrors as BlockErrors
    from suta_calib.diagnostics.accuracy import Metrics as Metrics
    from suta_calib.diagnostics.accuracy import TermAccuracy as TermAccuracy
    from suta_calib.diagnostics.accuracy import assess as assess
    from suta_calib.diagnostics.explanation import Explanation as Explanation
    from suta_calib.diagnostics.explanation import explain as explain
    from suta_calib.diagnostics.observability import Indices as Indices
    from suta_calib.diagnostics.observability import Observability as Observability
    from suta_calib.diagnostics.observability import Prospect as Prospect
    from suta_calib.diagnostics.observability import observe as observe
    from suta_calib.diagnostics.repeats import LackOfFit as LackOfFit
    from suta_calib.diagnostics.repeats import TouchRepeatability as TouchRepeatability
    from suta_calib.diagnostics.repeats import touch_repeatability as touch_repeatability
    from suta_calib.diagnostics.score_tests import ScoreTest as ScoreTest
    from suta_calib.diagnostics.tip_uncertainty import sensitivity as sensitivity

__getattr__, __all__ = public(__name__)
