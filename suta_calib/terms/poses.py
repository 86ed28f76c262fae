"""Where the poses of a term come from: an arm's readings, or a tracking system.

A pose source gives ``T_base_tool`` for every sample. For an arm it is a function of the unknown
geometry; for a body that was tracked it is a measurement. Terms are written over either.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.measurements.felt import averaged, rows_not_used, up_felt
from suta_calib.measurements.sample_files import JointRange, check_readings
from suta_calib.measurements.samples import Samples
from suta_calib.model.bodies import ALONE, Bodies
from suta_calib.model.cell import own_names
from suta_calib.model.parameters import End
from suta_calib.terms.block import numbered
from suta_calib.units import mm

if TYPE_CHECKING:
    from suta_calib.model.arm import ArmModel
    from suta_calib.model.kinematics import Condition

# How far readings of an arm at rest wander, rad or m: 0.03 mm at a metre's reach. No plug is seated
# again so exactly.
WANDER: Final = 3e-5


class PoseSource(ABC):
    """Poses ``T_base_tool`` of the samples of one term.

    Attributes:
        samples: the rows, with whatever was observed beside the pose.
        bodies: what the ends of its chain are called, where a robot has several.
        clock: name of the unknown that says how much later than the readings what is seen was
            seen; empty where both have one clock.
        delay: name of the unknown that, times the lag, is added to it; empty for none.
        lag: (n,) of each pose.
    """

    samples: Samples
    bodies: Bodies
    clock: str = ""
    delay: str = ""
    lag: FloatArray | float = 0.0

    def __len__(self) -> int:
        return len(self.samples)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self)} poses>"

    @property
    def chain(self) -> str:
        """Which of several chains of a robot has them; empty where there is only one."""
        return self.bodies.name

    @property
    def sort_of_chain(self) -> str:
        """What sentences call it: a chain that was named after what it ends at is a link."""
        return "chain"

    @cached_property
    def rests(self) -> IntArray:
        """(n,) one number, from 0, for all samples that were read at one rest of the arm.

        They say once where it was, however often they were read. What was measured, not read, has
        an error of its own each time.
        """
        return np.arange(len(self), dtype=np.intp)

    @cached_property
    def postures(self) -> IntArray:
        """(n,) one number, from 0, for all samples at one posture, which the arm may come back to.

        They share what the model gets wrong there, and where it did not move, all else.
        """
        return self.rests

    def label(self, label: str, end: End) -> str:
        """The label of something in the base or on the tip, beside those of other chains."""
        return self.bodies.label(label, end)

    @abstractmethod
    def at(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Rotations (n, 3, 3) and positions (n, 3), m, for parameter values by name."""

    @property
    def nominal_tips(self) -> FloatArray:
        """(n, 3) positions by nominal values, m."""
        return self.at({})[1]

    @abstractmethod
    def with_samples(self, samples: Samples) -> PoseSource:
        """The same poses with other things observed beside them; rows for rows."""

    @abstractmethod
    def take(self, rows: ArrayLike) -> PoseSource:
        """The poses of some samples, by number or by boolean mask."""


# Every reading of the same data asks again.
@lru_cache(maxsize=8)
def joint_ranges(arm: ArmModel) -> tuple[JointRange, ...]:
    """What the columns of a samples file must hold for this arm."""
    of_chain = set(arm.own_joints)
    # A file of one robot of a cell may call its joints as that robot's URDF does.
    short = own_names(of_chain)
    followers = {
        joint.name: tuple(n for n, read in arm.read_from.items() if n != joint.name == read)
        for joint in arm.readings
    }
    return tuple(
        JointRange(
            *(j.name, "m" if j.type == "prismatic" else "rad"),
            # Another chain's reading that the samples lack is zero, whatever its limits are.
            *((j.lower, j.upper) if j.name in of_chain else (min(j.lower, 0.0), max(j.upper, 0.0))),
            followers[j.name],
            j.name not in of_chain,
            short.get(j.name, ""),
        )
        for j in arm.readings
    )


class ArmPoses(PoseSource):
    """Poses of an arm's tip by forward kinematics: the geometry may be unknown.

    Args:
        arm: whose tip it is.
        samples: its readings, and what was observed beside them.

    Raises:
        SamplesError: readings of other joints or of these in another order, and readings that can
            only be degrees, millimetres or whole turns off.
    """

    def __init__(self, arm: ArmModel, samples: Samples) -> None:
        if not isinstance(samples, Samples) or not hasattr(arm, "joints"):
            found = f"{type(arm).__name__}, {type(samples).__name__}"
            raise SamplesError(found, "an ArmModel and Samples", where="ArmPoses")
        if samples.joints != arm.joints:
            raise SamplesError(
                f"readings of {', '.join(samples.joints) or 'no joints'}",
                f"those of the arm, in its order: {', '.join(arm.joints)}",
                where="samples",
            )
        check_readings(samples.q, joint_ranges(arm), samples.origin)
        _check_loops(arm, samples)
        self.arm, self.bodies = arm, arm.bodies
        self.samples = samples
        # Readings that are looked at to learn how far the tip reaches: an average needs no more.
        self._levers = _Levers(arm, samples.q[:: 1 + len(samples) // 50])
        self._standing = _Standing(samples.q, loads=samples.payload)
        # What most rows felt tells which of them were at rest.
        there = [s.felt for s in arm.tilt_sensors if s.felt in samples.felt]
        rests = self._one_after_the_other() if there else np.zeros(0, dtype=np.intp)
        self._up_felt = {name: averaged(up_felt(samples.felt[name]), rests) for name in there}

    def _one_after_the_other(self) -> IntArray:
        """(n,) one number for rows that were read one after the other at one rest."""
        files = np.array([file for file, _ in self.samples.files()])
        begins = (np.diff(self.rests) != 0) | (np.diff(files) != 0)
        return np.concatenate([[0], np.cumsum(begins)]).astype(np.intp)

    @property
    def sort_of_chain(self) -> str:
        """As of `PoseSource`."""
        return "link" if self.bodies.name == self.arm.chain.tip else "chain"

    @property
    def reach(self) -> float:
        """Tip motion per unit of noise in every joint, m/rad: root of the summed squared levers.

        Of the arm as it is drawn, on average over where it was; some of the samples have that of
        all.
        """
        return self._levers.reach

    @cached_property
    def rests(self) -> IntArray:
        """Rows whose readings differ by no more than encoders do at rest, in order or not.

        Some of the samples stood still where all of them tell so.
        """
        return self._standing.rests

    @cached_property
    def postures(self) -> IntArray:
        """Rows whose readings hardly differ, as those of all samples tell."""
        return self._standing.postures

    def at(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Forward kinematics of the samples."""
        q = self.readings(values)
        return self.arm.forward(q, values, self.conditions)

    @property
    def nominal_tips(self) -> FloatArray:
        """Of all samples once, however many subsets ask."""
        return super().nominal_tips if self.conditions else self._standing.tips(self.arm)

    def readings(self, values: Mapping[str, float]) -> FloatArray:
        """(n, joints) readings when it was seen, by the values of the clock's unknowns."""
        motion = self.samples.motion
        offset = values.get(self.clock, 0.0) + self.lag * values.get(self.delay, 0.0)
        if not self.clock or motion is None or not np.any(offset):
            return self.samples.q
        return np.asarray(self.samples.q + motion.beyond(offset)[0])

    @cached_property
    def conditions(self) -> Mapping[Condition, FloatArray]:
        """What is said of the arm beside its readings, as its kinematics take it."""
        felt, sensors = self.samples.felt, self.arm.tilt_sensors
        conditions: dict[Condition, FloatArray] = self.samples.conditions
        if any(sensor.felt in felt for sensor in sensors):
            nothing = np.zeros((len(self), 3))
            conditions["tilt"] = np.hstack([self._up_felt.get(s.felt, nothing) for s in sensors])
        return conditions

    @property
    def felt_doubts(self) -> tuple[str, ...]:
        """Of tilt sensors, rows that are not used."""
        nothing, origin = np.zeros((len(self), 3)), self.samples.origin
        return tuple(
            sentence
            for sensor in self.arm.tilt_sensors
            for felt in [self.samples.felt.get(sensor.felt, nothing)]
            for sentence in rows_not_used(f"the tilt sensor of {sensor.link}", felt, origin)
        )

    def with_samples(self, samples: Samples) -> ArmPoses:
        """The same arm's poses at the samples' readings."""
        return self.by_clock(self.clock, samples)

    def by_clock(self, name: str, samples: Samples) -> ArmPoses:
        """The same arm's poses, at times that an unknown of this name moves."""
        poses = ArmPoses(self.arm, samples)
        poses.clock = name
        if samples.q is self.samples.q and samples.payload is self.samples.payload:
            poses._levers, poses._standing = self._levers, self._standing
        return poses

    def with_felt_error(self, felt: str, error: FloatArray) -> ArmPoses:
        """The same, of which a tilt sensor has this error (3,) in every row, in parts of gravity.

        It is less where rows of one rest were averaged.
        """
        poses, up = copy(self), self._up_felt[felt]
        poses.__dict__.pop("conditions", None)
        rests = self._one_after_the_other()
        off = up + np.outer(up.any(axis=1) / np.sqrt(np.bincount(rests)[rests]), error)
        length = np.linalg.norm(off, axis=1, keepdims=True)
        poses._up_felt = {**self._up_felt, felt: off / np.where(length > 0, length, 1.0)}
        return poses

    def late(self, rows: IntArray, lag: FloatArray, delay: str) -> ArmPoses:
        """The poses of some samples, each later by its lag times an unknown."""
        poses = self.take(rows)
        poses.lag, poses.delay = lag, delay
        return poses

    def of_arm(self, arm: ArmModel) -> ArmPoses:
        """The same readings of the same chain with other nominal values (`ArmModel.at`)."""
        poses = copy(self)
        poses.arm = arm
        return poses

    def take(self, rows: ArrayLike) -> ArmPoses:
        """The poses of some samples of the same arm."""
        # A study takes thousands of times: what the constructor refuses is in none of these.
        taken = object.__new__(ArmPoses)
        taken.arm, taken.bodies, taken.samples = self.arm, self.bodies, self.samples.take(rows)
        taken.clock = self.clock
        taken._levers, taken._standing = self._levers, self._standing.take(rows)
        chosen = np.asarray(rows)
        taken._up_felt = {name: up[chosen] for name, up in self._up_felt.items()}
        return taken


def _check_loops(arm: ArmModel, samples: Samples) -> None:
    """Refuse readings at which a closed loop of the arm cannot close."""
    gaps = arm.open_loops(samples.q)
    # What built links and the zeros of encoders do to a loop near the end of its reach, m.
    allowed = 0.01
    for row in np.flatnonzero(~(gaps <= allowed)).tolist():
        raise SamplesError(
            f"readings at which the closed loop stays open by {mm(float(gaps[row])):.3g} mm",
            "readings that the loop can reach",
            where=samples.origin[row],
            hint="check the signs, the zeros and the units of the joints of the loop",
        )


@dataclass(frozen=True, eq=False)
class _Levers:
    """An arm at a few readings q (n, joints)."""

    arm: ArmModel
    q: FloatArray

    @cached_property
    def reach(self) -> float:
        """See `ArmPoses.reach`."""
        step = 1e-6
        around = self.q + step * np.eye(self.q.shape[1])[:, None, :]
        _, position = self.arm.forward(np.vstack([self.q, *around]))
        rest, *turned = position.reshape(-1, len(self.q), 3)
        levers = (np.array(turned) - rest) / step
        return float(np.sqrt(np.sum(levers**2) / len(self.q))) or 1.0


@dataclass(frozen=True, eq=False)
class _Standing:
    """Which rows of readings q (n, joints) are alike; asked about some (k,) of them, or all.

    What all tell is found once, however many subsets are looked at.
    """

    q: FloatArray
    rows: IntArray | None = None
    # What the tip carries (n, 4): with another load it is no longer where it was.
    loads: FloatArray | None = None
    by_tolerance: dict[float, IntArray] = field(default_factory=dict)
    by_arm: dict[ArmModel, FloatArray] = field(default_factory=dict)

    @property
    def rests(self) -> IntArray:
        """See `ArmPoses.rests`."""
        return self._groups(WANDER, self.loads)

    @property
    def postures(self) -> IntArray:
        """See `ArmPoses.postures`."""
        # How far apart readings are of one posture, rad or m: a model's error does not change
        # within a millimetre, whoever came back there.
        same_posture = 1e-3
        return self._groups(same_posture)

    def take(self, rows: ArrayLike) -> _Standing:
        """Those of some rows, by number or by boolean mask."""
        before = np.arange(len(self.q)) if self.rows is None else self.rows
        known = self.by_tolerance, self.by_arm
        return _Standing(self.q, before[np.asarray(rows)], self.loads, *known)

    def tips(self, arm: ArmModel) -> FloatArray:
        """See `ArmPoses.nominal_tips`."""
        if arm not in self.by_arm:
            self.by_arm[arm] = arm.forward(self.q)[1]
        of_all = self.by_arm[arm]
        return of_all if self.rows is None else of_all[self.rows]

    def _groups(self, tolerance: float, loads: FloatArray | None = None) -> IntArray:
        if tolerance not in self.by_tolerance:
            both = self.q if loads is None else np.hstack([self.q, loads])
            self.by_tolerance[tolerance] = together(both, tolerance)
        of_all = self.by_tolerance[tolerance]
        return of_all if self.rows is None else numbered(of_all[self.rows])[1]


class MeasuredPoses(PoseSource):
    """Poses that were measured: no parameter changes them.

    Args:
        rotation: (n, 3, 3) of ``T_base_tool``.
        position: (n, 3), m.
        samples: what was observed beside them, n rows (may have no joints).
        exact: whether their own noise may be left out of account when it is judged what the data
            tell: because it is small, or the caller judges by himself.
        judged: whether the solver judges what their noise makes up; False where the caller does.
        bodies: what the ends of the chain are called that they are the poses of.
    """

    def __init__(
        self,
        rotation: FloatArray,
        position: FloatArray,
        samples: Samples,
        *,
        exact: bool = False,
        judged: bool = True,
        bodies: Bodies = ALONE,
    ) -> None:
        self.rotation, self.position, self.bodies = rotation, position, bodies
        self.samples, self.exact, self.judged = samples, exact, judged and not exact

    @cached_property
    def postures(self) -> IntArray:
        """Poses that hardly differ, as those of a body that did not move; of exact ones, none."""
        if self.exact:
            return self.rests
        return together(np.hstack([self.position, self.rotation.reshape(len(self), 9)]))

    def at(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """The measured poses, whatever the values."""
        del values
        return np.asarray(self.rotation), np.asarray(self.position)

    @property
    def _kinds(self) -> dict[str, Any]:
        return {"exact": self.exact, "judged": self.judged, "bodies": self.bodies}

    def with_samples(self, samples: Samples) -> MeasuredPoses:
        """The same measured poses."""
        return MeasuredPoses(self.rotation, self.position, samples, **self._kinds)

    def take(self, rows: ArrayLike) -> MeasuredPoses:
        """Some of the poses."""
        chosen, samples = np.asarray(rows), self.samples.take(rows)
        return MeasuredPoses(self.rotation[chosen], self.position[chosen], samples, **self._kinds)


def together(q: FloatArray, tolerance: float = WANDER) -> IntArray:
    """Group (n,) of rows of readings (n, joints) that hardly differ, by first appearance.

    A row is within the tolerance, or an encoder's flicker, of the first of its group in every
    joint.
    """
    # Steps of a coarse encoder that a reading at rest flickers over.
    flicker = 2.0
    steps = q / np.maximum(tolerance, flicker * resolutions(q))
    first = np.arange(len(q), dtype=np.intp)
    if not steps.size:
        return first
    tree = KDTree(steps)
    # Most groups are small: all rows at once are asked for so many neighbours. The nearest row of
    # each is itself; a place that stays empty has the number of no row.
    at_once, up_to = 8, float(np.nextafter(1.0, 2.0))
    distance, close = tree.query(steps, k=at_once, p=np.inf, distance_upper_bound=up_to)
    waiting = np.append(distance[:, 1] < 1.0, False)
    if not waiting.any():
        return first
    more = np.isfinite(distance[:, -1])
    for row in np.flatnonzero(waiting):
        if waiting[row]:
            near = close[row]
            if more[row]:
                near = np.array(tree.query_ball_point(steps[row], 1.0, p=np.inf))
            near = near[waiting[near]]
            first[near], waiting[near] = row, False
    return np.asarray(np.unique(first, return_inverse=True)[1], dtype=np.intp)


def resolutions(q: FloatArray) -> FloatArray:
    """Step (joints,) of every encoder that readings (n, joints) show, zero where they show none."""
    # A few readings of a fine encoder show that it is, and many take long to sort.
    gaps = np.diff(np.sort(q[:1000], axis=0), axis=0)
    coarse = np.min(gaps, axis=0, where=gaps > 0.0, initial=np.inf) > WANDER
    steps = np.zeros(q.shape[1])
    steps[coarse] = [_resolution(joint) for joint in q.T[coarse]]
    return steps


def _resolution(readings: FloatArray) -> float:
    steps = np.diff(np.sort(readings))
    steps = steps[steps > 0.0]
    smallest = float(steps.min(initial=np.inf))
    multiples = steps / smallest
    # The coarsest step, rad or m: below a thousand to the turn it is the operator who chose round
    # numbers.
    coarse = WANDER < smallest < 2e-3 and len(steps) > 1
    return smallest if coarse and np.abs(multiples - np.round(multiples)).max() < 0.01 else 0.0
