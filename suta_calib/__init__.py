"""Kinematic calibration of serial arms from their URDF.

A few lines do what the command line does::

    arm = ArmModel.from_urdf("arm.urdf", tip="tip")
    unknowns = arm.select(Selection(("*.offset",), bound_rad=0.26), "joint_4.z")
    poses = ArmPoses(arm, samples)
    problem = Problem([PairwiseDistance(poses, artefact, Noise(huber=1.35e-3))], unknowns)
    solution = solve(problem, Options(starts=8))
    print(solution.sentence, solution.unidentified)
    arm.write_urdf("calibrated.urdf", solution.values)

Names are imported when they are first used, so that the command line starts quickly.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

from suta_calib.lazy import lazily

if TYPE_CHECKING:
    from suta_calib.diagnostics.accuracy import Accuracy, Metrics, assess
    from suta_calib.errors import InputError, SutaCalibError
    from suta_calib.job.calibration import CalibrationJob, CalibrationResult
    from suta_calib.measurements import Artefact, Samples, read_artefact
    from suta_calib.model.arm import ArmModel
    from suta_calib.model.parameters import Parameter, ParameterSet, Selection
    from suta_calib.solver.ipopt import SolverOptions
    from suta_calib.solver.problem import Problem
    from suta_calib.solver.solution import Estimate, Solution
    from suta_calib.solver.solve import solve
    from suta_calib.terms import (
        ArmPoses,
        FixedPoint,
        MeasuredPoses,
        Noise,
        PairwiseDistance,
        Term,
        TrackedPoint,
    )

__version__ = version("suta_calib")

_HOMES = {
    "diagnostics.accuracy": ("Accuracy", "Metrics", "assess"),
    "errors": ("InputError", "SutaCalibError"),
    "job.calibration": ("CalibrationJob", "CalibrationResult"),
    "measurements": ("Artefact", "Samples", "read_artefact"),
    "model.arm": ("ArmModel",),
    "model.parameters": ("Parameter", "ParameterSet", "Selection"),
    "solver.ipopt": ("SolverOptions",),
    "solver.problem": ("Problem",),
    "solver.solution": ("Estimate", "Solution"),
    "solver.solve": ("solve",),
    "terms": (
        *("ArmPoses", "FixedPoint", "MeasuredPoses", "Noise"),
        *("PairwiseDistance", "Term", "TrackedPoint"),
    ),
}

__all__ = [
    "Accuracy",
    "ArmModel",
    "ArmPoses",
    "Artefact",
    "CalibrationJob",
    "CalibrationResult",
    "Estimate",
    "FixedPoint",
    "InputError",
    "MeasuredPoses",
    "Metrics",
    "Noise",
    "PairwiseDistance",
    "Parameter",
    "ParameterSet",
    "Problem",
    "Samples",
    "Selection",
    "Solution",
    "SolverOptions",
    "SutaCalibError",
    "Term",
    "TrackedPoint",
    "assess",
    "read_artefact",
    "solve",
]

__getattr__ = lazily(__name__, _HOMES)
