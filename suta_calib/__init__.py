"""Kinematic calibration of serial arms from their URDF.

A few lines do what the command line does::

    arm = ArmModel.from_urdf("arm.urdf", tip="tip")
    unknowns = arm.select(Selection(("*.offset",), bound_rad=0.26), "joint_4.z")
    poses = ArmPoses(arm, samples)
    problem = Problem([PairwiseDistance(poses, artefact, Noise(huber=1.35e-3))], unknowns)
    solution = solve(problem, SolverOptions(starts=8))
    print(solution.sentence, solution.unidentified)
    arm.write_urdf("calibrated.urdf", solution.values)

Names are imported when they are first used, so that the command line starts quickly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.analysis.error_budget import error_budget as error_budget
    from suta_calib.analysis.iso10360 import acceptance_test as acceptance_test
    from suta_calib.analysis.model_selection import choose_model as choose_model
    from suta_calib.analysis.outliers import find_outliers as find_outliers
    from suta_calib.analysis.tip_map import tip_map as tip_map
    from suta_calib.assessment import Assessment as Assessment
    from suta_calib.diagnostics.accuracy import Accuracy as Accuracy
    from suta_calib.diagnostics.accuracy import Metrics as Metrics
    from suta_calib.diagnostics.accuracy import assess as assess
    from suta_calib.diagnostics.explanation import Explanation as Explanation
    from suta_calib.diagnostics.observability import Observability as Observability
    from suta_calib.diagnostics.observability import observe as observe
    from suta_calib.errors import InputError as InputError
    from suta_calib.errors import SutaCalibError as SutaCalibError
    from suta_calib.job import AcceptanceJob as AcceptanceJob
    from suta_calib.job import CalibrationJob as CalibrationJob
    from suta_calib.job import CalibrationResult as CalibrationResult
    from suta_calib.measurements import Artefact as Artefact
    from suta_calib.measurements import Landmark as Landmark
    from suta_calib.measurements import SampleColumns as SampleColumns
    from suta_calib.measurements import Samples as Samples
    from suta_calib.measurements import read_artefact as read_artefact
    from suta_calib.measurements import read_samples as read_samples
    from suta_calib.model import ArmModel as ArmModel
    from suta_calib.model import Parameter as Parameter
    from suta_calib.model import ParameterSet as ParameterSet
    from suta_calib.model import Selection as Selection
    from suta_calib.pose_calibration.hand_eye import calibrate_hand_eye as calibrate_hand_eye
    from suta_calib.pose_calibration.pivot import calibrate_pivot as calibrate_pivot
    from suta_calib.pose_calibration.registration import register as register
    from suta_calib.simulation import InverseKinematics as InverseKinematics
    from suta_calib.simulation import simulate as simulate
    from suta_calib.solver.options import SolverOptions as SolverOptions
    from suta_calib.solver.problem import Problem as Problem
    from suta_calib.solver.solution import Estimate as Estimate
    from suta_calib.solver.solution import Solution as Solution
    from suta_calib.solver.solve import solve as solve
    from suta_calib.terms import KINDS as KINDS
    from suta_calib.terms import ArmPoses as ArmPoses
    from suta_calib.terms import FixedPoint as FixedPoint
    from suta_calib.terms import HandEye as HandEye
    from suta_calib.terms import MeasuredPoses as MeasuredPoses
    from suta_calib.terms import Noise as Noise
    from suta_calib.terms import PairwiseDistance as PairwiseDistance
    from suta_calib.terms import Seating as Seating
    from suta_calib.terms import Term as Term
    from suta_calib.terms import TouchedLandmark as TouchedLandmark
    from suta_calib.terms import TrackedPoint as TrackedPoint

# `pyproject.toml` has it from here: to look for it among what is installed takes long.
__version__ = "0.1.0"

__getattr__, __all__ = public(__name__)
