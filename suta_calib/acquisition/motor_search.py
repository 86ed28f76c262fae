"""Orders of motors that are fitted to touches: least squares of thousands of hypotheses at once.

A motor's reading ``r`` and the angle of its joint are ``angle = sign · r + offset``. For each order
of the motors and each combination of signs least squares give the offsets, the place of the tip in
the hand, and the pose of each placement of the sheet. Residuals are ``T_base_tip p - T_base_sheet
m`` for the tip's place p and a cross m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, permutations, product
from typing import Final, NamedTuple

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.batched import Batched
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import homogeneous, rotation_from_rpy, skew, wrap
from suta_calib.model.arm import ArmModel
from suta_calib.terms import Term
from suta_calib.terms.block import grouped
from suta_calib.terms.given_pose import GivenPose
from suta_calib.units import from_deg

# How far the tip of an uncalibrated arm with play is from a cross, m: less is never assumed.
_ASSUMED: Final = 5e-3
# What is known of an offset where there are no limits, rad: as good as nothing.
OFFSET_STD: Final = 1.0
# Hypotheses that are fitted at once: enough for NumPy, and few enough for the memory.
_AT_ONCE: Final = 2048


@dataclass(frozen=True)
class MotorMapOptions:
    """How motors are mapped to joints.

    Attributes:
        signs: by joint, signs that are known.
        tip_std: how well the place of the tip in the hand is known, m per axis.
        tolerance: how far the tip may stay from the crosses (RMS), m.
        starts: offsets from which each hypothesis is fitted; four more for an arm without limits.
        seed: of those.
    """

    signs: Mapping[str, int] = field(default_factory=dict)
    tip_std: float = 3e-3
    tolerance: float = 0.015
    starts: int = 2
    seed: int = 0


@dataclass(frozen=True, eq=False)
class MotorOrder:
    """One way to connect motors and joints that was fitted.

    Attributes:
        motors: (n,) for each joint of the arm, the place of its motor among them.
        signs: (n,) 1 or -1.
        offsets: (n,) rad, added to the signed reading.
        tip: (3,) where the tip is beside its nominal place, in its own frame, m.
        rms: distance of the tip from the crosses, m; inf where joints are beyond their limits, or
            the sheet would be touched from below.
        cost: sum of squares in units of the noise, with what is known beforehand.
    """

    motors: IntArray
    signs: IntArray
    offsets: FloatArray
    tip: FloatArray
    rms: float
    cost: float

    def read(self, readings: FloatArray) -> FloatArray:
        """Angles (k, n) of readings (k, n), rad."""
        return self.signs * readings[:, self.motors] + self.offsets


@dataclass(frozen=True, eq=False)
class CrossTouches:
    """CrossTouches of all terms.

    Attributes:
        readings: (k, n) rad.
        marks: (k, 3) places of the touched crosses on their sheet, m.
        place: (k,) number of the placement.
        given: by number of a placement, its pose in the base where it is known: rotation,
            position, and standard deviations (6,) of position and turn.
        flat: whether all crosses are in one plane, z = 0.
    """

    readings: FloatArray
    marks: FloatArray
    place: IntArray
    given: Mapping[int, tuple[FloatArray, FloatArray, FloatArray]]
    flat: bool

    @classmethod
    def of(cls, arm: ArmModel, terms: Sequence[Term]) -> CrossTouches:
        """Those of the terms that touch an artefact.

        Raises:
            InputError: there are none, or too few.
        """
        readings, marks, labels = [], [], list[str]()
        given = dict[str, GivenPose]()
        for term in terms:
            if term.touched is None:
                continue
            samples = term.poses.samples
            readings.append(samples.q)
            marks.append(term.touched.position_of(samples.labels["landmark"].tolist()))
            labels += samples.labels["placement"].tolist()
            given |= term.given
        if not labels:
            expected = "an observation that touches the crosses of a sheet (kind landmark)"
            raise InputError("no touches", expected)
        names, place = grouped(np.array(labels))
        counts = np.bincount(place)
        fewest = 4
        if counts.min() < fewest or len(place) < len(arm.joints) + fewest * len(names):
            expected = (
                f"at least {fewest} at each placement, and {len(arm.joints) + fewest * len(names)} "
                "together"
            )
            there = ", ".join(f"{n} at {name}" for name, n in zip(names, counts, strict=True))
            raise InputError(f"touches: {there}", expected, hint="touch more crosses")
        stated = {
            k: (pose.rotation, pose.position, _stds(pose))
            for k, name in enumerate(names)
            if (pose := given.get(name, given.get("") if len(names) == 1 else None)) is not None
            and pose.rotation is not None
        }
        at = np.concatenate(marks)
        return cls(np.concatenate(readings), at, place, stated, bool(np.ptp(at[:, 2]) < 1e-3))


class _FittedOrders(NamedTuple):
    """Hypotheses that were fitted: offsets (h, n), tip (h, 3), cost (h,), rms (h,) and ``above``.

    ``above`` (h,) is how far the hand is above the printed side of the sheet, m.
    """

    offsets: FloatArray
    tip: FloatArray
    cost: FloatArray
    rms: FloatArray
    above: FloatArray


class OrderSearch:
    """Least squares of many hypotheses at once, by Levenberg and Marquardt."""

    def __init__(self, arm: ArmModel, touches: CrossTouches, options: MotorMapOptions) -> None:
        self.arm, self.touches, self.options = arm, touches, options
        self._function = arm.function([f"{joint}.offset" for joint in arm.joints])
        self._places = int(touches.place.max()) + 1
        self._hand = _last_axis_in_tip(arm)
        # How far beyond the limits of the URDF a joint may seem to stand: printed stops are not
        # exact.
        beyond_limits = from_deg(15.0)
        self._lower = np.array([joint.lower for joint in arm.readings]) - beyond_limits
        self._upper = np.array([joint.upper for joint in arm.readings]) + beyond_limits
        free = 6 * (self._places - len(touches.given))
        self.redundancy = max(touches.readings.size // len(arm.joints) * 3 - free - 2, 1)

    def orders(self, factor: float) -> list[MotorOrder]:
        """Plausible orders, the best first, of readings times a factor; else one with rms inf."""
        readings = factor * self.touches.readings
        motors, signs = self._hypotheses()
        lower, upper = self._allowed(readings, motors, signs)
        possible = (lower < upper).all(axis=1)
        motors, signs = motors[possible], signs[possible]
        lower, upper = lower[possible], upper[possible]
        if not len(motors):
            return []
        random = np.random.default_rng(self.options.seed)
        low, high = np.maximum(lower, -np.pi), np.minimum(upper, np.pi)
        starts = [np.clip(0.0, lower, upper)]
        # Without limits zeros may be anywhere: the mirror image of the arm must be found too.
        limited = np.isfinite(self._lower).all() and np.isfinite(self._upper).all()
        further = self.options.starts - 1 if limited else self.options.starts + 3
        starts += [random.uniform(low, high) for _ in range(further)]
        which, offsets = np.tile(np.arange(len(motors)), len(starts)), np.concatenate(starts)
        # Some rows tell the likely hypotheses from the others, and few steps do.
        few = np.unique(np.linspace(0, len(readings) - 1, 12).astype(np.intp))
        for rows, steps, most in ((few, 4, 400), (few, 8, 60), (slice(None), 40, 60)):
            fit = self._fitted(readings, motors[which], signs[which], offsets, steps, rows)
            best = np.argsort(fit.cost, kind="stable")[:most]
            which, offsets = which[best], fit.offsets[best]
            fit = _FittedOrders(*(array[best] for array in fit))
        inside = (fit.offsets > lower[which]) & (fit.offsets < upper[which])
        plausible = inside.all(axis=1) & ((fit.above > 0.0) | (not self.touches.flat))
        orders = dict[bytes, MotorOrder]()
        for k in np.argsort(np.where(plausible, fit.cost, np.inf), kind="stable"):
            order = MotorOrder(
                *(motors[which[k]], signs[which[k]].astype(np.intp), wrap(fit.offsets[k])),
                *(fit.tip[k], float(fit.rms[k]) if plausible[k] else math.inf),
                float(fit.cost[k]),
            )
            if plausible[k] or not orders:
                orders.setdefault(order.motors.tobytes() + order.signs.tobytes(), order)
        return [*orders.values()]

    def _hypotheses(self) -> tuple[IntArray, FloatArray]:
        """Motors (h, n) and signs (h, n): all orders, or of many joints all exchanged pairs."""
        n = len(self.arm.joints)
        orders = [*permutations(range(n))]
        # Of more joints only pairs are exchanged: 7! orders with 2^7 signs would be 645,120
        # hypotheses.
        if n > 5:
            orders = [tuple(range(n))]
            for a, b in combinations(range(n), 2):
                swapped = {a: b, b: a}
                orders.append(tuple(swapped.get(k, k) for k in range(n)))
        given = [self.options.signs.get(joint) for joint in self.arm.joints]
        signs = [*product(*((1, -1) if sign is None else (sign,) for sign in given))]
        pairs = [*product(orders, signs)]
        return (
            np.array([order for order, _ in pairs], dtype=np.intp),
            np.array([sign for _, sign in pairs], dtype=float),
        )

    def _allowed(
        self, readings: FloatArray, motors: IntArray, signs: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Offsets (h, n) with which every joint stays within its limits, least and most."""
        lowest, highest = readings.min(axis=0)[motors], readings.max(axis=0)[motors]
        forwards = signs > 0
        return (
            self._lower - np.where(forwards, lowest, -highest),
            self._upper - np.where(forwards, highest, -lowest),
        )

    def _fitted(
        self,
        readings: FloatArray,
        motors: IntArray,
        signs: FloatArray,
        start: FloatArray,
        steps: int,
        rows: IntArray | slice,
    ) -> _FittedOrders:
        parts = []
        for first in range(0, len(motors), _AT_ONCE):
            k = slice(first, first + _AT_ONCE)
            signed = signs[k][:, None, :] * readings[rows][:, motors[k]].transpose(1, 0, 2)
            parts.append(_descended(_TouchEquations(self, signed, rows), start[k], steps))
        return _FittedOrders(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

    def uncertainty(
        self, order: MotorOrder, factor: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Stds (n,) of the offsets, gains (n,) of the readings beside 1, and their stds (n,)."""
        n = len(order.offsets)
        signed = order.signs * (factor * self.touches.readings)[:, order.motors]
        system = _TouchEquations(self, signed[None], slice(None))
        unknowns = np.concatenate([order.offsets, order.tip])[None]
        _, slopes, residual, _ = system.at(unknowns)
        slope, left = slopes[0], residual[0]
        noise = max(float(left @ left) / self.redundancy, 0.04)
        precision = np.diag(system.known)
        information = slope.T @ slope / noise
        covariance = np.linalg.inv(information + precision)
        for place, (rotation, _, stds) in self.touches.given.items():
            # A pose that is known to a few millimetres is taken as exact: what that does.
            rows = np.flatnonzero(self.touches.place == place)
            turning = skew(self.touches.marks[rows] @ rotation.T)
            moved = np.concatenate([np.tile(-np.eye(3), (len(rows), 1, 1)), turning], axis=2)
            of_rows = slope.reshape(-1, 3, slope.shape[1])[rows]
            shift = covariance @ np.einsum("kiu,kij->uj", of_rows, moved) / noise / _ASSUMED
            covariance = covariance + (shift * stds**2) @ shift.T
        of_reading = slope[:, :n] * np.repeat(signed, 3, axis=0)
        # A gain is looked at beside everything else, a reading known to a tenth of itself.
        wide = np.hstack([slope, of_reading])
        prior = np.diag(np.concatenate([system.known, np.full(n, 100.0)]))
        spread = np.linalg.inv(wide.T @ wide / noise + prior)
        gains = -spread @ (wide.T @ left / noise)
        of_gain = np.sqrt(np.diag(spread)[-n:])

        return np.sqrt(np.diag(covariance)[:n]), gains[-n:], of_gain


class _TouchEquations:
    """Residuals of hypotheses (h) over touches, and their derivatives by offsets and tip.

    The poses of the placements are eliminated: each is registered (Kabsch), and its directions are
    projected out of the derivatives (variable projection).
    """

    def __init__(self, search: OrderSearch, signed: FloatArray, rows: IntArray | slice) -> None:
        touches, self._signed = search.touches, signed
        self._hand, self._given = search._hand, touches.given
        self._marks, self._place = touches.marks[rows], touches.place[rows]
        h, k, n = signed.shape
        self._batch = Batched(search._function, h * k, shared=[0])
        tip = max(search.options.tip_std, 1e-6)
        self.known = np.concatenate([np.full(n, OFFSET_STD**-2), np.full(3, tip**-2)])

    def at(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Cost (h,), derivatives (h, 3k, n + 3), residual (h, 3k), and height of the hand (h,)."""
        h, k, n = self._signed.shape
        self._batch.inputs[1][:] = (self._signed + unknowns[:, None, :n]).reshape(-1, n)
        flat, at, columns = self._batch()
        rotation = np.swapaxes(flat.reshape(h, k, 3, 3), 2, 3)
        tip = unknowns[:, n:]
        position = at.reshape(h, k, 3) + np.einsum("hkij,hj->hki", rotation, tip)
        hand = at.reshape(h, k, 3) + rotation @ self._hand
        slopes = np.zeros((h, k, 3, n + 3))
        turning = columns.reshape(h, k, 6, n)
        arm = np.einsum("hkij,hj->hki", rotation, tip)
        swing = np.einsum("hkjn,hkij->hkin", turning[:, :, 3:], -skew(arm))
        slopes[..., :n], slopes[..., n:] = turning[:, :, :3] + swing, rotation
        residual = np.zeros((h, k, 3))
        above = np.zeros(h)
        for place in np.unique(self._place):
            rows = np.flatnonzero(self._place == place)
            turned, there = self._placed(int(place), position[:, rows], self._marks[rows])
            marks = np.einsum("hij,kj->hki", turned, self._marks[rows])
            residual[:, rows] = position[:, rows] - marks - there[:, None]
            over = hand[:, rows] - position[:, rows]
            above += np.einsum("hki,hi->h", over, turned[:, :, 2]) / k
            if int(place) not in self._given:
                # Of where the tip is, not of the marks: else noise would seem to show the turn of
                # the whole arm about its first axis.
                self._project(slopes, rows, position[:, rows])
        whitened = residual.reshape(h, -1) / _ASSUMED
        cost = (whitened**2).sum(axis=1) + (unknowns**2 * self.known).sum(axis=1)
        return cost, slopes.reshape(h, 3 * k, n + 3) / _ASSUMED, whitened, above

    def step(
        self, unknowns: FloatArray, slopes: FloatArray, residual: FloatArray, damping: FloatArray
    ) -> FloatArray:
        """Step (h, n + 3) of Levenberg and Marquardt."""
        gradient = np.einsum("hmu,hm->hu", slopes, residual) + unknowns * self.known
        curvature = np.swapaxes(slopes, 1, 2) @ slopes
        diagonal = np.arange(len(self.known))
        grown = curvature[:, diagonal, diagonal] * (1 + damping[:, None]) + self.known
        curvature[:, diagonal, diagonal] = grown
        return np.asarray(-np.linalg.solve(curvature, gradient[..., None])[..., 0])

    def _placed(
        self, place: int, position: FloatArray, marks: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Rotation (h, 3, 3) and position (h, 3) of a placement: as given, or registered."""
        if place in self._given:
            rotation, at, _ = self._given[place]
            return np.broadcast_to(rotation, (len(position), 3, 3)), np.tile(at, (len(position), 1))
        middle, centre = position.mean(axis=1), marks.mean(axis=0)
        product = np.einsum("hki,kj->hij", position - middle[:, None], marks - centre)
        left, _, right = np.linalg.svd(product)
        handed = np.ones((len(position), 3))
        handed[:, 2] = np.sign(np.linalg.det(left @ right))
        rotation = left @ (handed[:, :, None] * right)
        return rotation, middle - rotation @ centre

    @staticmethod
    def _project(slopes: FloatArray, rows: IntArray, position: FloatArray) -> None:
        """Take out of derivatives what a motion of the placement would do, in place."""
        part = slopes[:, rows]
        part = part - part.mean(axis=1, keepdims=True)
        turning = skew(position - position.mean(axis=1, keepdims=True)).reshape(len(part), -1, 3)
        flat = part.reshape(len(part), -1, part.shape[-1])
        size = np.swapaxes(turning, 1, 2) @ turning
        # Crosses in a line leave the turn about it open; a hundredth of a micrometre closes it.
        size[:, [0, 1, 2], [0, 1, 2]] += 1e-16
        share = np.linalg.solve(size, np.swapaxes(turning, 1, 2) @ flat)
        slopes[:, rows] = (flat - turning @ share).reshape(part.shape)


def _stds(pose: GivenPose) -> FloatArray:
    """Standard deviations (6,) of a known pose: of its position, m, and of a turn, rad."""
    position = 0.0 if pose.position_std is None else pose.position_std
    return np.concatenate([np.zeros(3) + position, np.full(3, pose.rotation_std or 0.0)])


def _last_axis_in_tip(arm: ArmModel) -> FloatArray:
    """A point (3,) of the last joint's axis in the frame of the tip, m: of the hand."""
    pose = np.eye(4)
    for joint in reversed(arm.chain.joints):
        if joint.moving:
            break
        pose = homogeneous(rotation_from_rpy(joint.rpy), joint.xyz) @ pose
    return np.asarray(-pose[:3, :3].T @ pose[:3, 3])


def _descended(system: _TouchEquations, start: FloatArray, steps: int) -> _FittedOrders:
    """Hypotheses after so many steps from offsets (h, n), each with a damping of its own."""
    n = start.shape[1]
    unknowns = np.hstack([start, np.zeros((len(start), 3))])
    damping = np.full(len(start), 1e-3)
    cost, slopes, residual, _ = system.at(unknowns)
    for _ in range(steps):
        step = system.step(unknowns, slopes, residual, damping)
        tried = unknowns + step
        new_cost, new_slopes, new_residual, _ = system.at(tried)
        better = new_cost <= cost
        damping = np.where(better, 0.3 * damping, 10.0 * damping)
        unknowns = np.where(better[:, None], tried, unknowns)
        cost = np.where(better, new_cost, cost)
        slopes = np.where(better[:, None, None], new_slopes, slopes)
        residual = np.where(better[:, None], new_residual, residual)
    cost, _, residual, above = system.at(unknowns)
    rms = _ASSUMED * np.sqrt(3.0 * (residual**2).mean(axis=1))
    return _FittedOrders(unknowns[:, :n], unknowns[:, n:], cost, rms, above)
