"""How far the tip may be off because the arm's parameters are not known better.

For a small error of the parameters the tip moves by J, so the covariance C of a calibration gives
its position the variance trace(J C Jᵀ). Two figures matter. *Absolute*: in the base frame, as
calibrated; parameters that were held count as exact. *Registered*: what is left after a rigid
registration has taken out the motion common to a set of postures. Navigation registers, so this is
its error at the target from the arm alone; where the whole arm stands (the base gauge) drops out.

A residual is a distance, pixels, or a vector in somebody else's frame. What all kinds share is the
tip: it is displaced by that much from where it should be.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.batched import Batched
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import rms_length, skew
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import EXPANSION, ParameterSet
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.terms.term import Term
from suta_calib.trust.accuracy import block_residuals
from suta_calib.units import REFERENCE_TEMPERATURE, mm
from suta_calib.words import listed

# Of the motion of a direction's parts, what their sum may leave to be no motion.
STILL: Final = 0.05


@dataclass(frozen=True, eq=False)
class Sensitivity(Displayable):
    """The tip in some postures, and how it moves with parameters.

    Attributes:
        q: (n, joints) readings.
        position: (n, 3) of the tip in the base, m.
        rotation: (n, 3, 3) of the tip in the base.
        jacobian: (n, 3, p) derivative of the position by the parameters, base axes.
    """

    q: FloatArray
    position: FloatArray
    rotation: FloatArray
    jacobian: FloatArray

    def registered(self, reference: Sensitivity | None = None) -> FloatArray:
        """(n, 3, p) the derivative that a rigid registration at ``reference`` leaves.

        Args:
            reference: postures whose touched points are registered, three or more; by default the
                postures themselves, as an error map after a best fit over all of them.

        Returns:
            Error at each posture once the best rigid motion of the reference has been taken out.
            A turn that points on a line leave open is not taken out.
        """
        at = self if reference is None else reference
        centre = at.position.mean(axis=0)
        design = _rigid(at.position - centre).reshape(-1, 6)
        # Lengths and turns are made alike before it is judged what is open.
        scale = np.array([1.0] * 3 + [max(float(np.ptp(at.position, axis=0).max()), 1e-9)] * 3)
        # Relative singular value below which registration points leave a rotation open.
        fit = np.linalg.pinv(design / scale, 1e-6) @ at.jacobian.reshape(-1, at.jacobian.shape[2])
        return np.asarray(self.jacobian - _rigid(self.position - centre) / scale @ fit)

    def moved(self, step: FloatArray) -> float:
        """How far a step (p,) of the parameters moves the registered tip, m, RMS.

        Zero where the parts of the step cancel, or all postures move as one: such a step only draws
        frames elsewhere.
        """
        parts = float(np.linalg.norm(self.jacobian * step)) / math.sqrt(len(self.q))
        left = rms_length(self.registered() @ step)
        return left if left > STILL * parts else 0.0

    def std(self, covariance: FloatArray, jacobian: FloatArray | None = None) -> FloatArray:
        """(n,) 3-D standard uncertainty of the tip, m: root of the summed variances of x, y, z.

        Args:
            covariance: (p, p) of the parameters.
            jacobian: (n, 3, p), e.g. the `registered` one; the absolute one by default.
        """
        j = self.jacobian if jacobian is None else jacobian
        variance = np.einsum("nip,pq,niq->n", j, covariance, j, optimize=True)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def sensitivity(
    arm: ArmModel, values: Mapping[str, float], names: Sequence[str], q: FloatArray
) -> Sensitivity:
    """The tip and its derivative by some of the arm's parameters, all postures at once.

    Args:
        arm: the arm.
        values: parameter values, m or rad; nominal where not given; names of others are ignored.
        names: p parameters to differentiate by.
        q: (n, joints) readings.

    Returns:
        Postures, tips in m and the base's frame, and derivatives (n, 3, p), m per m or rad.
    """
    constants = [n for n in values if n in arm.offered and n not in names]
    batch = Batched(arm.function([*names, *constants]), len(q), shared=[0])
    every = {**arm.beside, **arm.offered}
    nominal = [values[n] if n in values else every[n].nominal for n in names]
    batch.inputs[0][:] = nominal + [values[n] for n in constants]
    batch.inputs[1][:] = q
    flat, position, velocity = batch()
    jacobian = velocity.reshape(len(q), 6, -1)[:, :3, : len(names)].copy()
    rotation = np.swapaxes(flat.reshape(-1, 3, 3), 1, 2).copy()
    return Sensitivity(np.array(q, dtype=float), position.copy(), rotation, jacobian)


def _rigid(position: FloatArray) -> FloatArray:
    """(n, 3, 6) motion of points by a displacement and a turn about the origin."""
    return np.concatenate([np.tile(np.eye(3), (len(position), 1, 1)), -skew(position)], axis=2)


def tip_displacements(term: Term, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Where the tip should have been, and how far off it is.

    Of a tip that touches, where it should have been is what the kind says (`Term.observed`). What
    an instrument or a camera sees is off by the least displacement d of the tip that explains the
    residual r best, of the least squares ‖r − ∂r/∂p · d‖.

    Args:
        term: whose samples are looked at.
        values: of the arm's parameters and the term's own, SI.

    Returns:
        Positions (n, 3) where the tip should have been and displacements (n, 3) from there, m, in
        the base.
    """
    # For differences of residuals, m: far above rounding, far below anything that is not linear.
    step = 1e-5
    rotation, position = term.poses.at(values)
    if term.medium == "touch":
        target = term.observed(values, term.poses).place
        return target, position - target
    block = term.blocks[0]

    def residual(shift: FloatArray) -> FloatArray:
        samples, bodies = term.poses.samples, term.poses.bodies
        moved = MeasuredPoses(rotation, position + shift, samples, bodies=bodies)
        return block_residuals([term.over_poses(moved)], ParameterSet(), values)[0]

    slopes = [(residual(d) - residual(-d)) / (2 * step) for d in step * np.eye(3)]
    by_place = np.stack(slopes, axis=-1)
    # Normal equations of all rows of a sample: of a board, every corner that was seen.
    curvature, gradient = np.zeros((len(position), 3, 3)), np.zeros((len(position), 3))
    rows = block.samples[:, 0]
    np.add.at(curvature, rows, np.einsum("nki,nkj->nij", by_place, by_place))
    np.add.at(gradient, rows, np.einsum("nki,nk->ni", by_place, residual(np.zeros(3))))
    # Relative curvature below which a direction of the tip is not seen at all.
    weak = np.linalg.pinv(curvature, rcond=1e-9, hermitian=True)
    displacement = np.einsum("nij,nj->ni", weak, gradient)
    return position - displacement, displacement


def taken_as_cool(parameters: ParameterSet, values: Mapping[str, float]) -> str:
    """That the tip is one at the reference temperature; empty where no value makes lengths grow."""
    # A warm afternoon, or motors that have run for an hour, K.
    warmer = 10.0
    grown = {n: v for n, v in values.items() if n in parameters and v}
    growth = {n: v for n, v in grown.items() if parameters[n].key == EXPANSION}
    if not growth:
        return ""
    most = mm(max(map(abs, growth.values())) * warmer)
    return (
        "The samples do not state the temperature of the arm. It is taken to be "
        f"{REFERENCE_TEMPERATURE:g} °C, though {listed(tuple(growth))} was estimated. If the arm "
        f"is {warmer:g} K warmer, each metre of it is longer or shorter by up to {most:.2g} mm."
    )
