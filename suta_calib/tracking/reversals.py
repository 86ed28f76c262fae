"""What happens where a joint turns back: the tip's error just before and after, and hysteresis.

A joint with play lags behind by half its hysteresis, ``reading = angle - h/2 · sign(rate)``, and
moves the tip's error by ``h`` times the joint's lever when it turns back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from suta_calib.acquisition.averaging import row_noise
from suta_calib.arrays import FloatArray
from suta_calib.batched import Batched
from suta_calib.geometry.numbers import rms_length
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.trajectory import Trajectory
from suta_calib.units import Unit, from_deg


@dataclass(frozen=True, eq=False)
class Channel:
    """Something that moves to and fro: a joint, or the tip along an axis.

    Attributes:
        name, unit: a joint (rad, or m), or ``x``, ``y``, ``z`` (m).
        coordinate: (n,) where it is.
        lever: (n, 3) velocity of the tip for unit rate, in the recording's frame.
    """

    name: str
    unit: Unit
    coordinate: FloatArray
    lever: FloatArray


@dataclass(frozen=True, eq=False)
class Reversal:
    """One turning back.

    Attributes:
        time: s, when the channel was farthest.
        sense: +1 where it moves up afterwards, -1 where it moves down.
        stop, start: rows between which it stands at the farthest point, its play being taken up.
        before, after: (3,) mean error of the tip in the window on either side, m.
    """

    time: float
    sense: int
    stop: int
    start: int
    before: FloatArray
    after: FloatArray


@dataclass(frozen=True, eq=False)
class ChannelReversals:
    """All reversals of one channel, in order of time."""

    channel: Channel
    reversals: tuple[Reversal, ...]

    @property
    def error_before(self) -> float:
        """Root mean square of the tip's error before turning back, m; NaN without reversals."""
        return _rms([r.before for r in self.reversals])

    @property
    def error_after(self) -> float:
        """The same afterwards."""
        return _rms([r.after for r in self.reversals])

    @property
    def jump(self) -> float:
        """Root mean square change of the tip's error, m; what others do meanwhile is in it."""
        return _rms([r.after - r.before for r in self.reversals])

    @property
    def sense(self) -> FloatArray:
        """(n,) which side of its play it is on, -1 … 1, going over while it stands."""
        rows = np.arange(len(self.channel.coordinate))
        at = [row for r in self.reversals for row in (r.stop, r.start)]
        side = [float(s) for r in self.reversals for s in (-r.sense, r.sense)]
        return np.interp(rows, at, side) if at else np.zeros(len(rows))


def joint_channels(arm: ArmModel, recorded: Trajectory) -> list[Channel]:
    """The arm's joints, with the levers that the recorded tip gives them."""
    assert recorded.angles is not None
    levers = _tip_velocities(arm, recorded, arm.offsets) @ arm.gearing
    return [
        Channel(name, arm.units[name], recorded.angles[:, k], levers[:, :, k])
        for k, name in enumerate(arm.joints)
    ]


def placement_errors(arm: ArmModel, recorded: Trajectory) -> FloatArray:
    """(n, 3, k) velocity of the recorded tip for unit change of each placement parameter."""
    return _tip_velocities(arm, recorded, [n for n in arm.parameters if n in arm.geometric])


def _tip_velocities(arm: ArmModel, recorded: Trajectory, names: Sequence[str]) -> FloatArray:
    """(n, 3, k) of the recorded tip, which a tool may have carried beyond the arm's."""
    rows = len(recorded.time)
    batch = Batched(arm.function(names), rows, shared=[0])
    batch.inputs[0][:] = [arm.parameters[name].nominal for name in names]
    batch.inputs[1][:] = recorded.angles
    _, position, flat = batch()
    jacobian = flat.reshape(rows, 6, len(names))
    beyond = (recorded.position - position)[:, :, None]
    return jacobian[:, :3] + np.cross(jacobian[:, 3:], beyond, axis=1)


def axis_channels(recorded: Trajectory) -> list[Channel]:
    """The tip along the axes of the recording, where nothing is known of joints."""
    rows = len(recorded.time)
    return [
        Channel(name, "m", recorded.position[:, k], np.tile(np.eye(3)[k], (rows, 1)))
        for k, name in enumerate("xyz")
    ]


def find_reversals(channel: Channel, time: FloatArray, error: FloatArray) -> ChannelReversals:
    """Where a channel turns back, and the tip's error (n, 3), m, just before and just after.

    The error is recorded minus reference, in the recording's frame; NaN where unknown.
    """
    # A coordinate that trembles must go many times its noise to have turned back, and some times it
    # to be seen not to stand; a joint with play may creep.
    noise = float(row_noise(channel.coordinate))
    # Way that counts as having turned back, and from which on the play is taken up.
    travel = max({"rad": from_deg(0.25), "m": 0.5e-3}[channel.unit], 8.0 * noise)
    creep = max(0.02 * travel, 3.0 * noise)
    turns = turning_points(channel.coordinate, travel)
    around = [_neighbourhood(channel.coordinate, row, sense, travel) for row, sense in turns]
    reversals = []
    for k, (row, sense) in enumerate(turns):
        first, last = around[k]
        # Means of the error over 0.1 s, and not beyond the next reversal.
        window = np.searchsorted(time, [time[first] - 0.1, time[last] + 0.1])
        begin = max(around[k - 1][1] if k else 0, window[0])
        end = min(around[k + 1][0] if around[k + 1 :] else len(time), window[1])
        before, after = _mean(error[begin : first + 1]), _mean(error[last:end])
        if before is not None and after is not None:
            stands = _neighbourhood(channel.coordinate, row, sense, creep)
            reversals.append(Reversal(float(time[row]), sense, *stands, before, after))
    return ChannelReversals(channel, tuple(reversals))


def turning_points(x: FloatArray, travel: float) -> list[tuple[int, int]]:
    """Rows at which x is farthest before it goes back by ``travel``, and the new direction."""
    turns: list[tuple[int, int]] = []
    sense, low, high = 0, 0, 0
    for row, value in enumerate(x.tolist()):
        if value > x[high]:
            high = row
        if value < x[low]:
            low = row
        if sense >= 0 and value < x[high] - travel:
            turns += [(high, -1)] if sense else []
            sense, low = -1, row
        elif sense <= 0 and value > x[low] + travel:
            turns += [(low, 1)] if sense else []
            sense, high = 1, row
    return turns


def _neighbourhood(x: FloatArray, row: int, sense: int, distance: float) -> tuple[int, int]:
    """Last row before and first row after at which x is ``distance`` away from its farthest."""
    away = sense * (x - x[row]) > distance
    before, after = np.flatnonzero(away[:row]), np.flatnonzero(away[row:])
    first = int(before[-1]) if before.size else 0
    return first, row + int(after[0]) if after.size else len(x) - 1


def _mean(error: FloatArray) -> FloatArray | None:
    """Mean of the rows (n, 3) that are known, None where there are too few."""
    finite = error[np.isfinite(error).all(axis=1)]
    return finite.mean(axis=0) if len(finite) >= 3 else None


def _rms(vectors: Sequence[FloatArray]) -> float:
    return rms_length(vectors) if vectors else math.nan
