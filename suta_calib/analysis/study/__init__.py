"""How many sets a calibration needs, and how much its answer varies: trials run anywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.analysis.study.drift import DriftOptions as DriftOptions
    from suta_calib.analysis.study.drift import DriftPoint as DriftPoint
    from suta_calib.analysis.study.drift import DriftStudy as DriftStudy
    from suta_calib.analysis.study.drift import drift_study as drift_study
    from suta_calib.analysis.study.plan import Request as Request
    from suta_calib.analysis.study.plan import StudyPlan as StudyPlan
    from suta_calib.analysis.study.plan import plan_study as plan_study
    from suta_calib.analysis.study.plan import run_study as run_study
    from suta_calib.analysis.study.study import ParameterSpread as ParameterSpread
    from suta_calib.analysis.study.study import SizeResult as SizeResult
    from suta_calib.analysis.study.study import SizeStudy as SizeStudy
    from suta_calib.analysis.study.study import SpreadStudy as SpreadStudy
    from suta_calib.analysis.study.study import Study as Study
    from suta_calib.analysis.study.study import TrialScatter as TrialScatter
    from suta_calib.analysis.study.study import judge_sizes as judge_sizes
    from suta_calib.analysis.study.study import judge_spread as judge_spread
    from suta_calib.analysis.study.study import study_of_job as study_of_job
    from suta_calib.analysis.study.trial import Trial as Trial

__getattr__, __all__ = public(__name__)
