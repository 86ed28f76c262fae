"""Jobs: files that say what to calibrate or to test, read once, typed.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.job.acceptance import AcceptanceJob as AcceptanceJob
    from suta_calib.job.acceptance import ProbedSpheres as ProbedSpheres
    from suta_calib.job.calibration import CalibrationJob as CalibrationJob
    from suta_calib.job.calibration import CalibrationResult as CalibrationResult
    from suta_calib.job.calibration import read_arm_samples as read_arm_samples
    from suta_calib.job.calibration import read_term as read_term
    from suta_calib.job.dh_file import dh_text as dh_text
    from suta_calib.job.dh_file import read_dh_table as read_dh_table
    from suta_calib.job.limits import DecisionRule as DecisionRule
    from suta_calib.job.limits import LengthLimit as LengthLimit
    from suta_calib.job.limits import Limits as Limits
    from suta_calib.job.limits import StatedUncertainty as StatedUncertainty
    from suta_calib.job.new_job import write_job as write_job
    from suta_calib.job.outline import JobOutline as JobOutline
    from suta_calib.job.outline import PlannedObservation as PlannedObservation
    from suta_calib.job.outline import read_outline as read_outline
    from suta_calib.job.schema import ArmSpec as ArmSpec
    from suta_calib.job.schema import JobSpec as JobSpec
    from suta_calib.job.schema import ObservationSpec as ObservationSpec
    from suta_calib.job.schema import SolverSpec as SolverSpec
    from suta_calib.job.schema import read_job as read_job
    from suta_calib.terms.poses import joint_ranges as joint_ranges

__getattr__, __all__ = public(__name__)
