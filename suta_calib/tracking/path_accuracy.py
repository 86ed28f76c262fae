"""How well a recorded motion follows a reference: distance, lateness, and turning back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, judged
from suta_calib.geometry.numbers import extent
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.alignment import Alignment, ReferencePath, align, rigid_motions
from suta_calib.tracking.errors_in_time import ErrorsInTime, per_axis
from suta_calib.tracking.record_faults import RecordFault, record_faults
from suta_calib.tracking.reversals import (
    ChannelReversals,
    axis_channels,
    find_reversals,
    joint_channels,
    placement_errors,
)
from suta_calib.tracking.trajectory import Trajectory
from suta_calib.units import mm, ms
from suta_calib.words import listed

# Update rates of optical trackers, Hz, and of one that is read as the SUTA's encoders are.
UPDATE_RATES: Final = (60.0, 120.0, 768.0)


@dataclass(frozen=True)
class MotionQuarter:
    """A quarter of the rows, by how fast the reference moved or gained speed.

    Attributes:
        low, high: of its speeds, m/s, or accelerations, m/s².
        rms: root mean square distance from the reference, latency taken out, m.
        std: standard deviation of ``rms``, m, from stretches of time left out one by one
            (jackknife); NaN where it is seen in fewer than three of them.
        rms_same_time: the same distance at one and the same time, m.
    """

    low: float
    high: float
    rms: float
    std: float
    rms_same_time: float


@dataclass(frozen=True, eq=False)
class PathAccuracy:
    """The answer of `compare`, over the rows of `Alignment.rows`.

    Attributes:
        recorded, reference: what was compared.
        alignment: latency and transform, with what hysteresis explains taken out of the latency.
        reversals: per joint, or per axis of the recording where nothing is known of joints.
        per: which of the two.
        hysteresis: by joint, and its standard uncertainty, rad or m; only those that turn back.
        faults: of the record itself, each as it is without those before it.
    """

    recorded: Trajectory
    reference: Trajectory
    alignment: Alignment
    reversals: tuple[ChannelReversals, ...]
    per: Literal["joint", "axis"]
    hysteresis: dict[str, tuple[float, float]]
    faults: tuple[RecordFault, ...] = ()

    @property
    def time(self) -> FloatArray:
        """(m,) s."""
        return self.recorded.time[self.alignment.rows]

    @cached_property
    def error_same_time(self) -> FloatArray:
        """(m, 3) recorded minus reference at one and the same time, in the reference's frame."""
        return self._error(0.0)

    @cached_property
    def error(self) -> FloatArray:
        """(m, 3) the same with the latency taken out."""
        return self._error(self.alignment.latency)

    @cached_property
    def path_error(self) -> FloatArray:
        """(m,) distance across the direction of motion; from the point where it stands still."""
        velocity = self._path.velocity(self.time - self.alignment.latency)
        speed = np.linalg.norm(velocity, axis=1)
        # Of the fastest, below which a direction of motion means nothing.
        moving = speed > 0.02 * speed.max()
        direction = velocity / np.where(moving, speed, np.inf)[:, None]
        along = np.einsum("nk,nk->n", self.error, direction)
        return np.asarray(np.linalg.norm(self.error - along[:, None] * direction, axis=1))

    @cached_property
    def angle_error(self) -> FloatArray | None:
        """(m,) rad, latency taken out; None where not both files have orientations."""
        if self.recorded.rotation is None or self.reference.rotation is None:
            return None
        truth = Slerp(self.reference.time, Rotation.from_matrix(self.reference.rotation))
        rotation = self.alignment.rotation @ self.recorded.rotation[self.alignment.rows]
        turned = truth(self.time - self.alignment.latency).inv() * Rotation.from_matrix(rotation)
        return np.asarray(turned.magnitude())

    @cached_property
    def by_speed(self) -> tuple[MotionQuarter, ...]:
        """Errors by the speed of the reference, slowest quarter first."""
        return self._quarters(self._path.velocity(self.time - self.alignment.latency))

    @cached_property
    def by_acceleration(self) -> tuple[MotionQuarter, ...]:
        """Errors by the size of the reference's acceleration, smallest quarter first."""
        return self._quarters(self._path.acceleration(self.time - self.alignment.latency))

    def _quarters(self, vectors: FloatArray) -> tuple[MotionQuarter, ...]:
        size = np.linalg.norm(vectors, axis=1)
        order = np.argsort(size, kind="stable")
        squares = np.sum(self.error**2, axis=1), np.sum(self.error_same_time**2, axis=1)
        stretch = _stretches(len(size))
        return tuple(
            MotionQuarter(
                float(size[rows[0]]),
                float(size[rows[-1]]),
                float(np.sqrt(squares[0][rows].mean())),
                _jackknife(squares[0][rows], stretch[rows]),
                float(np.sqrt(squares[1][rows].mean())),
            )
            for rows in np.array_split(order, 4)
            if len(rows)
        )

    def staleness(self, rate: float) -> float:
        """How far the reference has moved on, RMS in m, from the last pose of a slower tracker.

        A pose that is shown until the next one comes is between nothing and one period old; at a
        steady speed v that is ``v / (rate √3)``, whatever else the tracker errs by.

        Args:
            rate: of updates, Hz.
        """
        ages = (np.arange(8) + 0.5) / (8 * rate)
        time = self.time[self.time - ages[-1] >= self._path.begin]
        time = time[time <= self._path.end]
        here = self._path.position(time)
        moved = [np.sum((here - self._path.position(time - age)) ** 2, axis=1) for age in ages]
        return float(np.sqrt(np.mean(moved)))

    @property
    def _other_unit(self) -> str:
        """What is said where one motion is as much larger as millimetres are than metres."""
        there, here = extent(self.reference.position), self.alignment.motion
        larger = max(there, here) / max(min(there, here), 1e-12)
        if not 500 < larger < 2000:
            return ""
        which = "reference" if there > here else "recording"
        return (
            f"The motion of the {which} is {larger:.0f} times as large as that of the other. "
            "Check whether one of them is in mm: columns x, y, z are in m, and x_mm, y_mm, z_mm "
            "in mm."
        )

    @property
    @judged
    def assessment(self) -> Assessment:
        """Bad where the motions do not tell the latency, or the recording does not follow."""
        alignment, bad, care = self.alignment, list[str](), list[str]()
        moved, left = mm(alignment.motion), mm(alignment.left)
        follows = left <= 0.5 * moved
        if alignment.other_axes:
            bad.append(
                f"If its axes are taken as {alignment.other_axes}, the recording follows the "
                "reference far better: axes are exchanged or reversed in one of the files."
            )
        elif not follows and (unit := self._other_unit):
            bad.append(unit)
        elif not follows:
            bad.append(
                f"The recording moves by {moved:.3f} mm (RMS) about its mean, but differs by "
                f"{left:.3f} mm from the reference. Either it contains only noise, or it follows "
                "something else, or the files are in different frames (--register). Record a "
                "motion larger than the noise."
            )
        elif alignment.at_the_end:
            bad.append(
                f"The latency is at the end of the searched range (± {alignment.shifts[-1]:g} "
                "s). The true one may be larger: raise --max-latency."
            )
        elif alignment.as_good:
            latencies = listed([f"{ms(latency):.1f}" for latency in alignment.as_good])
            spacing = min(abs(other - alignment.latency) for other in alignment.as_good)
            bad.append(
                f"The motion repeats itself: latencies of {latencies} ms explain it as well as "
                f"{ms(alignment.latency):.1f} ms. Record a motion that does not repeat, or, if "
                f"you know that the latency is less than {0.9 * spacing / 2:.2g} s, give this as "
                "--max-latency."
            )
        elif self.undetermined:
            bad.append(
                "The motion does not determine the latency: it is too slow compared with the "
                "remaining distance, or the files are in different frames (--register)."
            )
        for fault in self.faults:
            (bad if fault.spoils else care).append(fault.sentence)
        if not any(channel.reversals for channel in self.reversals):
            care.append(f"No {self.per} reverses its motion, so hysteresis cannot be determined.")
        elif self.per == "axis":
            care.append(
                "Without joints (--urdf, and their columns in the recording) hysteresis cannot "
                "be separated from latency: the latency includes it."
            )
        return Assessment.of(bad=bad, care=care)

    @property
    def undetermined(self) -> bool:
        """Whether the latency's uncertainty is as large as what was looked at."""
        # Uncertainty of the latency, of the largest looked at, that says nothing is known.
        return bool(self.alignment.latency_std > 0.2 * abs(self.alignment.shifts[-1]))

    @cached_property
    def _path(self) -> ReferencePath:
        return ReferencePath(self.reference)

    def _error(self, latency: float) -> FloatArray:
        moved = self.alignment.act(self.recorded.position[self.alignment.rows])
        return np.asarray(moved - self._path.position(self.time - latency))


def _jackknife(squares: FloatArray, stretch: IntArray) -> float:
    """Standard deviation of the root mean of squares (n,), m, over the stretches they are from."""
    names = np.unique(stretch)
    n = len(names)
    if n < 3:
        return float("nan")
    without = np.array([np.sqrt(squares[stretch != name].mean()) for name in names])
    return float(np.sqrt((n - 1) / n * np.sum((without - without.mean()) ** 2)))


def _stretches(rows: int) -> IntArray:
    """Which of twelve stretches of time, taken for independent, each row is in."""
    return np.arange(rows, dtype=np.intp) * 12 // max(rows, 1)


def compare(
    recorded: Trajectory,
    reference: Trajectory,
    arm: ArmModel | None = None,
    *,
    registered: bool = False,
    largest_latency: float = 0.5,
) -> PathAccuracy:
    """Compare a recorded motion with a reference.

    Hysteresis looks like latency while a joint moves, and what the arm's geometry still gets wrong
    looks like hysteresis where few reversals are: latency, hysteresis, geometry and the transform
    are estimated together.

    Args:
        recorded: what is judged.
        reference: what is held to be true.
        arm: for hysteresis per joint; its joints must be in the recording, which is in the frame
            of its base.
        registered: whether the frames differ: then the transform between them is found too.
        largest_latency: of either sign, s.

    Raises:
        SamplesError: no common time, a reference that does not move, frames that the points do
            not determine.
    """
    by_joint = arm is not None and recorded.angles is not None
    channels = joint_channels(arm, recorded) if arm and by_joint else axis_channels(recorded)
    errors, judged = None, list[ChannelReversals]()
    if arm and by_joint:
        turning = (find_reversals(c, recorded.time, recorded.position) for c in channels)
        # Reversals from which on a joint's hysteresis can be told from an offset.
        judged = [t for t in turning if len(t.reversals) >= 2]
        # Of the tip for unit hysteresis of each judged joint, then for those of the geometry.
        lags = [-0.5 * t.sense[:, None, None] * t.channel.lever[:, :, None] for t in judged]
        errors = np.concatenate([*lags, placement_errors(arm, recorded)], axis=2)
    alignment = align(
        recorded, reference, registered=registered, largest=largest_latency, errors=errors
    )
    # Latency taken out, along the recording's axes; NaN where there is no reference.
    rows, error = alignment.rows, np.full((len(recorded.time), 3), np.nan)
    truth = ReferencePath(reference).position(recorded.time[rows] - alignment.latency)
    error[rows] = (alignment.act(recorded.position[rows]) - truth) @ alignment.rotation
    sizes = zip(alignment.sizes.tolist(), alignment.sizes_std.tolist(), strict=True)
    accuracy = PathAccuracy(
        recorded,
        reference,
        alignment,
        tuple(find_reversals(c, recorded.time, error) for c in channels),
        "joint" if by_joint else "axis",
        dict(zip([t.channel.name for t in judged], sizes, strict=False)),
    )
    return replace(accuracy, faults=_faults(accuracy, errors))


def _faults(accuracy: PathAccuracy, errors: FloatArray | None) -> tuple[RecordFault, ...]:
    """Of the record; errors (n, 3, k) of known shapes are along the recording's axes."""
    alignment, rows = accuracy.alignment, accuracy.alignment.rows
    path, late = ReferencePath(accuracy.reference), accuracy.time - alignment.latency
    position = alignment.act(accuracy.recorded.position[rows])
    none = np.zeros((len(rows), 3, 0))
    # Where nothing is known of joints, each axis may err by which way it went.
    senses = np.column_stack([channel.sense[rows] for channel in accuracy.reversals])
    record = ErrorsInTime(
        time=accuracy.time,
        error=accuracy.error,
        recorded=position,
        reference=path.position(late),
        velocity=path.velocity(late),
        transform=rigid_motions(position) if alignment.registered else none,
        known_shapes=none if errors is None else -alignment.rotation @ errors[rows],
        honest=per_axis(senses) if errors is None else none,
        interval=float(np.median(np.diff(accuracy.reference.time))),
        late=lambda delay: (path.position(late - delay), path.velocity(late - delay)),
    )
    return record_faults(
        record,
        accuracy.recorded,
        rows,
        (alignment.latency, alignment.latency_std),
        lambda squares: _jackknife(squares, _stretches(len(squares))),
    )
