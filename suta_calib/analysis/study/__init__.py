"""How many sets a calibration needs, and how much its answer varies: trials run anywhere."""

from suta_calib.analysis.study.plan import Request, StudyPlan, plan_study, run_study
from suta_calib.analysis.study.study import (
    ParameterSpread,
    SizeResult,
    SizeStudy,
    SpreadStudy,
    Study,
    TrialScatter,
    judge_sizes,
    judge_spread,
    study_of_job,
)
from suta_calib.analysis.study.trial import Trial

__all__ = [
    "ParameterSpread",
    "Request",
    "SizeResult",
    "SizeStudy",
    "SpreadStudy",
    "Study",
    "StudyPlan",
    "Trial",
    "TrialScatter",
    "judge_sizes",
    "judge_spread",
    "plan_study",
    "run_study",
    "study_of_job",
]
