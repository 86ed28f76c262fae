"""Where a start has the mount of the tip, if the job leaves it wide open.

What an instrument sees may be screwed on at any turn, and steps downhill from the drawing do not
find a turn of half a circle, nor a place a metre away. The term tells in closed form where what it
sees sits in the tip of an arm that is otherwise as given (`Term.mount`): the mount comes first, the
geometry after. Only parameters behind the last joint's motion can make up for it in every posture:
that joint's offset, and the placements of the fixed joints behind it,

    tip(θ) = motion(offset) · Π Trans(xyz) · R_nominal · exp([rx, ry, rz])  =  tip(θ₀) · mount
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from scipy.optimize import least_squares

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector, vector_from_rotation
from suta_calib.model.parameters import OFFSET, PLACEMENT, POSITION, ROTATION
from suta_calib.solver.problem import Problem
from suta_calib.terms.poses import ArmPoses

if TYPE_CHECKING:
    from suta_calib.model.arm import ArmModel
    from suta_calib.model.kinematics import Segment
    from suta_calib.terms.term import Mount

# Half-widths from which on the descent from nominal may end elsewhere: 20°, and a tool's length, m.
WIDE: Final = {"rad": np.radians(20.0), "m": 0.1}


@dataclass(frozen=True, eq=False)
class FreeMount:
    """The free parameters behind the last joint's motion, some of them wide open.

    Attributes:
        problem: they are of.
        arm: the chain that they are of.
        segments: of the arm, from the last moving one on.
        names: of these parameters (n,).
        lower, upper: (n,) their bounds, m or rad.
    """

    problem: Problem
    arm: ArmModel
    segments: tuple[Segment, ...]
    names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray

    @classmethod
    def of(cls, problem: Problem, held: Collection[int] = ()) -> tuple[Self, ...]:
        """The mounts of a problem's chains, where some parameters are held at nominal.

        None of a chain where a descent from nominal finds it anyway.
        """
        arms = () if problem.arm is None else problem.arm.arms
        mounts = (cls._of_chain(problem, arm, held) for arm in arms)
        return tuple(mount for mount in mounts if mount is not None)

    @classmethod
    def _of_chain(cls, problem: Problem, arm: ArmModel, held: Collection[int]) -> Self | None:
        segments = arm.segments
        moving = [k for k, segment in enumerate(segments) if segment.motion != "fixed"]
        tail = tuple(segments[moving[-1] if moving else 0 :])
        # Of a joint that is climbed its own placement stands behind the motion: no arm's last one.
        if moving and tail[0].climbed:
            return None
        behind = {
            name
            for segment in tail
            for name in segment.names(*(PLACEMENT if segment.motion == "fixed" else [OFFSET]))
        }
        every = [p for k, p in enumerate(problem.arm_parameters.values()) if k not in held]
        free = [p for p in every if p.free and p.name in behind]
        wide = [
            p
            for p in every
            if p.free and min(p.plausible, p.prior or np.inf) > WIDE.get(p.unit, np.inf)
        ]
        offsets = [p for p in wide if p.key == OFFSET]
        # Where the other joints' zeros are as unknown as the last one's, the arm tells no mount.
        if not any(p in free and (p.key != OFFSET or len(offsets) == 1) for p in wide):
            return None
        bounds = (np.array([getattr(p, key) for p in free]) for key in ("lower", "upper"))
        return cls(problem, arm, tail, tuple(p.name for p in free), *bounds)

    def starts(self, values: Mapping[str, float]) -> list[dict[str, float]]:
        """Arm values whose tip is where what each term sees is, as far as bounds allow."""
        nominal = {p.name: p.nominal for p in self.problem.arm_parameters.values()}
        given = nominal | dict(values)
        starting_values = []
        for term in self.problem.terms:
            if not isinstance(term.poses, ArmPoses) or term.poses.arm is not self.arm:
                continue
            mount = term.mount(*term.poses.at(given))
            if mount is not None:
                starting_values.append(given | self._reached(given, mount))
        return starting_values

    def _reached(self, given: Mapping[str, float], mount: Mount) -> dict[str, float]:
        """Values of the mount's parameters with which the tip is as near as may be to a body."""
        # What a turn counts beside a place, m per rad: the size of a tool.
        lever = 0.25
        R, p = _pose(self.segments, given)
        target = R if mount.rotation is None else R @ mount.rotation
        place = R @ mount.position + p
        first = np.array([given[name] for name in self.names])
        turns = np.array([name.rpartition(".")[2] not in POSITION for name in self.names])
        size = np.where(turns, 1.0, lever)

        def misfit(scaled: FloatArray) -> FloatArray:
            values = dict(zip(self.names, (scaled * size).tolist(), strict=True))
            R, p = _pose(self.segments, {**given, **values})
            # Share of the squared misfit that nominal values are worth: they decide where nothing
            # else does.
            off = [(p - place) / lever, np.sqrt(1e-8) * (scaled - first / size)]
            if mount.rotation is not None:
                off.append((R - target).reshape(-1))
            return np.concatenate(off)

        begins = [self._exact(given, target, place)]
        random, best = np.random.default_rng(0), None
        # Turns from which the mount's parameters are searched: nominal, and others all about it.
        for k in range(24 if turns.any() else 1):
            if k:
                begins.append(first.copy())
                begins[k][turns] = random.uniform(-np.pi, np.pi, int(turns.sum()))
            begin = begins[k]
            # Strictly inside, as the search asks.
            begin = np.clip(begin, self.lower + 1e-9, self.upper - 1e-9) / size
            ended = least_squares(misfit, begin, bounds=(self.lower / size, self.upper / size))
            if best is None or ended.cost < (1.0 - 1e-6) * best.cost:
                best = ended
            # Half the squared misfit, with what being far from nominal adds to it, of a mount that
            # is reached.
            if best.cost < 1e-6:
                break
        assert best is not None
        return dict(zip(self.names, (best.x * size).tolist(), strict=True))

    def _exact(self, given: Mapping[str, float], R: FloatArray, p: FloatArray) -> FloatArray:
        """Where one fixed joint alone takes up the mount; as given where none is free to turn."""
        values = dict(given)
        for k, segment in enumerate(self.segments):
            turns = segment.names(*ROTATION)
            if segment.motion != "fixed" or segment.climbed or not set(turns) <= set(self.names):
                continue
            (before, at), (after, to) = (
                _pose(part, given) for part in (self.segments[:k], self.segments[k + 1 :])
            )
            turned = before.T @ R @ after.T
            vector = vector_from_rotation(segment.rotation.T @ turned)
            shift = before.T @ (p - at) - turned @ to
            values |= dict(zip(turns, vector.tolist(), strict=True))
            values |= dict(zip(segment.names(*POSITION), shift.tolist(), strict=True))
            break
        return np.array([values[name] for name in self.names])


def _pose(
    segments: tuple[Segment, ...], values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and position (3,), m, of the tip before the last joint's motion."""
    R, p = np.eye(3), np.zeros(3)
    for k, segment in enumerate(segments):
        if k == 0 and segment.motion != "fixed":
            turned = values.get(f"{segment.owner}.{OFFSET}", 0.0) * segment.axis
            if segment.motion == "prismatic":
                p = turned
            else:
                R = rotation_from_vector(turned)
            continue
        defaults = dict(zip(POSITION, segment.position.tolist(), strict=True))
        at = np.array([values.get(f"{segment.owner}.{key}", defaults[key]) for key in POSITION])
        turn = np.array([values.get(f"{segment.owner}.{key}", 0.0) for key in ROTATION])
        turn_here = segment.rotation @ rotation_from_vector(turn)
        if segment.climbed:
            turn_here, at = turn_here.T, -turn_here.T @ at
        R, p = R @ turn_here, R @ at + p
    return R, p
