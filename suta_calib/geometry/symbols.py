"""Rotations in CasADi symbols; conventions as in `suta_calib.geometry`."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca

# CasADi ships without type information: SX, MX and DM are one thing to the type checker.
Symbol = Any


def symbolic_skew(v: Symbol) -> Symbol:
    """Cross-product matrix of a CasADi 3-vector."""
    return ca.skew(v)


def symbolic_rotation(vector: Symbol) -> Symbol:
    """Rotation matrix of a CasADi rotation vector (rad), differentiable to any order at zero.

    Rodrigues' formula with the series of sin(t)/t near zero: the square root of the squared
    angle has no derivative there, so both branches are kept away from it.
    """
    return _rotation()(vector)


@cache
def _rotation() -> Any:
    """The formula, written down once: every residual that turns something has it several times."""
    vector = ca.SX.sym("v", 3)
    squared = ca.dot(vector, vector)
    half_sinc = _symbolic_sinc(squared / 4)
    k = ca.skew(vector)
    matrix = ca.DM.eye(3) + _symbolic_sinc(squared) * k + half_sinc**2 / 2 * (k @ k)
    return ca.Function("rotation", [vector], [matrix])


def _symbolic_sinc(squared: Symbol) -> Symbol:
    """sin(t)/t as a function of t²."""
    # Below this squared angle (rad²) the Taylor series of sin(t)/t is exact to rounding.
    small_angle_squared = 1e-4
    series = 1 - squared / 6 * (1 - squared / 20 * (1 - squared / 42))
    angle = ca.sqrt(ca.fmax(squared, small_angle_squared))
    return ca.if_else(squared < small_angle_squared, series, ca.sin(angle) / angle)


def symbolic_chordal_log(rotation: Symbol) -> Symbol:
    """Rotation vector error ``vee(R - Rᵀ)/2 · c`` of a CasADi rotation near identity.

    Uses the quaternion-like scaling 2/√(1+trace), so that the length is 2·sin(angle/2): equal to
    the angle to third order, and monotone and smooth up to 180°, where the logarithm is not.
    """
    turn = rotation - rotation.T
    vee = ca.vertcat(turn[2, 1], turn[0, 2], turn[1, 0])
    return vee / ca.sqrt(ca.fmax(1 + ca.trace(rotation), 1e-9))
