"""From terms to a solution: problem, evaluation, descent, verdict.

Names are imported when they are first used. `suta_calib.solve` starts it all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.solver.covariance import predicted_covariance as predicted_covariance
    from suta_calib.solver.identifiability import Combination as Combination
    from suta_calib.solver.identifiability import Identification as Identification
    from suta_calib.solver.identifiability import identify as identify
    from suta_calib.solver.information import Information as Information
    from suta_calib.solver.information import predicted_information as predicted_information
    from suta_calib.solver.information import whitened_rows as whitened_rows
    from suta_calib.solver.ipopt import Minimum as Minimum
    from suta_calib.solver.ipopt import RobustNlp as RobustNlp
    from suta_calib.solver.losses import huber_threshold as huber_threshold
    from suta_calib.solver.options import SolverOptions as SolverOptions
    from suta_calib.solver.options import WeightOptions as WeightOptions
    from suta_calib.solver.problem import Problem as Problem
    from suta_calib.solver.solution import Estimate as Estimate
    from suta_calib.solver.solution import Solution as Solution
    from suta_calib.solver.solve import identify_at as identify_at
    from suta_calib.solver.solve import start_points as start_points
    from suta_calib.solver.weights import Weights as Weights

__getattr__, __all__ = public(__name__)
