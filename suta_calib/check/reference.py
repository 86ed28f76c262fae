"""What new rows are held against: a calibration, with the dimensions that it holds wrongly.

A job may hold dimensions that are not as drawn. The fit then takes a part of their effect, another
one at every posture, and sound rows elsewhere look as if a link had moved. Where the calibrated
rows tell of these dimensions, they are estimated beside the job's own unknowns, under the priors
that are usual: a change is what new rows say beyond that.
"""

from __future__ import annotations

from suta_calib.model.parameters import ParameterSet, with_usual_priors
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.linearised import best_extension


def reference_of(solution: Solution) -> Solution:
    """The solution; or one of all geometry, where this predicts rows left out of the fit better."""
    arm, fitted = solution.problem.arm, solution.problem.arm_parameters
    held = [] if arm is None else [name for name in arm.geometric if name not in fitted]
    linear = CalibrationExamination.of(solution).fewer.linearised if held else None
    if arm is None or linear is None or best_extension(linear, (), [held]) is None:
        return solution
    more = with_usual_priors([arm.offered[name] for name in held])
    parameters = ParameterSet([*fitted.values(), *more.values()])
    wider = solve(Problem(solution.problem.terms, parameters), SolverOptions(starts=1))
    return wider if wider.converged else solution
