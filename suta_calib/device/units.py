"""Encoder values ↔ joint angles."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import IntArray
from suta_calib.device.description import DeviceSpec

if TYPE_CHECKING:
    from suta_calib.arrays import FloatArray


def turn(spec: DeviceSpec) -> float:
    """What the device sends for one whole turn: counts, 2π or 360."""
    return {"counts": float(spec.counts_per_turn), "rad": math.tau, "deg": 360.0}[spec.unit]


def turns(spec: DeviceSpec) -> FloatArray:
    """(n,) what the device sends more when a joint has made a whole turn."""
    of_encoder = [
        float(joint.counts_per_turn or spec.counts_per_turn)
        if spec.unit == "counts"
        else turn(spec)
        for joint in spec.joints
    ]
    return np.array(of_encoder) * [joint.ratio for joint in spec.joints]


def zeros(spec: DeviceSpec) -> FloatArray:
    """(n,) what the device sends where a joint's angle is 0."""
    return np.array([joint.zero for joint in spec.joints], dtype=float)


def signs(spec: DeviceSpec) -> IntArray:
    """(n,) the joints' signs."""
    return np.array([joint.sign for joint in spec.joints], dtype=np.int64)


def angles_from_counts(counts: IntArray, sign: IntArray, per_turn: int) -> FloatArray:
    """Joint angles in (-π, π], rad, to the last bit: the wrapping is done on whole numbers.

    Args:
        counts: (..., n) encoder positions.
        sign: (n,) +1 or -1.
        per_turn: counts of one turn.
    """
    # ceil(per_turn / 2) - 1 is the largest count above -π that is still wanted below zero.
    below = (per_turn + 1) // 2 - 1
    centred = (counts * sign + below) % per_turn - below
    return np.asarray(centred * (math.tau / per_turn), dtype=float)


def angles_from_values(
    values: FloatArray, sign: IntArray, per_turn: float | FloatArray
) -> FloatArray:
    """Joint angles in (-π, π], rad, of any numbers.

    Args:
        values: (..., n) as the device sends them, less what it sends at zero.
        sign: (n,) +1 or -1.
        per_turn: value of one turn, of all joints or of each, (n,).
    """
    fraction = values * sign / per_turn
    wrapped: FloatArray = (fraction - np.ceil(fraction - 0.5)) * math.tau
    return wrapped


def counts_from_angles(spec: DeviceSpec, angles: ArrayLike) -> IntArray:
    """The counts, from 0 to less than a turn, nearest to joint angles: what would be sent.

    Args:
        spec: gives signs, zeros and counts of a joint's turn.
        angles: (..., n) rad, in the order of ``spec.joints``; wrapped as needed.
    """
    scaled = np.asarray(angles, dtype=float) * signs(spec) * (turns(spec) / math.tau) + zeros(spec)
    of_turn = np.rint(np.abs(turns(spec))).astype(np.int64)
    counts: IntArray = np.rint(scaled).astype(np.int64) % of_turn
    return counts


def values_from_angles(spec: DeviceSpec, angles: ArrayLike) -> NDArray[np.number]:
    """The values of one line in the device's own unit: counts, rad or deg.

    Args:
        spec: gives unit, signs and counts per turn.
        angles: (..., n) rad, in the order of ``spec.joints``.
    """
    if spec.unit == "counts":
        return counts_from_angles(spec, angles)
    return np.asarray(angles, dtype=float) * signs(spec) * (turns(spec) / math.tau) + zeros(spec)


# A device that sends angles may say a whole turn, not more: then the unit is another one.
ONE_TURN: Final = 1.0 + 1e-6
