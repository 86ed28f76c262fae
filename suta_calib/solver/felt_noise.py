"""What the noise of tilt sensors adds to how unsure an estimate is.

A sensor's noise e turns a link, and so moves the tip: this is in the residuals, and in every ±. But
the same noise is in the derivatives J by where the link turns, so that rows which the noise leaned
farther weigh more (errors in variables; Fuller 1987, doi:10.1002/9780470316665). The gradient
g = Jᵀ W r of the cost is then not zero on average where the parameters are true, and the estimate
is off by

    b = A⁻¹ Σ ½ σ² ∂²g/∂e²

over the axes of all sensors, which no residual shows. An accelerometer's noise σ is told by how
much the length of what it felt at rest scatters. The estimate is not corrected by b, because it
would then scatter as much as it is off now: of forty simulated columns with sensors that scatter by
0.006° shares were off by 0.057 and 0.045 (RMS), and by 0.055 and 0.054 when corrected.
"""

from __future__ import annotations

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.measurements.felt import at_rest
from suta_calib.model.tilt import TiltSensor
from suta_calib.solver.fitted import Fitted
from suta_calib.solver.information import whitened_rows
from suta_calib.solver.problem import Problem
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term


def felt_noise_error(fit: Fitted) -> FloatArray:
    """(n,) the error b of an estimate; zero without sensors."""
    sensors = dict.fromkeys(
        sensor
        for term in fit.problem.terms
        if isinstance(term.poses, ArmPoses) and term.poses.samples.felt
        for sensor in term.poses.arm.tilt_sensors
    )
    if not sensors:
        return np.zeros(len(fit.x))
    at = _gradient(fit, fit.problem.terms)
    shift = np.zeros(len(fit.x))
    for sensor in sensors:
        noise = _noise(sensor, fit.problem.terms)
        for step in noise * np.eye(3) if noise > 0.0 else ():
            for sign in (1.0, -1.0):
                felt = tuple(_with_error(term, sensor, sign * step) for term in fit.problem.terms)
                shift += 0.5 * (_gradient(fit, felt) - at)
    return np.asarray(-fit.bread(fit.rows()) @ shift)


def _noise(sensor: TiltSensor, terms: tuple[Term, ...]) -> float:
    """Standard deviation of a component, as a part of gravity, at rest."""
    lengths = [
        np.linalg.norm(felt[at_rest(felt)], axis=1)
        for term in terms
        for felt in [term.poses.samples.felt.get(sensor.felt, np.zeros((0, 3)))]
        if len(felt)
    ]
    length = np.concatenate([*lengths, np.zeros(0)])
    if len(length) < 3:
        return 0.0
    usual = float(np.median(length))
    # Of a normal distribution, by the median, so that rows in motion do not count.
    return 1.4826 * float(np.median(np.abs(length - usual))) / usual


def _with_error(term: Term, sensor: TiltSensor, step: FloatArray) -> Term:
    """A term whose sensor felt a little more in every row (3,), in parts of gravity."""
    poses = term.poses
    if not isinstance(poses, ArmPoses) or sensor.felt not in poses.samples.felt:
        return term
    return term.over_poses(poses.with_felt_error(sensor.felt, step))


def _gradient(fit: Fitted, terms: tuple[Term, ...]) -> FloatArray:
    """(n,) of the data's cost, with these terms in place of the fitted ones."""
    problem = Problem(terms, fit.problem.arm_parameters)
    total = np.zeros(len(fit.x))
    for rows in whitened_rows(problem, fit.x, fit.sigmas):
        line = rows.line
        residual = line.residual / line.sigma[:, None] * line.weight[:, None]
        total += rows.jacobian.T @ residual.reshape(-1)
    return total
