"""Studies over the simulated SUTA of this repository, planned in milliseconds."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from suta_calib.analysis.study.plan import Request, StudyPlan, plan_study
from suta_calib.job.calibration import CalibrationJob

SUTA = Path(__file__).resolve().parents[2] / "data" / "suta"


@cache
def suta_job(name: str = "calibration") -> CalibrationJob:
    """A job of ``data/suta``."""
    return CalibrationJob.load(SUTA / f"{name}.yaml")


def planned(job: CalibrationJob | None = None, *, held_out: bool = True, **asked: Any) -> StudyPlan:
    """A plan of a study; keywords are those of `Request`."""
    job = suta_job() if job is None else job
    options = replace(job.options(), starts=1)
    validation = job.validation if held_out else ()
    return plan_study(job.parameters, job.observations, validation, options, Request(**asked))
