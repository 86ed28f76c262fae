"""Readings that bring the tip to given poses, for any arm and any true geometry.

Levenberg–Marquardt on many targets at once: residual and step are those of Nakamura, Hanafusa
(1986), doi:10.1115/1.3143764, with the columns of the joints' offsets as manipulator Jacobian.
Targets that one start does not reach are tried again from the next, ever farther from the first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.batched import Batched
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import vector_from_rotation, vector_turning_z_to
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.noise import full_circle, wrapped

# What of a target's orientation counts: all of it, the direction of the tip's z axis, or nothing.
Matching = Literal["pose", "axis", "position"]
_ROTATION_WEIGHTS: Final[dict[Matching, FloatArray]] = {
    "pose": np.array([1.0, 1.0, 1.0]),
    "axis": np.array([1.0, 1.0, 0.0]),
    "position": np.zeros(3),
}
# Weighs angles against lengths (m): the size of a tool.
_LENGTH: Final = 0.25
_TOLERANCE: Final = 1e-12
# Targets times starts that are searched at once: so few take hardly longer than one.
_AT_ONCE: Final = 16


@dataclass(frozen=True, eq=False)
class Targets(Displayable):
    """Target poses or positions of the tip.

    Attributes:
        position: (n, 3) in the base frame, m.
        rotation: (n, 3, 3); for ``axis`` only its third column counts.
        matching: what of the orientation counts.
    """

    position: FloatArray
    rotation: FloatArray
    matching: Matching = "pose"

    def __len__(self) -> int:
        return len(self.position)

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Targets:
        """Some of the targets."""
        return Targets(self.position[rows], self.rotation[rows], self.matching)


@dataclass(frozen=True, eq=False)
class Postures(Displayable):
    """Postures that were found, whether or not they reach the targets.

    Attributes:
        q: (n, joints) readings, rad (m for prismatic joints), the closest found.
        reached: (n,) whether they bring the tip to the target to rounding.
        failed: (n,) whether all starts have failed; neither, where not all were tried.
        distance: (n,) how far from the target's position the tip stays, m.
        angle: (n,) how far from what counts of its orientation, rad.
    """

    q: FloatArray
    reached: NDArray[np.bool_]
    failed: NDArray[np.bool_]
    distance: FloatArray
    angle: FloatArray


class InverseKinematics:
    """Inverse kinematics of one arm with given parameter values.

    Args:
        arm: the arm; its joint limits are kept, save those a full circle apart.
        values: parameter values by name, m or rad; nominal where not given.

    Attributes:
        arm, values: as given.
        true: the same arm at these values.
    """

    def __init__(self, arm: ArmModel, values: Mapping[str, float]) -> None:
        self.arm, self.true, self.values = arm, arm.at(values), dict(values)
        offsets = arm.offsets
        geometry = [n for n in values if n in arm.offered and n not in offsets]
        self._function = arm.function([*offsets, *geometry], rows=len(offsets))
        nominal = {n: arm.parameters[n].nominal for n in offsets}
        self._theta = np.array([(nominal | dict(values))[n] for n in (*offsets, *geometry)])
        unlimited = full_circle(self.true)
        limits = np.array([(joint.lower, joint.upper) for joint in arm.readings]).T
        lower, upper = np.where(unlimited, [[-np.inf], [np.inf]], limits)
        # Joints of other chains of a robot stay at zero.
        of_chain = np.isin(arm.joints, arm.own_joints)
        self._lower, self._upper = np.where(of_chain, [lower, upper], 0.0)

    @property
    def middle(self) -> FloatArray:
        """(joints,) readings in the middle of every joint's range."""
        lower, upper = self._range()
        return np.asarray((lower + upper) / 2, dtype=float)

    @cached_property
    def attainable(self) -> Mapping[Matching, bool]:
        """Which targets this arm can reach in general: not those that ask more than it can do.

        Six joints or more reach poses, five a position and the direction of an axis, three or four
        a position; if their axes are not arranged so that they do less.
        """
        # Postures at which an arm is asked in how many ways it can move, and the smallest singular
        # value of its Jacobian, over the largest, that is a way.
        asked = 8
        a_way = 1e-6
        q = self.random_readings(np.random.default_rng(0), asked)
        batch = Batched(self._function, asked, shared=[0])
        batch.inputs[0][:] = self._theta
        reachable: dict[Matching, bool] = {}
        for matching, weights in _ROTATION_WEIGHTS.items():
            here = Targets(np.zeros((asked, 3)), np.tile(np.eye(3), (asked, 1, 1)), matching)
            _, jacobian = _residuals(batch, here, q, self.true.gearing)
            rows = jacobian[:, np.append([True] * 3, weights > 0)]
            values = np.linalg.svd(rows, compute_uv=False)
            ways = np.sum(values > a_way * values[:, :1], axis=1).max()
            reachable[matching] = bool(ways == rows.shape[1])
        return reachable

    def most(self, matching: Matching) -> Matching:
        """The part of a target that the arm can match: at least the position."""
        order = list(_ROTATION_WEIGHTS)
        for weaker in order[order.index(matching) :]:
            if self.attainable[weaker]:
                return weaker
        return "position"

    def random_readings(self, rng: np.random.Generator, n: int) -> FloatArray:
        """(n, joints) readings, uniform over every joint's range."""
        lower, upper = self._range()
        return rng.uniform(lower, upper, (n, len(lower)))

    def solve(
        self,
        targets: Targets,
        start: FloatArray,
        rng: np.random.Generator,
        starts: int = 40,
        together: IntArray | None = None,
    ) -> Postures:
        """Readings that bring the tip to each target.

        Args:
            targets: n of them.
            start: (joints,) or (n, joints) readings to search from first.
            rng: of the starts that follow.
            starts: how many are tried in all.
            together: (n,) groups of targets that count only together: where all starts have failed
                for one of a group, the others are not tried again. Each is by itself by default.

        Returns:
            For each target the first posture found that reaches it, or the closest one.
        """
        first = np.broadcast_to(start, (len(targets), len(self.arm.joints)))
        q = np.clip(first, self._lower, self._upper)
        error = np.full((len(targets), 6), np.inf)

        # The generator's state before each attempt was drawn, and the attempt that came last.
        state, last = dict[int, Any](), 0

        # By this start the whole range of every joint is searched.
        widest_start = 6

        @cache
        def begin(attempt: int) -> FloatArray:
            state[attempt] = rng.bit_generator.state
            share = min(1.0, attempt / widest_start)
            return first + share * (self.random_readings(rng, len(first)) - first)

        def search(attempts: range, rows: NDArray[np.intp]) -> NDArray[np.intp]:
            """From further starts, all at once; which of the rows are left."""
            nonlocal last
            if not len(rows) or not attempts:
                return rows
            begins = np.concatenate([begin(k)[rows] if k else q[rows] for k in attempts])
            tiled = np.tile(rows, len(attempts))
            answers = self._descend(targets.take(tiled), begins)
            parts = (np.split(ends, len(attempts)) for ends in answers)
            for attempt, end, left in zip(attempts, *parts, strict=True):
                last = attempt
                before = np.linalg.norm(error[rows], axis=1)
                better = (np.linalg.norm(left, axis=1) < before) & (before > _TOLERANCE)
                q[rows[better]], error[rows[better]] = end[better], left[better]
                away = np.linalg.norm(error[rows], axis=1) > _TOLERANCE
                if not away.any():
                    break
            return np.asarray(rows[away], dtype=np.intp)

        left, given_up = search(range(1), np.arange(len(targets))), np.zeros(len(q), dtype=bool)
        # Rounding may keep the last step from the tolerance; nobody notices a nanometre.
        arrived = 1e3 * _TOLERANCE
        if together is not None:
            # The farthest of each group first: where it fails, the others need not be asked.
            order = left[np.argsort(-np.linalg.norm(error[left], axis=1), kind="stable")]
            asked = np.sort(order[np.unique(together[order], return_index=True)[1]])
            sought = search(range(2, starts), search(range(1, min(2, starts)), asked))
            sought = sought[np.linalg.norm(error[sought], axis=1) > arrived]
            given_up = np.isin(together, together[sought])
            given_up[sought] = False
            left = left[~np.isin(left, asked) & ~given_up[left]]
        attempt, ahead = 1, 1
        while len(left) and attempt < starts:
            state.clear()
            left = search(range(attempt, min(attempt + ahead, starts)), left)
            attempt += ahead
            # Where many have failed, more are tried at once.
            ahead = max(min(attempt - 1, _AT_ONCE // max(len(left), 1)), 1)
        if last + 1 in state:
            # What was drawn in vain is drawn again: nothing depends on how many are tried at once.
            rng.bit_generator.state = state[last + 1]
        reached = np.linalg.norm(error, axis=1) <= arrived
        distance = np.linalg.norm(error[:, :3], axis=1) * _LENGTH
        angle = np.linalg.norm(error[:, 3:], axis=1)
        failed = ~reached & ~given_up
        return Postures(wrapped(self.true, q), reached, failed, distance, angle)

    def _range(self) -> tuple[FloatArray, FloatArray]:
        """Finite limits to draw readings from."""
        prismatic = np.array([joint.type == "prismatic" for joint in self.arm.readings])
        reach = np.where(prismatic, 1.0, np.pi)
        lower = np.where(np.isfinite(self._lower), self._lower, -reach)
        return lower, np.where(np.isfinite(self._upper), self._upper, reach)

    def _descend(self, targets: Targets, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """One damped Gauss–Newton search per row: final readings and residuals (n, 6)."""
        ends, left = np.empty_like(q), np.empty((len(q), 6))
        rows, batch = np.arange(len(q)), self._batch(len(q))
        error, jacobian = _residuals(batch, targets, q, self.true.gearing)
        cost = (error**2).sum(axis=1)
        damping = np.full(len(q), 1e-3)
        for _ in range(80):
            transposed = np.swapaxes(jacobian, 1, 2)
            # The floor keeps redundant arms, and rows of zeros, solvable.
            floor = (damping * cost + 1e-12)[:, None, None] * np.eye(q.shape[1])
            step = np.linalg.solve(transposed @ jacobian + floor, transposed @ error[..., None])
            moved = np.clip(q + np.clip(step[..., 0], -1.0, 1.0), self._lower, self._upper)
            new_error, new_jacobian = _residuals(batch, targets, moved, self.true.gearing)
            new_cost = (new_error**2).sum(axis=1)
            # A step that takes off less of it ends a search, as near to a target out of reach as it
            # comes. On the way to one within reach, steps take off a thousand times as much.
            better, gains = new_cost < cost, new_cost < (1.0 - 1e-6) * cost
            q = np.where(better[:, None], moved, q)
            error = np.where(better[:, None], new_error, error)
            jacobian = np.where(better[:, None, None], new_jacobian, jacobian)
            cost = np.where(better, new_cost, cost)
            damping = np.clip(np.where(better, damping / 5, damping * 10), 1e-6, 1e8)
            going = (cost >= (_TOLERANCE / 100) ** 2) & (gains | (~better & (damping < 1e8)))
            if not going.any():
                break
            # Most arrive soon; what is out of reach goes on without them.
            # Share of targets still sought from which on the others are let go, which takes a
            # moment, too.
            if np.count_nonzero(going) <= 0.75 * len(rows):
                ends[rows], left[rows] = q, error
                rows, targets = rows[going], targets.take(going)
                q, error, jacobian, cost, damping = (
                    values[going] for values in (q, error, jacobian, cost, damping)
                )
                batch = self._batch(len(rows))
        ends[rows], left[rows] = q, error
        return ends, left

    def _batch(self, n: int) -> Batched:
        batch = Batched(self._function, n, shared=[0])
        batch.inputs[0][:] = self._theta
        return batch


def _residuals(
    batch: Batched, targets: Targets, q: FloatArray, gearing: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, 6) residuals in the tip's frame, lengths in units of `_LENGTH`; (n, 6, joints) by q."""
    batch.inputs[1][:] = q
    flat, position, jacobian = batch()
    to_tip = flat.reshape(-1, 3, 3)  # Column by column: R of the tip in the base, transposed.
    weights = _ROTATION_WEIGHTS[targets.matching][:, None]
    columns = jacobian.reshape(len(q), 6, -1)[:, :, : len(gearing)] @ gearing
    linear, angular = to_tip @ columns[:, :3] / _LENGTH, weights * (to_tip @ columns[:, 3:])
    away = to_tip @ (targets.position - position)[..., None] / _LENGTH
    relative = to_tip @ targets.rotation
    if targets.matching == "pose":
        turn = vector_from_rotation(relative)
    elif weights.any():
        turn = vector_turning_z_to(relative[:, :, 2])
    else:
        turn = np.zeros((len(q), 3))
    error = np.concatenate([away, weights * turn[..., None]], axis=1)[..., 0]
    return error, np.concatenate([linear, angular], axis=1)
