"""A motion without stops, thinned to the postures that tell something of their own.

Rows that follow one another tell the same thing again: the model errs alike in like postures. A row
counts if its posture is apart from all that count already, however fast or often the arm passes.
Rows of one stroke, from one reversal of the motion to the next, share the side on which friction
and play hold the tip; `Term.clusters` counts them once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from suta_calib.acquisition.averaging import unwrapped_about_median
from suta_calib.acquisition.rest import STALL
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.device.reading import Reading
from suta_calib.geometry.numbers import wrap
from suta_calib.model.arm import ArmModel
from suta_calib.units import from_deg

# How far one joint must have moved for a posture to be another one, rad: gears ripple and encoders
# err over some degrees, and a hand holds an arm still to some tenths.
APART: Final = from_deg(2.0)


@dataclass(frozen=True, eq=False)
class Moment:
    """Where the arm was: s since the first reading, and (n,) readings, rad (m).

    ``cut`` says that what came before is not known: the stream paused, or began.
    """

    time: float
    angles: FloatArray
    cut: bool = False


class Moments:
    """Makes moments of a stream of readings, which may pause, repeat itself and hold nonsense.

    Attributes:
        seconds: that were recorded; pauses do not count.
        now: s since the first reading, by the device's clock.
        unusable: readings that are no numbers, or came with a raised error flag.
        repeated: readings that are the one before again.
    """

    def __init__(self) -> None:
        self.seconds = self.now = 0.0
        self.unusable = self.repeated = 0
        self._last: Reading | None = None
        self._waiting: list[tuple[float, FloatArray]] = []
        self._cut = True

    def feed(self, readings: Iterable[Reading]) -> list[Moment]:
        """The moments that are complete with these readings."""
        moments = []
        # So many readings in a row, in at most so many s, are one: a wrong one among them does no
        # harm. An odd number has a middle one, with all joints at one moment.
        at_once = 7
        within = 0.02
        # A pause that may be one, s; what is longer is a damaged time.
        longest = 3600.0
        for reading in readings:
            if reading.error.any() or not np.isfinite([reading.time, *reading.angles]).all():
                self.unusable += 1
                continue
            step = 0.0 if self._last is None else reading.time - self._last.time
            last, self._last = self._last, reading
            # Lines that arrive together have one time, too, but readings of their own.
            if last is not None and step == 0.0 and np.array_equal(reading.angles, last.angles):
                self.repeated += 1
                continue
            # A clock that runs backwards, or leaps, is another one: the device was started again.
            paused = not 0.0 <= step < STALL
            self.now += step if 0.0 <= step < longest else 0.0
            self.seconds += 0.0 if paused else step
            if self._waiting and (paused or self.now - self._waiting[0][0] > within):
                moments.append(self._moment())
            self._cut |= paused
            self._waiting.append((self.now, reading.angles))
            if len(self._waiting) == at_once:
                moments.append(self._moment())
        return moments

    def rest(self) -> list[Moment]:
        """What was not complete yet, when nothing more comes."""
        return [self._moment()] if self._waiting else []

    def _moment(self) -> Moment:
        waiting, self._waiting = self._waiting, []
        angles = unwrapped_about_median(np.array([angles for _, angles in waiting]))[0]
        moment = Moment(waiting[len(waiting) // 2][0], angles, self._cut)
        self._cut = False
        return moment


class PostureDistance:
    """Distances between postures of one arm, as angles.

    Args:
        arm: whose joints.
    """

    def __init__(self, arm: ArmModel) -> None:
        sliding = np.array([joint.type == "prismatic" for joint in arm.readings])
        # What a joint that slides moves for a radian of the others, m.
        self._per_radian = np.where(sliding, 0.2, 1.0)
        self._turns = ~sliding

    def steps(self, angles: FloatArray, other: FloatArray) -> FloatArray:
        """(..., n) way of each joint, rad: the shorter one of a joint that turns."""
        away = (angles - other) / self._per_radian
        return np.asarray(np.where(self._turns, wrap(away), away))

    @property
    def box(self) -> FloatArray:
        """(n,) after which `coordinates` begin again; 0 where they never do."""
        return np.where(self._turns, 2 * np.pi, 0.0)

    def coordinates(self, angles: FloatArray) -> FloatArray:
        """(..., n) whose largest difference is `apart`, rad."""
        scaled = angles / self._per_radian
        return np.asarray(np.where(self._turns, np.mod(scaled, 2 * np.pi) % (2 * np.pi), scaled))

    def apart(self, angles: FloatArray, others: FloatArray) -> FloatArray:
        """(k,) how far the joint is that has moved farthest from each of (k, n), rad."""
        return np.asarray(np.max(np.abs(self.steps(angles, others)), axis=-1, initial=0.0))


class KeptPostures:
    """PostureDistance that count so far, to be asked again and again whether one is near another.

    Args:
        postures: of the arm.
        earlier: (k, n) that count already.
    """

    def __init__(self, postures: PostureDistance, earlier: Sequence[FloatArray]) -> None:
        self._postures = postures
        # Those in the tree, and those that have come since it was made.
        self._tree: KDTree | None = None
        self._in_tree = list(earlier)
        self._fresh: list[FloatArray] = []
        self._plant()

    def add(self, angles: FloatArray) -> None:
        """One more."""
        self._fresh.append(angles)
        if len(self._fresh) > max(64, len(self._in_tree) // 8):
            self._in_tree += self._fresh
            self._fresh = []
            self._plant()

    def near(self, angles: FloatArray, apart: float) -> bool:
        """Whether one is closer than so much, rad."""
        if self._fresh and self._postures.apart(angles, np.array(self._fresh)).min() < apart:
            return True
        if self._tree is None:
            return False
        nearest, _ = self._tree.query(
            self._postures.coordinates(angles), p=np.inf, distance_upper_bound=apart
        )
        return bool(nearest < apart)

    def _plant(self) -> None:
        if self._in_tree:
            coordinates = self._postures.coordinates(np.array(self._in_tree))
            self._tree = KDTree(coordinates, boxsize=self._postures.box)


class Thinning:
    """Which moments of a sweep count, and in which stroke each is.

    Args:
        postures: of the arm.
        apart: how far a posture must be from all that count, rad.
        every: least time between two rows, s.
        earlier: (k, n) postures that count already.
        strokes: how many strokes there were before.
    """

    def __init__(
        self,
        postures: PostureDistance,
        apart: float = APART,
        every: float = 0.0,
        earlier: Sequence[FloatArray] = (),
        strokes: int = 0,
    ) -> None:
        self._postures, self._apart, self._every = postures, apart, every
        self._kept = KeptPostures(postures, earlier)
        self._last = -np.inf
        self._begin: FloatArray | None = None
        self._far: tuple[float, FloatArray] | None = None
        self.stroke = strokes

    def counts(self, moment: Moment) -> bool:
        """Whether a moment counts, which comes after all that were asked about before."""
        self._follow(moment)
        if moment.time - self._last < self._every:
            return False
        if self._kept.near(moment.angles, self._apart):
            return False
        self._kept.add(moment.angles)
        self._last = moment.time
        return True

    def cut(self) -> None:
        """What comes next belongs to another stroke."""
        self._begin = None

    def _follow(self, moment: Moment) -> None:
        """Whether this is another stroke: the arm is on its way back, or it was lost."""
        if self._begin is None or moment.cut:
            self.stroke += 1
            self._begin, self._far = moment.angles, (0.0, moment.angles)
            return
        away = float(np.linalg.norm(self._postures.steps(moment.angles, self._begin)))
        assert self._far is not None
        # How far the arm must have come back for a stroke to have ended, rad: a hesitation is no
        # reversal.
        returned = from_deg(5.0)
        if away >= self._far[0]:
            self._far = away, moment.angles
        elif away < self._far[0] - returned:
            self.stroke += 1
            turned = self._far[1]
            back = float(np.linalg.norm(self._postures.steps(moment.angles, turned)))
            self._begin, self._far = turned, (back, moment.angles)


def thinned(
    postures: PostureDistance,
    moments: Sequence[Moment],
    used: Sequence[bool],
    *,
    apart: float = APART,
    every: float = 0.0,
    earlier: Sequence[FloatArray] = (),
    strokes: int = 0,
) -> tuple[IntArray, IntArray]:
    """Which moments count, and the stroke of each of these; moments that are not used cut strokes.

    Arguments as of `Thinning`.
    """
    thinning = Thinning(postures, apart, every, earlier, strokes)
    rows, stroke = list[int](), list[int]()
    for k, (moment, use) in enumerate(zip(moments, used, strict=True)):
        if not use:
            thinning.cut()
        elif thinning.counts(moment):
            rows.append(k)
            stroke.append(thinning.stroke)
    return np.array(rows, dtype=np.intp), np.array(stroke, dtype=np.intp)
