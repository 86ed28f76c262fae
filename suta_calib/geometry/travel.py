"""Where joints came from: what of a recording's motion a joint with play or friction remembers.

A rate-independent memory keeps turning points. A loop that is closed is forgotten: when a reading
comes back to where it turned, what it did since is as if it had never been (Madelung's rules;
Brokate, Sprekels, Hysteresis and Phase Transitions, 1996, section 2.7). What is left of the
readings up to a row are ways, each in the other direction than the one before: the first from
where the recording begins, each later one shorter, the last to the reading itself.

A joint's play is min(w, |way|) of each way, its hysteresis 1 - exp(-|way| / decay): plays
of many widths side by side (Prandtl and Ishlinskii's model; Visintin, Differential Models of
Hysteresis, 1994, section III.2).
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray

# Ways that are kept of each joint: more are of motion that wanders to and fro ever less, and
# of them the two that follow one another and differ least all but cancel each other.
TURNS: Final = 6
# How far readings of an arm at rest wander at least, rad or m.
FLICKER: Final = 3e-5
# What samples may say of the arm beside its readings: `tilt` is what sensors of links felt.
Said = Literal["direction", "warmth", "payload", "tilt", "travel"]


def travel_of(q: FloatArray, time: FloatArray) -> FloatArray:
    """The ways that lead to each reading, in the unit of the readings and with their sign.

    Args:
        q: (n, joints) readings, row by row as they were made.
        time: (n,) of each row, s; where it goes back, another recording begins.

    Returns:
        (n, joints, TURNS); zero where there are fewer. In the first row of a recording there are
        none: nobody knows where the joint came from, and it counts as in the middle of its play.
    """
    columns = np.zeros((*q.shape, TURNS))
    flicker = _flicker(q)
    starts = [0, *(np.flatnonzero(np.diff(time) < 0) + 1).tolist(), len(q)]
    for begin, end in pairwise(starts):
        for joint in range(q.shape[1]):
            readings = q[begin:end, joint].tolist()
            _fill(columns[begin:end, joint], readings, 0.5 * float(flicker[joint]))
    return columns


def _flicker(q: FloatArray) -> FloatArray:
    """(joints,) how far readings come back without a motion, rad or m."""
    # Of smooth motion third differences show but the noise, whose sum they are with a root of 20:
    # three standard deviations each way. Of rows far apart they show the motion: half a per cent of
    # a joint's range is no reversal.
    steady = np.median(np.abs(np.diff(q, 3, axis=0)), axis=0) if len(q) > 3 else 0.0
    most = np.maximum(FLICKER, 0.005 * np.ptp(q, axis=0))
    return np.asarray(np.clip(2.0 * steady, FLICKER, most))


def _fill(found: FloatArray, readings: list[float], slack: float) -> None:
    """Ways (n, TURNS) of one joint in one recording, of motion beyond a slack either way."""
    memory = JointMemory(slack)
    for row, reading in enumerate(readings):
        turns = memory.after(reading)
        found[row, : len(turns)] = turns


class JointMemory:
    """Where one joint came from, reading by reading.

    Args:
        slack: motion within it, either way, is the encoder's flicker, rad or m.
    """

    def __init__(self, slack: float) -> None:
        self._slack, self._now = slack, 0.0
        self._turns = list[float]()

    def after(self, read: float) -> list[float]:
        """The ways that lead to the next reading, at most `TURNS`."""
        turns, slack = self._turns, self._slack
        if not turns:
            turns.append(read)
            self._now = read
        now = min(max(self._now, read - slack), read + slack)
        if (now - self._now) * (self._now - turns[-1]) < 0.0:
            turns.append(self._now)
        self._now = now
        while len(turns) > 1:
            before = abs(turns[-1] - turns[-2])
            # The first way began in the middle: a loop about it closes on its other side.
            first = len(turns) == 2
            if abs(now - turns[-1]) < (2.0 if first else 1.0) * before:
                break
            del turns[-1 if first else -2 :]
        return _fewest([end - begin for begin, end in pairwise([*turns, now])])


def _fewest(ways: list[float]) -> list[float]:
    """At most `TURNS` that are remembered alike."""
    while len(ways) > TURNS:
        sizes = [abs(way) for way in ways[1:]]
        differ = [before - after for before, after in pairwise(sizes)]
        at = 1 + differ.index(min(differ))
        # How far the joint is from where it began stays.
        ways[at - 1] += ways[at] + ways[at + 1]
        del ways[at : at + 2]
    return ways
