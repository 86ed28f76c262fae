"""Encoder sanity: noise, steps, drift and Allan deviation of every joint of an arm at rest.

Overlapping Allan deviation: how much two successive averages over a time τ differ.

Allan (1966), doi:10.1109/PROC.1966.4634; formulas as in Riley (2008), Handbook of Frequency
Stability Analysis, NIST SP 1065, with a joint's reading in place of the fractional frequency. White
noise falls with 1/√τ, a drift rises with τ; the minimum tells how long averaging helps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.special import chdtri, stdtrit

from suta_calib.analysis.repeatability.scatter import deviations, median_angle
from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.atomic import note_input
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError, did_you_mean
from suta_calib.measurements.csv_table import CsvTable, read_csv_table
from suta_calib.optional_packages import load
from suta_calib.units import Unit, from_deg

_CONFIDENCE: Final = 0.95
# Columns of recordings that are no joints.
NO_JOINTS: Final = frozenset(
    (
        *("sequence", "time", "host_time", "arrival", "x", "y", "z", "qx", "qy", "qz", "qw"),
        *("std_x", "std_y", "std_z", "valid", "flags", "errors", "direction", "protocol"),
    )
)
_PARQUET: Final = (".parquet", ".pq")


@dataclass(frozen=True, eq=False)
class AllanDeviation(Displayable):
    """Overlapping Allan deviation of readings at a steady rate.

    Attributes:
        tau: (k,) averaging times, s, increasing.
        deviation: (k,) in the unit of the readings.
        low, high: (k,) 95 % interval, exact for white noise.
    """

    tau: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def best(self) -> int:
        """Index of the smallest deviation: averaging longer helps no more."""
        return int(np.argmin(self.deviation))

    @property
    def bottomed(self) -> bool:
        """Whether it rises again beyond the smallest, so that the record shows the best time."""
        return bool((self.low[self.best :] > self.deviation[self.best]).any())


def allan_deviation(readings: FloatArray, period: float) -> AllanDeviation:
    """Of readings (n,) every ``period`` s, n at least 18, at some eight times in a decade."""
    n = len(readings)
    # Of a record shorter than this many averages little is known.
    decades = np.log10(n // 9)
    per_decade = 8
    sizes = np.unique(np.logspace(0, decades, int(per_decade * decades) + 1).astype(int))
    sums = np.concatenate([[0.0], np.cumsum(readings - readings.mean())])
    deviation = np.array([overlapping(sums, int(m)) for m in sizes])
    # Degrees of freedom for white noise of the readings, NIST SP 1065, table 5.
    terms = 3 * (n - 1) / (2 * sizes) - 2 * (n - 2) / n
    freedom = terms * 4 * sizes**2 / (4 * sizes**2 + 5)
    tail = (1 - _CONFIDENCE) / 2
    return AllanDeviation(
        period * sizes,
        deviation,
        deviation * np.sqrt(freedom / chdtri(freedom, tail)),
        deviation * np.sqrt(freedom / (chdtri(freedom, 1.0 - tail))),
    )


def overlapping(sums: FloatArray, size: int) -> float:
    """Overlapping Allan deviation for averages over ``size`` readings, from their sums (n + 1,)."""
    averages = sums[size:] - sums[:-size]
    steps = averages[size:] - averages[:-size]
    return float(np.sqrt(0.5 * (steps @ steps) / len(steps))) / size


@dataclass(frozen=True, eq=False)
class JointNoise(Displayable):
    """One joint at rest, rad (m for a prismatic joint).

    Attributes:
        joint: its name.
        unit: rad or m.
        mean: of the readings, on the circle.
        std: standard deviation of one reading, with n - 1.
        std_detrended: the same with a straight line taken out.
        std_short: of one reading from differences of neighbours, which no drift reaches.
        peak_to_peak: from the smallest to the largest.
        left_out: grossly wrong readings that count in no other figure.
        levels: how many different readings there are.
        step: smallest step of the encoder, where it shows; None where noise hides it.
        drift: slope, per s.
        drift_half: half the 95 % interval of the slope, correlated noise accounted for, per s.
        batch_range: how far the means of twenty parts of the record lie apart.
        allan: Allan deviation.
    """

    joint: str
    unit: Unit
    mean: float
    std: float
    std_detrended: float
    std_short: float
    peak_to_peak: float
    left_out: int
    levels: int
    step: float | None
    drift: float
    drift_half: float
    batch_range: float
    allan: AllanDeviation

    @property
    def moved(self) -> bool:
        """Whether the joint was not at rest."""
        return self.batch_range > {"rad": from_deg(0.5), "m": 1e-3}[self.unit]

    @property
    def drifts(self) -> bool:
        """Whether the slope is more than correlated noise gives to any joint of an arm."""
        # Half intervals of 95 % that noise all but never exceeds, on however many joints.
        return abs(self.drift) > 2.0 * self.drift_half

    @property
    def stuck(self) -> bool:
        """Whether the reading never changed."""
        return self.levels == 1


@dataclass(frozen=True, eq=False)
class Stationary(Displayable):
    """A stationary stream, joint by joint.

    Attributes:
        stream: what was looked at.
        joints: in the order of its columns.
        tip_std: what the readings' noise does to the tip, m (3-D); None without an arm.
    """

    stream: Stream
    joints: tuple[JointNoise, ...]
    tip_std: float | None = None

    @property
    def seconds(self) -> float:
        """Length of the record, s."""
        return float(self.stream.time[-1] - self.stream.time[0])

    @property
    @judged
    def assessment(self) -> Assessment:
        """Whether the arm was at rest, with notes on the encoders."""
        worst = max(self.joints, key=lambda joint: joint.std_detrended)
        sentence = (
            f"{len(self.stream.time)} readings in {self.seconds:.1f} s at "
            f"{1 / self.stream.period:.4g} Hz; most noise: {worst.joint}"
        )

        def which(quality: str) -> str:
            return ", ".join(joint.joint for joint in self.joints if getattr(joint, quality))

        if names := which("moved"):
            return Assessment.of(
                sentence,
                bad=[
                    f"{names} moved, so these figures are not noise. Measure again "
                    "with the arm at rest."
                ],
            )
        notes = []
        if names := which("stuck"):
            notes.append(
                f"{names} never changed: the noise is below one step, or the encoder does not work."
            )
        if names := which("drifts"):
            notes.append(f"{names} drifts by more than its noise explains.")
        if gross := [
            f"{joint.joint} ({joint.left_out})" for joint in self.joints if joint.left_out
        ]:
            notes.append(f"Grossly wrong readings were left out: {', '.join(gross)}.")
        if self.stream.gaps:
            notes.append(
                f"{self.stream.gaps} gaps in time: the averaging times are valid for a recording "
                "without gaps."
            )
        if self.stream.dropped:
            notes.append(
                f"{self.stream.dropped} rows were not used: not valid, or with an error flag."
            )
        return Assessment.of(sentence, care=notes)


@checked
def stationary(
    stream: Stream, units: Sequence[Unit] | None = None, levers: FloatArray | None = None
) -> Stationary:
    """Analyse every joint of a stationary stream.

    Args:
        stream: the readings.
        units: of each joint; rad where not given.
        levers: (joints,) how far each joint moves the tip, m per rad or m.
    """
    each_unit: Sequence[Unit] = ["rad"] * len(stream.joints) if units is None else units
    columns = zip(stream.joints, each_unit, stream.readings.T, strict=True)
    joints = tuple(_joint(*column, stream.time, stream.period) for column in columns)
    if levers is None:
        return Stationary(stream, joints)
    # Encoders are read one by one: their noise has nothing in common.
    noise = np.array([joint.std for joint in joints])
    return Stationary(stream, joints, float(np.linalg.norm(levers * noise)))


def _joint(
    joint: str, unit: Unit, readings: FloatArray, time: FloatArray, period: float
) -> JointNoise:
    # Readings farther out than this many robust standard deviations, and steps, are gross errors.
    gross = 8.0
    normal = 1.4826
    off = readings - (median_angle(readings) if unit == "rad" else np.median(readings))
    off = np.angle(np.exp(1j * off)) if unit == "rad" else off
    size = np.abs(off - np.median(off))
    # If most readings are equal, the median deviation is zero and cannot be used.
    scale = max(normal * float(np.median(size)), float(np.quantile(size, 0.99)) / 3)
    inliers = size <= gross * scale + 1e-12
    mean, away = deviations(readings[inliers], unit)
    moment = time[inliers]
    levels, step = _steps(readings[inliers])
    slope, half, batch_range = _drift(moment, away)
    line = np.polynomial.Polynomial.fit(moment, away, 1)
    return JointNoise(
        joint,
        unit,
        mean,
        float(away.std(ddof=1)),
        float((away - line(moment)).std(ddof=2)),
        float(np.sqrt(np.mean(np.diff(away) ** 2) / 2)),
        float(np.ptp(away)),
        int(np.sum(~inliers)),
        levels,
        step,
        slope,
        half,
        batch_range,
        allan_deviation(away, period),
    )


def _steps(readings: FloatArray) -> tuple[int, float | None]:
    """How many different readings there are, and the step between them where it shows."""
    levels = np.unique(readings)
    # An encoder's steps are seen where every level occurs this often.
    if len(levels) < 2 or 4 * len(levels) > len(readings):
        return len(levels), None
    gaps = np.diff(levels)
    gaps = gaps[gaps < np.pi]
    if not len(gaps):
        return len(levels), None
    counts = np.round(gaps / gaps.min())
    step = float(gaps.sum() / counts.sum())
    # Levels are whole steps apart, to a tenth of one.
    multiples = np.abs(gaps / step - np.round(gaps / step)).max() < 0.1
    return len(levels), step if multiples else None


def _drift(time: FloatArray, away: FloatArray) -> tuple[float, float, float]:
    """Slope per s, half its 95 % interval, and how far apart the batches' means are.

    The slope is that of the means of twenty batches: whatever correlates within a batch shows in
    how its mean scatters, so that correlated noise makes the interval as wide as it should be.
    """
    # Of the drift: few batches, so that each is longer than what correlates within it.
    batch_count = 20
    batches = np.array_split(np.arange(len(time)), batch_count)
    moment, mean = (np.array([v[rows].mean() for rows in batches]) for v in (time, away))
    (slope, _), covariance = np.polyfit(moment - moment.mean(), mean, 1, cov=True)
    half = stdtrit(batch_count - 2, 0.5 + _CONFIDENCE / 2) * np.sqrt(covariance[0, 0])
    return float(slope), float(half), float(np.ptp(mean))


@dataclass(frozen=True, eq=False)
class Stream(Displayable):
    """Readings over time.

    Attributes:
        path: the file.
        joints: names of the columns.
        time: (n,) s, increasing.
        readings: (n, joints) rad or m.
        dropped: rows left out, because they are not valid or carry an error flag.
    """

    path: Path
    joints: tuple[str, ...]
    time: FloatArray
    readings: FloatArray
    dropped: int

    @property
    def period(self) -> float:
        """Median time between readings, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def gaps(self) -> int:
        """How many steps in time are longer than one and a half periods."""
        return int(np.sum(np.diff(self.time) > 1.5 * self.period))


@checked
def read_stream(path: str | Path, joints: Sequence[str] = ()) -> Stream:
    """Read a stationary stream.

    Args:
        path: CSV, or Parquet by its name (``.parquet``).
        joints: columns to read; where none are given, all that hold numbers and are no column of
            a recording by another name.

    Raises:
        SamplesError: unreadable, no column ``time`` or no joint, a value that is not a number,
            readings that can only be degrees, time that does not increase, fewer than 100 rows.
        MissingExtraError: a Parquet file, and pyarrow is not installed.
    """
    path = Path(path)
    table = read_parquet(path) if path.suffix.lower() in _PARQUET else read_csv_table(path)
    names = tuple(joints) or tuple(n for n in table.columns if n not in NO_JOINTS)
    if not names:
        raise SamplesError(
            f"only the columns {', '.join(table.columns)}",
            "one column per joint, in rad",
            file=path,
        )
    valid = table.valid()
    least_rows = 100
    if len(valid) < least_rows:
        raise SamplesError(
            f"{len(valid)} valid rows", f"at least {least_rows}: record for some seconds", file=path
        )
    time = valid.time("times of a single clock")
    readings = np.stack([valid.numbers(n, "one column per joint, in rad") for n in names], axis=1)
    largest_angle = 8 * np.pi
    for row, column in np.argwhere(np.abs(readings) > largest_angle):
        value = f"{readings[row, column]:.6g}"
        hint = "this looks like degrees or counts: convert it"
        raise valid.refuse(int(row), names[column], value, "rad", hint)
    return Stream(path, names, time, readings, len(table) - len(valid))


def read_parquet(path: Path) -> CsvTable:
    """A Parquet file as the table a CSV file would give; a row's number stands for its line."""
    arrow, parquet = load("pyarrow", "parquet"), load("pyarrow.parquet", "parquet")
    note_input(path)
    try:
        columns = parquet.read_table(path).to_pydict()
    except FileNotFoundError:
        raise SamplesError("no such file", "a file that exists", file=path) from None
    except (OSError, arrow.ArrowException) as problem:
        reason = str(problem).splitlines()[0]
        raise SamplesError(
            f"a damaged or incomplete Parquet file ({reason})", "a Parquet file", file=path
        ) from None
    if "time" not in columns:
        raise SamplesError(
            f"only the columns {', '.join(columns)}",
            "a column time, in s",
            file=path,
            hint=did_you_mean("time", columns),
        )
    # `str` of a float is its shortest exact form.
    texts = {n: tuple("" if v is None else str(v) for v in vs) for n, vs in columns.items()}
    return CsvTable(path, texts, 1, tuple(range(1, len(texts["time"]) + 1)))
