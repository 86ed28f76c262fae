"""How far visits to one point scatter, how well they tell it, and which of two ways is better.

A spread is positive and its estimate is skewed, so everything happens in logarithms: the jackknife
(Efron, Stein 1981, doi:10.1214/aos/1176345462) gives the logarithm's bias and standard error, and
Student's t with as many degrees of freedom as the error itself is worth (Satterthwaite 1946,
doi:10.2307/3002019) gives the factor. It needs no random numbers and no normal distribution.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import stdtrit

from suta_calib.arrays import FloatArray
from suta_calib.batched import Batched
from suta_calib.display import Displayable
from suta_calib.model.arm import ArmModel
from suta_calib.units import Unit

CONFIDENCE: Final = 0.95
# ISO 9283: thirty cycles; and how many standard deviations make a repeatability.
CYCLES: Final = 30
SIGMAS: Final = 3.0
LEAST_VISITS: Final = 3


@dataclass(frozen=True)
class Interval:
    """A confidence interval, in the unit of what it is about."""

    low: float
    high: float

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end."""
        return self.low, self.high

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class ScatterEstimate:
    """A positive number that describes a scatter, and how well it is known.

    Attributes:
        value: as the definition gives it, m or rad.
        log_centre: logarithm of the value with the jackknife's bias taken out; -inf for zero.
        log_std: its standard error; the bias is in it where that is the larger of the two.
        freedom: degrees of freedom of that standard error.
    """

    value: float
    log_centre: float
    log_std: float
    freedom: float

    @property
    def centre(self) -> float:
        """The value with the jackknife's bias taken out."""
        return math.exp(self.log_centre) if math.isfinite(self.log_centre) else self.value

    def interval(self, confidence: float = CONFIDENCE) -> Interval:
        """What the true value lies in, of visits without end under the same conditions."""
        if not math.isfinite(self.log_centre):
            return Interval(self.value, self.value)
        half = _factor(confidence, self.freedom) * self.log_std
        return Interval(math.exp(self.log_centre - half), math.exp(self.log_centre + half))


def spread(statistic: Callable[[FloatArray], float], rows: FloatArray) -> ScatterEstimate:
    """A statistic of rows (n, …), n at least three, with its uncertainty by the jackknife."""
    # More rows than this are left out in blocks of neighbours: the error is known well enough.
    most_parts = 400
    least_freedom = 2.0
    value = statistic(rows)
    parts = np.array_split(np.arange(len(rows)), min(len(rows), most_parts))
    left = np.array([statistic(np.delete(rows, part, axis=0)) for part in parts])
    if value <= 0 or (left <= 0).any():
        return ScatterEstimate(value, -math.inf, 0.0, least_freedom)
    n, logs = len(parts), np.log(left)
    influence = logs - logs.mean()
    power = float(np.sum(influence**2))
    freedom = n - 1.0
    if power > 0:
        # Few large influences make a sum of squares worth little.
        excess = n * float(np.sum(influence**4)) / power**2 - 1.0
        freedom = min(freedom, max(least_freedom, 2.0 * n / max(excess, 1e-12)))
    bias = (n - 1) * (float(logs.mean()) - math.log(value))
    std = math.sqrt((n - 1) / n * power)
    # A bias beyond its error says that the statistic is no smooth one here: of visits to two
    # points, say, whose distances hardly differ. Taken out at its word it would lead away from
    # the value itself.
    std = math.hypot(std, bias) if abs(bias) > std else std
    return ScatterEstimate(value, math.log(value) - bias, std, freedom)


def ratio(
    first: ScatterEstimate, second: ScatterEstimate, confidence: float = CONFIDENCE
) -> Interval:
    """Interval of ``second / first`` for independent visits: Welch's t on the logarithms."""
    if not (math.isfinite(first.log_centre) and math.isfinite(second.log_centre)):
        return Interval(math.nan, math.nan)
    a, b = first.log_std**2, second.log_std**2
    weight = a**2 / first.freedom + b**2 / second.freedom
    freedom = (a + b) ** 2 / weight if weight > 0 else math.inf
    half = _factor(confidence, freedom) * math.sqrt(a + b)
    centre = second.log_centre - first.log_centre
    return Interval(math.exp(centre - half), math.exp(centre + half))


def difference(
    first: ScatterEstimate, second: ScatterEstimate, confidence: float = CONFIDENCE
) -> Interval:
    """Interval of ``second - first`` from both their intervals.

    Zou, Donner (2008), doi:10.1002/sim.3095: each end is as far off as the ends that cause it.
    """
    one, two = first.interval(confidence), second.interval(confidence)
    below = math.hypot(second.centre - two.low, one.high - first.centre)
    above = math.hypot(two.high - second.centre, first.centre - one.low)
    middle = second.centre - first.centre
    return Interval(middle - below, middle + above)


def _factor(confidence: float, freedom: float) -> float:
    return float(stdtrit(freedom, 0.5 + confidence / 2))


@dataclass(frozen=True, eq=False)
class PositionScatter(Displayable):
    """Position repeatability of the tip, ISO 9283:1998, 7.2.2: all lengths in m.

    Attributes:
        count: visits.
        barycentre: (3,) mean position, in the base.
        mean: mean distance to the barycentre.
        std: of these distances, about their mean, with n - 1.
        rp: ``mean + 3 std``, the standard's RP.
        rms: root mean square of the distances.
        maximum: the largest of them.
        axis_std: (3,) standard deviation along the base's axes, with n - 1.
    """

    count: int
    barycentre: FloatArray
    mean: float
    std: float
    rp: ScatterEstimate
    rms: ScatterEstimate
    maximum: float
    axis_std: FloatArray

    @classmethod
    def of(cls, position: FloatArray) -> PositionScatter:
        """Of positions (n, 3), n at least three."""
        size = distances(position)

        def rp(visits: FloatArray) -> float:
            away = distances(visits)
            return float(away.mean() + SIGMAS * away.std(ddof=1))

        def rms(visits: FloatArray) -> float:
            return float(np.sqrt(np.mean(distances(visits) ** 2)))

        return cls(
            len(position),
            position.mean(axis=0),
            float(size.mean()),
            float(size.std(ddof=1)),
            spread(rp, position),
            spread(rms, position),
            float(size.max()),
            position.std(axis=0, ddof=1),
        )


def distances(position: FloatArray) -> FloatArray:
    """Distance (n,) of each position (n, 3) to their barycentre, m."""
    return np.asarray(np.linalg.norm(position - position.mean(axis=0), axis=1))


@dataclass(frozen=True)
class OrientationScatter:
    """Orientation repeatability of the tip, ISO 9283:1998, 7.2.2: angles in rad.

    Attributes:
        rpa, rpb, rpc: three standard deviations of the turn about the tip's x, y and z axis away
            from the mean orientation (the standard states them with ±).
        rms: root mean square of the whole angle.
    """

    rpa: float
    rpb: float
    rpc: float
    rms: float

    @classmethod
    def of(cls, rotation: FloatArray) -> OrientationScatter:
        """Of orientations (n, 3, 3), n at least two."""
        turns = Rotation.from_matrix(rotation)
        away = (turns.mean().inv() * turns).as_rotvec()
        a, b, c = SIGMAS * away.std(axis=0, ddof=1)
        rms = np.sqrt(np.mean(np.sum(away**2, axis=1)))
        return cls(float(a), float(b), float(c), float(rms))


@dataclass(frozen=True)
class JointSpread(Displayable):
    """How far one joint's readings scatter, rad (m for a prismatic joint).

    Attributes:
        joint: its name.
        unit: rad or m.
        std: with n - 1, pooled over points where there are several; three of them are its
            repeatability.
        peak_to_peak: from the smallest to the largest; mean over points where there are several.
        tip: what one standard deviation moves the tip, m.
    """

    joint: str
    unit: Unit
    std: ScatterEstimate
    peak_to_peak: float
    tip: float


@dataclass(frozen=True)
class JointScatter(JointSpread):
    """The same at one point, with the mean reading on the circle."""

    mean: float


def joint_scatter(joint: str, unit: Unit, readings: FloatArray, lever: float) -> JointScatter:
    """Of readings (n,), n at least three; ``lever`` is how far a unit moves the tip, m."""
    mean, away = deviations(readings, unit)
    std = spread(lambda sample: float(sample.std(ddof=1)), away)
    return JointScatter(joint, unit, std, float(np.ptp(away)), lever * std.value, mean)


def tip_levers(arm: ArmModel, q: FloatArray) -> FloatArray:
    """How far each joint moves the tip, (joints,), m per rad (or m): mean over readings (n, j)."""
    batch = Batched(arm.function(arm.offsets), len(q), shared=[0])
    batch.inputs[1][:] = q
    jacobian = batch()[2].reshape(len(q), 6, -1) @ arm.gearing
    return np.asarray(np.linalg.norm(jacobian[:, :3], axis=1).mean(axis=0))


def deviations(readings: FloatArray, unit: Unit) -> tuple[float, FloatArray]:
    """Mean of readings (n,), rad or m, and what each deviates from it: for angles on the circle.

    Angles lie within less than half a turn of each other, across ±π or not.
    """
    if unit == "m":
        return float(readings.mean()), readings - readings.mean()
    middle = float(np.angle(np.mean(np.exp(1j * readings))))
    away = np.angle(np.exp(1j * (readings - middle)))
    return float(np.angle(np.exp(1j * (middle + away.mean())))), away - away.mean()


def departures(q: FloatArray, units: Iterable[Unit]) -> FloatArray:
    """(n, joints) what readings (n, joints) deviate from the means of their columns."""
    columns = zip(q.T, units, strict=True)
    return np.stack([deviations(readings, unit)[1] for readings, unit in columns], axis=1)


def median_angle(readings: FloatArray) -> float:
    """An angle in the middle of most readings (n,), rad, wherever on the circle they lie."""
    return float(np.angle(np.median(np.cos(readings)) + 1j * np.median(np.sin(readings))))


@dataclass(frozen=True)
class ScatterChange(Displayable):
    """One figure under two protocols.

    Attributes:
        first, second: its values, m, or rad for a joint that turns.
        ratio: interval of second / first; one inside means that none was proved better.
        difference: interval of second - first, likewise.
    """

    first: float
    second: float
    ratio: Interval
    difference: Interval

    @property
    def factor(self) -> float | None:
        """Second over first; None where the first is zero."""
        return self.second / self.first if self.first else None

    @property
    def proved(self) -> bool:
        """Whether the two differ by more than so few visits would by chance."""
        return 1.0 not in self.ratio


@dataclass(frozen=True)
class ProtocolComparison(Displayable):
    """Two protocols, visits of each about their own barycentre.

    Attributes:
        first, second: their labels.
        rp: position repeatability, ISO 9283:1998, 7.2.2.
        rms: root mean square of the distances.
        joints: standard deviation of each joint's readings, by its name.
    """

    first: str
    second: str
    rp: ScatterChange
    rms: ScatterChange
    joints: Mapping[str, ScatterChange]


def compare_protocols(
    first: str,
    one: PositionScatter,
    second: str,
    two: PositionScatter,
    confidence: float,
    joints: Iterable[tuple[JointScatter, JointScatter]] = (),
) -> ProtocolComparison:
    """Compare two independent sets of visits, and each joint's scatter in the one and the other."""

    def change(a: ScatterEstimate, b: ScatterEstimate) -> ScatterChange:
        return ScatterChange(
            a.value, b.value, ratio(a, b, confidence), difference(a, b, confidence)
        )

    return ProtocolComparison(
        first,
        second,
        change(one.rp, two.rp),
        change(one.rms, two.rms),
        {a.joint: change(a.std, b.std) for a, b in joints},
    )


def joints_rms(joints: Iterable[JointSpread]) -> float | None:
    """Root mean square over the joints that turn of their standard deviations, rad; None for none.

    One figure for a whole arm, as reports of measuring arms give it. It weighs a joint near the tip
    like one at the base: what scatter does to the tip is in `JointSpread.tip`.
    """
    turning = [joint.std.value for joint in joints if joint.unit == "rad"]
    return float(np.sqrt(np.mean(np.square(turning)))) if turning else None
