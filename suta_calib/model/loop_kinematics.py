"""The angles of a closed loop's passive joints, on CasADi symbols (`model.loop`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.symbols import Symbol

# Walks a branch from the link above the loop, with the passive joints at given angles, and gives
# by joint the axis and a point on it, (3,) each, and the point of the branch's end.
Reach = Callable[[int, Symbol], tuple[dict[str, tuple[Symbol, Symbol]], Symbol]]


@dataclass(frozen=True, eq=False)
class PlanarLoop:
    """Where the passive joints of a planar loop are, and on which side it is assembled.

    Attributes:
        passive: names of the two joints, in the order of their angles.
        branch: of the two branches, the one that each of them is in.
        sense: (2,) 1 where a joint's axis is along that of the loop, -1 where it is against it.
        axis: (3,) of the loop, in the frame of the link above it.
        side: 1 or -1: on which side of the line between the circles' centres they meet.
    """

    passive: tuple[str, str]
    branch: tuple[int, int]
    sense: tuple[float, float]
    axis: FloatArray
    side: float

    @property
    def plane(self) -> FloatArray:
        """(2, 3) two axes across that of the loop."""
        beside = np.eye(3)[int(np.argmin(np.abs(self.axis)))]
        first = np.cross(self.axis, beside)
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(self.axis, first)])

    def apart(self, reach: Reach) -> Symbol:
        """How far apart the ends stay at `started` angles, m: about zero where the loop closes."""
        angles = self.started(reach)
        return ca.norm_2(self._seen(reach(0, angles)[1] - reach(1, angles)[1]))

    def solved(
        self, reach: Reach, theta: Symbol, inputs: Sequence[Symbol]
    ) -> tuple[Symbol, Symbol]:
        """Angles (2) of the passive joints, rad, and their derivatives (2, n) by parameters.

        Args:
            reach: of the two branches.
            theta: (n,) parameters.
            inputs: what else the branches depend on.
        """
        angles = self.started(reach)
        phi = ca.SX.sym("phi", 2)
        ends = [reach(k, phi) for k in (0, 1)]
        axis, _ = ends[self.branch[0]][0][self.passive[0]]
        gap = _across(axis, self.plane[0]) @ (ends[0][1] - ends[1][1])
        function = ca.Function(
            "loop",
            [phi, theta, *inputs],
            [gap, ca.jacobian(gap, phi), ca.jacobian(gap, theta)],
        )
        # Steps of Newton's method: from the tilts of built axes (0.5°) the first one leaves 1e-9
        # rad.
        for _ in range(2):
            apart, slope, _ = function(angles, theta, *inputs)
            angles = angles - _inverse(slope) @ apart
        _, slope, by_theta = function(angles, theta, *inputs)
        return angles, -_inverse(slope) @ by_theta

    def started(self, reach: Reach) -> Symbol:
        """The angles (2) in closed form, as if all axes were parallel: where two circles meet."""
        zero = ca.SX(2, 1)
        ends = [reach(k, zero) for k in (0, 1)]
        first, second = (
            self._seen(ends[b][0][n][1]) for b, n in zip(self.branch, self.passive, strict=True)
        )
        if self.branch[0] != self.branch[1]:
            arms = [
                self._seen(ends[b][1]) - c
                for b, c in zip(self.branch, (first, second), strict=True)
            ]
            at = self._meeting(first, arms[0], second, arms[1])
            turned = _angle(arms[0], at - first), _angle(arms[1], at - second)
        else:
            target = self._seen(ends[1 - self.branch[0]][1])
            arms = [second - first, self._seen(ends[self.branch[0]][1]) - second]
            at = self._meeting(first, arms[0], target, arms[1])
            by_first = _angle(arms[0], at - first)
            spun = ca.vertcat(
                ca.cos(by_first) * arms[1][0] - ca.sin(by_first) * arms[1][1],
                ca.sin(by_first) * arms[1][0] + ca.cos(by_first) * arms[1][1],
            )
            turned = by_first, _angle(spun, target - at)
        return ca.vertcat(*(sense * angle for sense, angle in zip(self.sense, turned, strict=True)))

    def drawn_side(self, reach: Reach) -> float:
        """The side on which the circles meet as the loop is drawn, all joints at zero."""
        zero = ca.SX(2, 1)
        ends = [reach(k, zero) for k in (0, 1)]
        places = zip(self.branch, self.passive, strict=True)
        first, second = (self._seen(ends[branch][0][name][1]) for branch, name in places)
        same = self.branch[0] == self.branch[1]
        other = self._seen(ends[1 - self.branch[0]][1]) if same else second
        met = second if same else self._seen(ends[self.branch[0]][1])
        between, arm = other - first, met - first
        return float(np.sign(float(between[0] * arm[1] - between[1] * arm[0])))

    def _seen(self, point: Symbol) -> Symbol:
        return ca.DM(self.plane) @ point

    def _meeting(self, first: Symbol, arm: Symbol, second: Symbol, other: Symbol) -> Symbol:
        """Where circles about two centres, as large as arms are long, meet on the loop's side."""
        between = second - first
        squared_gap = ca.dot(between, between)
        along = (ca.dot(arm, arm) - ca.dot(other, other) + squared_gap) / (2 * squared_gap)
        # Circles that do not meet: the nearest that they come. Who reads the samples refuses these.
        height = ca.sqrt(ca.fmax(ca.dot(arm, arm) / squared_gap - along**2, 1e-12))
        return first + along * between + self.side * height * ca.vertcat(-between[1], between[0])


def _across(axis: Symbol, near: FloatArray) -> Symbol:
    """(2, 3) two axes across that of a built joint; the first is nearly along another one."""
    first = ca.DM(near) - ca.dot(ca.DM(near), axis) * axis
    first = first / ca.norm_2(first)
    return ca.vertcat(first.T, ca.cross(axis, first).T)


def _angle(a: Symbol, b: Symbol) -> Symbol:
    """From one direction in the plane to another, rad."""
    return ca.atan2(a[0] * b[1] - a[1] * b[0], ca.dot(a, b))


def _inverse(matrix: Symbol) -> Symbol:
    """Of a (2, 2) matrix."""
    (a, b), (c, d) = ((matrix[i, 0], matrix[i, 1]) for i in (0, 1))
    return ca.vertcat(ca.horzcat(d, -b), ca.horzcat(-c, a)) / (a * d - b * c)
