"""Decides whether a step leaves outliers out: the better prediction of left-out frames counts.

A robust fit pays where rows are wrong, and loses where they only scatter. Nobody knows beforehand,
and each step may differ: both fits are made, and each predicts every frame from the others.
"""

from __future__ import annotations

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry.numbers import register_points


def robust_predicts_better(plain: FloatArray, robust: FloatArray) -> bool:
    """Whether leaving rows out significantly improves the prediction of left-out frames.

    Errors (n,), m, of left-out frames if all rows are believed, and if those that do not fit are
    left out.
    """
    # Errors, m, that no instrument resolves: the files of the course have two decimals of a
    # millimetre.
    usual = max(min(float(np.median(plain)), float(np.median(robust))), 1e-6)
    # Errors count as so many times the usual one at most: a wrong frame is predicted by neither
    # fit.
    squares = (np.minimum(errors, 3.0 * usual) ** 2 for errors in (plain, robust))
    gain = np.subtract(*squares)
    if len(gain) < 2:
        return False
    # Standard errors by which a robust fit must predict better to be used.
    return bool(gain.mean() > 2.0 * gain.std(ddof=1) / np.sqrt(len(gain)))


def left_out_of_pivot(rotation: FloatArray, position: FloatArray, used: BoolArray) -> FloatArray:
    """Distance (n,) of each frame's tip from the post that the other frames used (n,) tell, m."""
    n = len(rotation)
    columns = np.concatenate([rotation, -np.broadcast_to(np.eye(3), (n, 3, 3))], axis=2)
    inverse = np.linalg.pinv(np.einsum("nij,nik->jk", columns[used], columns[used]))
    solved = -inverse @ np.einsum("nij,ni->j", columns[used], position[used])
    error = columns @ solved + position
    # Errors that a frame would have if it were not fitted: (I - H)⁻¹ e with the hat matrix H.
    fitted = columns @ inverse @ np.swapaxes(columns, 1, 2) * used[:, None, None]
    # Distance of a leverage from one at which the other rows do not predict a row.
    undetermined = 1e-9
    left = np.linalg.solve((1.0 + undetermined) * np.eye(3) - fitted, error[..., None])[..., 0]
    return np.asarray(np.linalg.norm(left, axis=1))


def left_out_of_registration(source: FloatArray, target: FloatArray, used: BoolArray) -> FloatArray:
    """Distance (n,) of each point from where the registration of the others used has it, m."""
    errors = []
    for row, (here, there) in enumerate(zip(source, target, strict=True)):
        used_others = used & (np.arange(len(used)) != row)
        R, p = register_points(source[used_others], target[used_others])
        errors.append(float(np.linalg.norm(R @ here + p - there)))
    return np.array(errors)
