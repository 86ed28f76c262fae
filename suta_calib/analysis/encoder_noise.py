"""What the encoders' noise does to residuals and to the tip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from suta_calib.arrays import FloatArray
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term


@dataclass(frozen=True)
class EncoderNoise:
    """What is known of the encoders beforehand.

    Attributes:
        bits: revolute joints read whole steps of 2π / 2^bits; None where that is not known.
        angle: standard deviation of a revolute joint's reading beside the steps, rad.
        length: standard deviation of a prismatic joint's reading, m.
    """

    bits: int | None = None
    angle: float = 0.0
    length: float = 0.0

    def std(self, arm: ArmModel) -> FloatArray:
        """(joints,) standard deviation of each reading: steps are uniform, a twelfth of a step²."""
        step = 0.0 if self.bits is None else 2 * np.pi / 2**self.bits
        turning = float(np.hypot(step / np.sqrt(12.0), self.angle))
        prismatic = [joint.type == "prismatic" for joint in arm.chain.moving]
        return np.where(prismatic, self.length, turning)


@dataclass(frozen=True, eq=False)
class Linear:
    """Terms at given parameter values.

    Attributes:
        problem: the terms, with every joint's offset among the arm's unknowns.
        residuals: by block, (n, d).
        by_reading: by block, (n,) variance of a residual's norm that the encoders make, m² or rad².
        by_parameters: by block, (n, d, p) derivative by the arm's parameters asked for.
        tip_by_reading: (samples,) variance of the tip's position that the encoders make, m².
        tip_by_parameters: (samples, 3, p) derivative of the tip's position.
    """

    problem: Problem
    residuals: list[FloatArray]
    by_reading: list[FloatArray]
    by_parameters: list[FloatArray]
    tip_by_reading: FloatArray
    tip_by_parameters: FloatArray


def linear(
    terms: Sequence[Term], names: Sequence[str], values: Mapping[str, float], std: FloatArray
) -> Linear:
    """Residuals and their derivatives by readings and by some of the arm's parameters.

    Args:
        terms: over one arm.
        names: the arm's parameters to differentiate by.
        values: of all parameters, the terms' own among them.
        std: (joints,) of each reading, rad or m.
    """
    arm = Problem(terms).arm
    assert arm is not None
    offsets = [f"{joint}.offset" for joint in arm.joints]
    # What is not estimated may still have a value: that of a job's fixed parameters is nominal.
    own = [n for n in (*arm.parameters, *arm.nongeometric) if n in {*names, *offsets}]
    problem = Problem(terms, ParameterSet(arm.offered[n] for n in own))
    x = np.array([values.get(p.name, p.nominal) for p in problem.parameters.values()])
    lines = problem.linearise(x, problem.assumed_sigmas())
    velocity = problem.evaluation.table.velocity
    joints = [own.index(n) for n in offsets]
    chosen = [own.index(n) for n in names]
    rows = np.arange(len(velocity))
    samples = rows // 6
    residuals, by_reading, by_parameters = [], [], []
    for line in lines:
        n, size = line.residual.shape
        motion = line.pattern.by_velocity(line.by_pose)
        residuals.append(line.residual.copy())
        # If every sample's readings err independently.
        variance = np.zeros(motion.shape[0])
        for joint, level in zip(joints, std, strict=True):
            block = sparse.csr_array((velocity[:, joint], (rows, samples)))
            variance += np.asarray((motion @ block).power(2).sum(axis=1)).reshape(-1) * level**2
        by_reading.append(variance.reshape(n, size).sum(axis=1))
        by_parameters.append((motion @ velocity[:, chosen]).reshape(n, size, len(chosen)))
    moved = velocity.reshape(-1, 6, len(own))[:, :3]
    tip = np.einsum("nij,j->n", moved[:, :, joints] ** 2, std**2)
    return Linear(problem, residuals, by_reading, by_parameters, tip, moved[:, :, chosen])
