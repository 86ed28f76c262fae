"""Encoder values ↔ joint angles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.device.description import DeviceSpec


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
    """Joint angles (..., n) in (-π, π], rad, of any numbers less those at zero; as from counts."""
    fraction = values * sign / per_turn
    wrapped: FloatArray = (fraction - np.ceil(fraction - 0.5)) * math.tau
    return wrapped


def counts_from_angles(spec: DeviceSpec, angles: ArrayLike) -> IntArray:
    """The counts, from 0 to less than a turn, nearest to joint angles (..., n), rad."""
    of_turn = np.rint(np.abs(spec.turns)).astype(np.int64)
    counts: IntArray = np.rint(_scaled(spec, angles)).astype(np.int64) % of_turn
    return counts


def values_from_angles(spec: DeviceSpec, angles: ArrayLike) -> NDArray[np.number]:
    """What a device sends for joint angles (..., n), rad: counts, rad or deg."""
    return counts_from_angles(spec, angles) if spec.unit == "counts" else _scaled(spec, angles)


def _scaled(spec: DeviceSpec, angles: ArrayLike) -> FloatArray:
    return np.asarray(angles, dtype=float) * spec.signs * (spec.turns / math.tau) + spec.zeros
