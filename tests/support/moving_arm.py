"""An arm that sweeps, and an instrument with a clock of its own that sees it; simulated."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from simulated import arm_named

from suta_calib import ArmModel, Gravity, HandEye, Samples, Term, TrackedPoint
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.terms import ArmPoses

STEP = 0.1
NOISE, TURN_NOISE = 1e-4, 1e-3


@dataclass(frozen=True, eq=False)
class MovingArm:
    """Every joint swings with two slow frequencies; the true arm has offsets of some mrad.

    Attributes:
        late: how much later than the readings of its row an observation was made, s.
        rows: of the recording.
        step: from row to row, s.
        seed: of the motion, the errors and the noise.
    """

    late: float = 0.0
    rows: int = 300
    step: float = STEP
    seed: int = 0
    begin: float = 1.7e9
    arm: ArmModel = field(default_factory=lambda: arm_named("suta"))

    @cached_property
    def time(self) -> FloatArray:
        """(n,) s, as of a clock that counts from 1970."""
        return np.asarray(self.begin + self.step * np.arange(self.rows), dtype=np.float64)

    @cached_property
    def truth(self) -> dict[str, float]:
        """Of the arm's parameters."""
        rng = np.random.default_rng([self.seed, 1])
        return {f"{name}.offset": 0.005 * rng.standard_normal() for name in self.arm.joints[1:]}

    def readings(self, time: FloatArray) -> FloatArray:
        """(n, joints) what the encoders read at some times."""
        rng, joints = np.random.default_rng([self.seed, 2]), len(self.arm.joints)
        rate = rng.uniform(0.05, 0.2, (2, joints))
        phase, size = rng.uniform(0, 2 * np.pi, (2, joints)), rng.uniform(0.2, 0.5, (2, joints))
        turned = 2 * np.pi * (time - self.begin)[:, None, None] * rate + phase
        return np.asarray(np.sum(size * np.sin(turned), axis=1))

    def seen(self, kind: type[Term] = TrackedPoint) -> dict[str, FloatArray]:
        """Arrays of what the instrument measured, as `from_arrays` takes them."""
        rng = np.random.default_rng([self.seed, 3])
        q = self.readings(self.time + self.late)
        blank: dict[str, Any] = {"position": np.zeros((self.rows, 3))}
        if kind is HandEye:
            blank["rotation"] = np.tile(np.eye(3), (self.rows, 1, 1))
        if kind is Gravity:
            blank = {"numbers": {name: np.ones(self.rows) for name in ("ax", "ay", "az")}}
        term = kind(ArmPoses(self.arm, Samples.from_arrays(self.arm.joints, q, **blank)))
        own = {p.name: 0.3 * rng.standard_normal() for p in term.own_parameters}
        ideal = term.observed(self.truth | own, term.poses)
        if kind is Gravity:
            noise = TURN_NOISE * rng.standard_normal((3, self.rows))
            return {n: v + e for (n, v), e in zip(ideal.numbers.items(), noise, strict=True)}
        seen = {"position": ideal.place + NOISE * rng.standard_normal((self.rows, 3))}
        if kind is HandEye:
            turn = rotation_from_vector(TURN_NOISE * rng.standard_normal((self.rows, 3)))
            assert ideal.rotation is not None
            seen["orientation"] = ideal.rotation @ turn
        return seen

    @cached_property
    def q(self) -> FloatArray:
        """(n, joints) what the rows have."""
        rng = np.random.default_rng([self.seed, 4])
        exact = self.readings(self.time)
        return np.asarray(exact + 1e-5 * rng.standard_normal(exact.shape))

    def term(self, kind: type[Term] = TrackedPoint, **given: Any) -> Term:
        """What it saw, perhaps with a time offset."""
        timed = {"time": self.time} if "time_offset" in given else {}
        term: Term = kind.from_arrays(self.arm, self.q, **self.seen(kind), **timed, **given)
        return term
