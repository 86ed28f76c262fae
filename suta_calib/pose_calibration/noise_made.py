"""Directions of X that noise of the hand's turns would tell as well: refused, not answered.

Turns of the hand make X's position known: between two poses that are turned alike, X may slide, and
nothing changes. Noise turns every pose a little, too, and seems to tell what it does not (errors in
variables). How much of the information about a direction noise made up is asked of the pairs: the
turns of the hand can be no noisier than their residuals, nor noisier than the places where the
target was seen allow, which a turn of the hand moves by its lever. What the eye saw enters no
derivative: its noise makes up nothing, however large.

All of this is the same whatever frames were chosen on base, hand, eye and target.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector, skew, tangent_of_vector
from suta_calib.pose_calibration.robot_noise import RobotNoise
from suta_calib.pose_calibration.robust_fit import ROUNDING, RobustFit
from suta_calib.solver.information import scaled_inverse, whitened_rows

# Part of the information about a direction that noise may have made: it biases an estimate by as
# much.
NOISE_MADE: Final = 0.1


def noise_made_directions(fit: RobustFit, noise: RobotNoise) -> list[FloatArray]:
    """Displacements and turns (6,) of X that noise may tell as well as the pairs do.

    The largest generalised eigenvalues of what noise makes up, F, against the information A, on X
    with Z free to follow; first of X's displacements alone.

    Args:
        fit: of pairs of poses; its unknowns are X and Z.
        noise: whose it is.
    """
    if len(fit.solution.identification.fixed):
        return []  # X is where it started: nothing can be said of its surroundings
    sigmas = np.maximum(fit.sigmas, ROUNDING)
    x, count = fit.solution.x, int(fit.inliers.sum())
    rows = whitened_rows(fit.solution.problem, x, sigmas.tolist())
    to_parameters = np.eye(12)
    for turn in (slice(3, 6), slice(9, 12)):
        to_parameters[turn, turn] = np.linalg.inv(tangent_of_vector(x[turn]))
    jacobian = np.vstack([r.jacobian for r in rows]) @ to_parameters
    information = jacobian.T @ jacobian
    follow = np.vstack([np.eye(6), -scaled_inverse(information[6:, 6:]) @ information[6:, :6]])
    of_eye = follow.T @ information @ follow
    place, turned = sigmas
    of_hand = noise.at_most * turned**2
    # What the point on the target moves by at which noise of places and of turns is independent.
    lever = -rotation_from_vector(x[9:12]) @ noise.lever.in_target
    target = np.hstack([np.eye(3), -skew(lever) @ rotation_from_vector(x[9:12])]) @ follow[6:]
    made = 2.0 * count * of_hand / place**2 * target.T @ target
    made[3:, 3:] += 2.0 * count * (1.0 + of_hand / turned**2) * np.eye(3)
    slides = _made(of_eye[:3, :3], made[:3, :3])
    every = _made(of_eye, made)
    return [
        *(np.concatenate([v / np.linalg.norm(v), np.zeros(3)]) for v in slides),
        *_turns(every, len(every) - len(slides)),
    ]


def _made(information: FloatArray, made: FloatArray) -> list[FloatArray]:
    """Directions of which noise made more than `NOISE_MADE`, most of all first."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, axes = np.linalg.eigh(information * np.outer(scale, scale))
    root = scale[:, None] * axes / np.sqrt(np.maximum(values, 1e-14 * values[-1]))
    share, directions = np.linalg.eigh(root.T @ made @ root)
    return [root @ directions[:, k] for k in range(len(share))[::-1] if share[k] > NOISE_MADE]


def _turns(directions: list[FloatArray], count: int) -> list[FloatArray]:
    """The turns (count, 6) that some directions have most of."""
    if count < 1:
        return []
    unit = np.array([v[3:] for v in directions]).T
    axes = np.linalg.svd(unit / max(float(np.linalg.norm(unit)), 1e-300))[0]
    return [np.concatenate([np.zeros(3), axes[:, k]]) for k in range(min(count, 3))]
