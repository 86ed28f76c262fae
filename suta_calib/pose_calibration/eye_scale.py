"""What one factor on all that an eye sees does to where it is found to be.

A target of another size than the file says puts all that is seen nearer or farther by one factor.
X follows it, and so far as the distances hardly differ no residual shows it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from suta_calib.geometry.numbers import tangent_of_vector
from suta_calib.measurements.scale import PPM, LengthScale
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.solver.covariance import observed_parts
from suta_calib.solver.problem import Problem


def with_scale(answer: HandEyeCalibration, scale_ppm: float) -> HandEyeCalibration:
    """The same with the scale's part in the covariance.

    Where the residuals show that distances are off, the covariance allows for that already.

    Args:
        answer: from pairs of poses.
        scale_ppm: standard deviation of the factor on what was seen, against what the hand moved,
            1e-6.
    """
    if answer.far_sight or scale_ppm == 0.0:
        return answer
    solution, scale = answer.solution, LengthScale(scale_ppm * PPM)
    problem = Problem([replace(term, scale=scale) for term in solution.problem.terms])
    part = observed_parts(problem, solution.x, solution.sigmas, solution.free).of_scale
    jacobian = np.diag(np.tile(np.repeat([answer.length, 1.0], 3), 2))
    jacobian[3:6, 3:6] = tangent_of_vector(solution.x[3:6])
    jacobian[9:, 9:] = tangent_of_vector(solution.x[9:12])
    return replace(answer, covariance=answer.covariance + jacobian @ part @ jacobian.T)
