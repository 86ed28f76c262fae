"""Errors of a hand that its poses share: smooth functions of the pose, and what all have in common.

An arm whose lengths, angles and encoders are off errs by smooth functions of its posture. Where the
joints are not known the pose takes their place: errors, in the base's axes, are a Gaussian process
over poses with the correlation of Matérn with ν = 3/2, which is smooth but of no particular wave
length (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 4.2). Its
first principal components are functions of the pose (Nyström's approximation, section 8.1); what
the others would add is noise of each pose.

The first joints turn and shift all poses about the base, and the last ones all in the hand. No
picture shows that: X and Z follow it. So it stands in their ±, as a part of what neighbours share.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length, skew
from suta_calib.pose_calibration.correlation import embedded
from suta_calib.pose_calibration.picture_likelihood import DIRECTIONS, WAYS

# Extent, m, of poses that are all at one place.
NOWHERE: Final = 1e-9


def shared_errors(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """What poses of a hand are off by, (n, 6, k) per unit of each coefficient, in the base's axes.

    Coefficients come in sixes, three displacements and three turns, each of which gives errors of
    about unit variance; none of few poses, or of poses of which something is not known.
    """
    # Part of the variance of what neighbours share that all poses have in common in the hand, and
    # as much about the base: that of two joints of six.
    common = 1.0 / 3.0
    n = len(position)
    # Poses from which on neighbours tell what they share: six figures each, for as many of X and Z.
    if n < 8 or not (np.isfinite(position).all() and np.isfinite(rotation).all()):
        return np.zeros((n, WAYS, 0))
    distance = max(rms_length(position), NOWHERE)
    smooth = _components(embedded(rotation, position / distance))
    of_pose = np.einsum("nk,cd->nckd", smooth, np.eye(WAYS)).reshape(n, WAYS, -1)
    turned = slice(DIRECTIONS, WAYS)
    in_hand, about_base = np.zeros((2, n, WAYS, WAYS))
    in_hand[:, :DIRECTIONS, :DIRECTIONS] = in_hand[:, turned, turned] = rotation
    about_base += np.eye(WAYS)
    about_base[:, :DIRECTIONS, turned] = -skew(position)
    return np.concatenate([of_pose, *np.sqrt(common) * np.stack([in_hand, about_base])], axis=2)


def _components(space: FloatArray) -> FloatArray:
    """(n, k) smooth functions of poses that are points (n, d) of a space in which 1 is far."""
    # More poses make no difference to the components.
    n = len(space)
    sampled = space[np.unique(np.linspace(0, n - 1, min(n, 150)).astype(np.intp))]
    values, vectors = np.linalg.eigh(_correlation(sampled, sampled))
    values, vectors = values[::-1], vectors[:, ::-1]
    # Most components, and the part of the variance that they should have at least.
    k = min(int(np.searchsorted(np.cumsum(values), 0.99 * values.sum())) + 1, 10)
    return np.asarray(_correlation(space, sampled) @ vectors[:, :k] / np.sqrt(values[:k]))


def _correlation(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) between the errors of two sets of poses."""
    # How far apart poses are that share about half of their errors, where 1 is a turn by a radian
    # or a way as long as from the base to the hand. Simulated arms with wrong lengths and angles
    # (0.5 mm, 0.13°) or eccentric joints have X nearest to the truth with 2; with 1 its ± is too
    # small, as what all poses have in common is taken for little, and with 4 it is too large.
    reach = 2.0
    far = np.sqrt(3.0) * np.linalg.norm(a[:, None] - b[None], axis=2) / reach
    return np.asarray((1.0 + far) * np.exp(-far))
