"""What kinematics does with every segment, as functions of CasADi that are composed once.

An operation on symbols takes some 20 µs from Python, however small it is, and so does a whole
function of them. CasADi leaves out what is zero.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca

from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.geometry.travel import TURNS


@cache
def turn_by_vector() -> Symbol:
    """CasADi function (rotation vector (3)) → rotation (3, 3), axes (3, 3) of its components.

    A column is the angular velocity for unit change of a component, in the frame before the turn,
    in which the turn's two sides are alike.
    """
    vector = ca.SX.sym("r", 3)
    turn = symbolic_rotation(vector)
    derivative = ca.jacobian(ca.vec(turn), vector)
    spins = [ca.reshape(derivative[:, k], 3, 3) @ turn.T for k in range(3)]
    axes = [ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0]) for spin in spins]
    return ca.Function("turned", [vector], [turn, ca.horzcat(*axes)])


@cache
def turn_about_axis() -> Symbol:
    """CasADi function (rotation (3, 3), axis (3), angle) → rotation (3, 3), its axis (3).

    By Rodrigues' formula; the axis, where the rotation has brought it, is the same behind the turn.
    """
    rotation, axis, angle = ca.SX.sym("R", 3, 3), ca.SX.sym("a", 3), ca.SX.sym("t")
    outer = axis @ axis.T
    spin = ca.cos(angle) * (ca.SX.eye(3) - outer) + ca.sin(angle) * ca.skew(axis) + outer
    return ca.Function("spun", [rotation, axis, angle], [rotation @ spin, rotation @ axis])


@cache
def lean_of_link() -> Symbol:
    """CasADi function (R S a (3), up (3), lean of it (3)) → T (3, 3) of `model.tilt`.

    And its turn per change of what was felt, and of the lean, (3, 3). Where nothing was felt, T
    does nothing.
    """
    shown, up, lean = (ca.SX.sym(name, 3) for name in ("w", "u", "lean"))
    leaning = symbolic_rotation(lean) @ up
    spin = ca.skew(ca.cross(shown, leaning))
    least = ca.SX.eye(3) + spin + spin @ spin / (1 + ca.dot(shown, leaning))

    def turns(inputs: Symbol) -> Symbol:
        derivative = ca.jacobian(ca.vec(least), inputs)
        spins = [ca.reshape(derivative[:, k], 3, 3) @ least.T for k in range(inputs.numel())]
        return ca.horzcat(*(ca.vertcat(s[2, 1], s[0, 2], s[1, 0]) for s in spins))

    return ca.Function("leaned", [shown, up, lean], [least, turns(shown), turns(lean)])


@cache
def lag_by_play() -> Symbol:
    """CasADi function (travel (TURNS), width) → what a joint with play lags by, and its slope.

    As much of the width, the other way, where that is below zero. Where the gap is crossed the lag
    bends over a tenth of the width: steps that meet a corner in every other row would not settle.
    """
    travel, width, bend = ca.SX.sym("s", TURNS), ca.SX.sym("w"), 0.1
    share = ca.DM([0.5] + [1.0] * (TURNS - 1))
    way, limit, side = ca.fabs(travel), share * ca.fabs(width), ca.sign(travel)
    beyond = way - limit
    # A square root has a slope where it is zero, too.
    rounded = ca.sqrt(beyond**2 + (bend * limit) ** 2 + 1e-24)
    # What it takes to have no lag on no way.
    more = 0.5 * (math.hypot(1.0, bend) - 1.0)
    crossed = (0.5 * (way + limit - rounded) + more * limit) / (1.0 + more)
    lag = ca.if_else(width < 0, 1.0, -1.0) * ca.sum1(side * crossed)
    by_limit = (0.5 * (1.0 - (bend**2 * limit - beyond) / rounded) + more) / (1.0 + more)
    return ca.Function("play", [travel, width], [lag, -ca.sum1(side * share * by_limit)])


@cache
def lag_by_friction() -> Symbol:
    """CasADi function (travel (TURNS), decay) → lag per unit of hysteresis, and by the decay."""
    travel, decay = ca.SX.sym("s", TURNS), ca.SX.sym("d")
    share = ca.DM([0.5] + [1.0] * (TURNS - 1))
    ways = ca.fabs(travel) / share / decay
    fading, sides = ca.exp(-ways), -ca.sign(travel) * share
    by_decay = ca.sum1(sides * -ways * fading) / decay
    return ca.Function("friction", [travel, decay], [ca.sum1(sides * (1 - fading)), by_decay])


@cache
def velocity_of_turn() -> Symbol:
    """CasADi function (axis (3), lever (3)) → linear and angular velocity (6) of a turn."""
    axis, lever = ca.SX.sym("a", 3), ca.SX.sym("p", 3)
    return ca.Function("twist", [axis, lever], [ca.vertcat(ca.cross(axis, lever), axis)])
