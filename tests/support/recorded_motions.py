"""One motion, recorded twice: by a hand's poses and by a tracker with a clock of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from suta_calib.arrays import FloatArray
from suta_calib.exchange.tracked_bodies import Body
from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_vector

# T_hand_target and T_eye_base, of which the alignment knows nothing.
X = Body(np.array([[0.1, 0.05, -0.2]]), rotation_from_vector([[0.3, -1.0, 0.5]]))
Z = Body(np.array([[1.1, 0.05, -0.2]]), rotation_from_vector([[2.0, 0.3, 0.5]]))
SHIFT, DRIFT = 1.7, 1e-3
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")

Motion = Callable[[FloatArray], Body]


def after(a: Body, b: Body) -> Body:
    """``a b``."""
    assert a.rotation is not None
    assert b.rotation is not None
    position = (a.rotation @ b.position[..., None])[..., 0] + a.position
    return Body(position, a.rotation @ b.rotation)


def smooth_motion(seed: int, seconds: float) -> Motion:
    """Poses of a hand that wanders for so long."""
    rng, every = np.random.default_rng(seed), 0.8
    count = int(seconds / every) + 8
    knots = np.cumsum(rng.normal(size=(count, 6)), axis=0)
    knots -= np.linspace(0.0, 1.0, count)[:, None] * knots[-1]
    knots *= np.array([1.0, 1.0, 1.0, 0.3, 0.3, 0.3]) / np.abs(knots).max(axis=0)
    path = CubicSpline(every * (np.arange(count) - 3), knots)
    return lambda t: Body(path(t)[:, 3:], rotation_from_vector(path(t)[:, :3]))


def repeated_motion(t: FloatArray) -> Body:
    """Poses of a hand that swings, every time alike."""
    phase = 2.0 * np.pi * t / 4.0
    turn = np.stack([np.sin(phase), 0.5 * np.cos(phase), 0.0 * t], axis=1)
    return Body(0.2 * turn, rotation_from_vector(turn))


def steady_motion(t: FloatArray) -> Body:
    """Poses of a hand that turns evenly."""
    turn = np.stack([0.0 * t, 0.0 * t, 0.5 * t], axis=1)
    return Body(np.ones((len(t), 3)), rotation_from_vector(turn))


@dataclass(eq=False)
class Recording:
    """Stamps (n,), s, and poses; ``true`` times, s, are those of the hand's clock."""

    stamps: FloatArray
    body: Body
    true: FloatArray

    def write(self, path: Path, *, drop: tuple[str, ...] = (), clock: float = 1.0) -> Path:
        """As a poses CSV, some columns left out, with so many units of its clock a second."""
        assert self.body.rotation is not None
        quaternion = quaternion_from_rotation(self.body.rotation)
        columns = dict(zip(POSE, np.hstack([self.body.position, quaternion]).T, strict=True))
        columns = {"time": self.stamps * clock, **columns}
        kept = {name: values for name, values in columns.items() if name not in drop}
        rows = (",".join(map(repr, row)) for row in np.stack([*kept.values()], axis=1).tolist())
        path.write_text("\n".join([",".join(kept), *rows]) + "\n")
        return path


def recorded(
    motion: Motion, true: FloatArray, seed: int, noise: tuple[float, float] = (0.0, 0.0)
) -> Recording:
    """The hand as its robot tells it, with noise in rad and m."""
    rng, body = np.random.default_rng(seed), motion(true)
    turn = rotation_from_vector(noise[0] * rng.standard_normal((len(true), 3)))
    assert body.rotation is not None
    position = body.position + noise[1] * rng.standard_normal((len(true), 3))
    return Recording(true, Body(position, body.rotation @ turn), true)


def seen(motion: Motion, true: FloatArray, seed: int, *, inverse: bool = False) -> Recording:
    """The target on the hand as a tracker sees it, or the tracker from the target."""

    def of(t: FloatArray) -> Body:
        pose = after(after(Z.inverse(), motion(t)), X)
        return pose.inverse() if inverse else pose

    found = recorded(of, true, seed, (5e-4, 2e-4))
    return Recording((true - SHIFT) / (1.0 + DRIFT), found.body, true)


def two_recordings(
    seed: int = 0, rows: int = 1500, step: float = 0.033, *, inverse: bool = False
) -> tuple[Recording, Recording]:
    """The hand, and the target from 0.5 s on, in rows that are not quite evenly spaced."""
    rng, seconds = np.random.default_rng(seed), rows * step
    motion = smooth_motion(seed, seconds + 1.0)
    uneven = step * (np.arange(rows) + rng.uniform(-0.1, 0.1, (2, rows)))
    hand = recorded(motion, uneven[0], seed + 1, (1e-5, 1e-5))
    return hand, seen(motion, uneven[1] + 0.5, seed + 2, inverse=inverse)
