"""What drifts while an arm is tracked: the zeros of its encoders, from touches of known points.

A touch of a point that does not move says that ``f(q) + A u + B δ = p + e``: f is the tip of the
calibrated arm, u its calibration's own error (normal, by the result's covariance), δ what the zeros
have drifted by, p the point and e how the tip meets it. u and p stay, δ is a bounded random walk
(`bounded_walk`). The calibration is never changed: what is found stands beside the pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.batched import Batched
from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import skew
from suta_calib.measurements.fields import (
    ANGLE,
    LENGTH,
    XYZ_MM,
    Value,
    fields_of,
    keyed,
    mapping,
    quantity,
    read_as,
)
from suta_calib.measurements.yaml_file import YamlSection, read_yaml
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import BACKLASH, HYSTERESIS, OFFSET
from suta_calib.tracking.bounded_walk import BoundedWalk, Innovation
from suta_calib.tracking.tracker import NO_TOOL, Tool
from suta_calib.tracking.uncertainty import CalibrationUncertainty
from suta_calib.units import deg, from_deg, mm, with_std
from suta_calib.words import listed


@dataclass(frozen=True)
class DriftSpec(Displayable):
    """What may drift, and how far: the key ``drift``."""

    zeros: float = keyed(
        ANGLE, "Standard deviation of the drift of a joint's zero; default: 0.1.", from_deg(0.1)
    )
    hours: float = keyed(
        quantity(sign="positive"),
        "Time constant: after so long a drift is another one; default: 2.",
        2.0,
    )
    per_kelvin: float = keyed(
        quantity("rad", "non-negative"),
        "Standard deviation of the drift of a zero per kelvin, if the device sends a column "
        "temperature; default: none.",
        0.0,
        "zeros_deg_per_kelvin",
    )


@dataclass(frozen=True, eq=False)
class KnownPoint(Displayable):
    """A point that does not move, in the base, which the tip touches again and again."""

    position: FloatArray = keyed(XYZ_MM, "Its place in the base.")
    sigma: float = keyed(
        LENGTH, "How well this place is known, per axis; default: 1. The touches correct it.", 1e-3
    )


def _read_points(section: YamlSection, key: str) -> dict[str, KnownPoint]:
    points = section.section(key)
    return {str(name): read_as(KnownPoint, points.section(str(name))) for name in points.data}


@dataclass(frozen=True)
class RecalibrationSpec(Displayable):
    """A file of points, and of what may drift."""

    points: Mapping[str, KnownPoint] = keyed(
        Value("points by name", _read_points, fields_of(KnownPoint)),
        "Points that do not move, such as a socket in which the tip is put down.",
    )
    sigma: float = keyed(LENGTH, "How well the tip meets a point, per axis; default: 0.1.", 1e-4)
    reach: float = keyed(LENGTH, "A rest so near to a point is a touch of it; default: 5.", 5e-3)
    drift: DriftSpec = keyed(
        mapping(DriftSpec), "What may drift while the arm is tracked.", DriftSpec()
    )


@dataclass(frozen=True, eq=False)
class Touch(Displayable):
    """What one touch said.

    Attributes:
        point: its name.
        time: s, of the caller's clock.
        off: how far the tip was from where the estimate so far had it, m.
        innovation: the same in units of what was expected.
        used: whether it was taken in.
    """

    point: str
    time: float
    off: float
    innovation: Innovation
    used: bool


class Recalibration(Displayable):
    """The drift of a calibrated arm's zeros, touch by touch.

    For example::

        live = Recalibration(arm, uncertainty, RecalibrationSpec({"dock": point}))
        live.touch("dock", angles, time)
        live.zeros["joint_2"]             # drift and ±, rad
        shift, std = live.correction(angles)

    Args:
        arm: as it is calibrated.
        uncertainty: of its calibration; None for one without error.
        spec: the points, and what may drift.
        tool: on the tip.

    Attributes:
        touches: all so far.
        alarms: sentences, each said once.

    Raises:
        InputError: no points, or joints that lag behind their readings.
    """

    def __init__(
        self,
        arm: ArmModel,
        uncertainty: CalibrationUncertainty | None,
        spec: RecalibrationSpec,
        tool: Tool = NO_TOOL,
    ) -> None:
        if not spec.points:
            raise InputError("no points", "one point or more that does not move", where="points")
        self.arm, self.spec, self._tool = arm, spec, tool
        names, factor = ((), np.zeros((0, 0))) if uncertainty is None else uncertainty.folded(arm)
        beside = {} if uncertainty is None else uncertainty.beside_geometry
        if lags := [n for n in beside if arm.offered[n].key in (BACKLASH, HYSTERESIS)]:
            raise InputError(listed(lags), "an arm whose joints do not lag", where="--recalibrate")
        self._zeros = [f"{joint}.{OFFSET}" for joint in arm.joints]
        unknowns = [*names, *self._zeros]
        self._tip = Batched(arm.function(unknowns), 1)
        self._tip.inputs[0][0] = [beside.get(n, arm.offered[n].nominal) for n in unknowns]
        # Calibration, zeros, zeros per kelvin, points.
        sizes = (factor.shape[1], len(arm.joints), len(arm.joints), 3 * len(spec.points))
        ends = np.cumsum(sizes)
        self._calibration, self._drift, self._warmth, self._points = (
            slice(end - size, end) for size, end in zip(sizes, ends, strict=True)
        )
        self._factor = factor
        stds, drifting = np.ones(ends[-1]), np.zeros(ends[-1])
        drifting[self._drift] = stds[self._drift] = spec.drift.zeros
        stds[self._warmth] = spec.drift.per_kelvin
        stds[self._points] = np.repeat([point.sigma for point in spec.points.values()], 3)
        self.estimate = BoundedWalk(np.diag(stds**2), drifting, 3600.0 * spec.drift.hours)
        self.touches: list[Touch] = []
        self.alarms: list[str] = []
        self._said = set[str]()
        self._time: float | None = None
        self._cold: float | None = None

    def tip(self, angles: FloatArray) -> FloatArray:
        """(3,) where the calibrated arm has the tip, m."""
        return self._at(angles, 0.0)[0]

    def nearest(self, angles: FloatArray) -> str | None:
        """The point that a rest at these readings touches, if it is within reach of one."""
        tip, reach = self.tip(angles), self.spec.reach
        away = {n: float(np.linalg.norm(tip - p.position)) for n, p in self.spec.points.items()}
        name = min(away, key=lambda point: away[point])
        return name if away[name] < max(reach, 3.0 * self.spec.points[name].sigma) else None

    def touch(
        self, point: str, angles: FloatArray, time: float, temperature: float | None = None
    ) -> Touch:
        """Take in that the tip is on a point.

        Args:
            point: its name.
            angles: (n,) readings, rad.
            time: s, of any clock that does not go back.
            temperature: of the arm, °C, where it is known.

        Raises:
            InputError: there is no such point.
        """
        if point not in self.spec.points:
            expected = f"one of {listed([*self.spec.points])}"
            raise InputError(f"the point {point!r}", expected, where="points")
        if self._time is not None:
            self.estimate.advance(time - self._time)
        self._time = time if self._time is None else max(time, self._time)
        place = [*self.spec.points].index(point)
        tip, slope = self._at(angles, self._warmer(temperature))
        slope[:, self._points][:, 3 * place : 3 * place + 3] = -np.eye(3)
        residual = self.spec.points[point].position - tip
        noise = self.spec.sigma**2 * np.eye(3)
        innovation, _ = self.estimate.expected(slope, residual, noise)
        off = float(np.linalg.norm(residual - slope @ self.estimate.mean))
        # Chance of a touch so far off, if only the zeros drift as assumed. Such a touch is not
        # taken in; two in a row, at any points, are no accident.
        used = innovation.p >= 1e-4
        if used:
            self.estimate.update(slope, residual, noise)
        touch = Touch(point, time, off, innovation, used)
        self.touches.append(touch)
        self._look(touch)
        return touch

    @property
    def zeros(self) -> dict[str, tuple[float, float]]:
        """Drift of each joint's zero and its standard deviation, rad, as of the last touch.

        It is added to the reading, as an offset is.
        """
        stds = np.sqrt(np.diag(self.estimate.covariance))[self._drift]
        pairs = zip(self.estimate.mean[self._drift], stds, strict=True)
        return {j: (float(m), float(s)) for j, (m, s) in zip(self.arm.joints, pairs, strict=True)}

    def correction(
        self, angles: FloatArray, temperature: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """What the touches would add to the tip's position (3,), m, and ± of the corrected (3,), m.

        Before the first touch that is nothing, and the ± of calibration and prior drift.
        """
        _, slope = self._at(angles, self._warmer(temperature))
        spread = slope @ self.estimate.covariance @ slope.T
        return slope @ self.estimate.mean, np.sqrt(np.diag(spread))

    def as_dict(self) -> dict[str, Any]:
        """As JSON data."""
        used = sum(touch.used for touch in self.touches)
        return {
            "touches": len(self.touches),
            "not_used": len(self.touches) - used,
            "zeros_deg": {name: deg(value) for name, (value, _) in self.zeros.items()},
            "zeros_std_deg": {name: deg(std) for name, (_, std) in self.zeros.items()},
            "last_off_mm": mm(self.touches[-1].off) if self.touches else None,
            "alarms": self.alarms,
        }

    def _warmer(self, temperature: float | None) -> float:
        """How much warmer it is than at first, K."""
        if temperature is None or not np.isfinite(temperature):
            return 0.0
        self._cold = temperature if self._cold is None else self._cold
        return temperature - self._cold

    def _at(self, angles: FloatArray, warmer: float) -> tuple[FloatArray, FloatArray]:
        """Tip (3,) of the calibrated arm, m, and its derivatives (3, n) by all unknowns."""
        self._tip.inputs[1][0] = angles
        flat, position, columns = self._tip()
        lever = flat.reshape(3, 3).T @ self._tool.tip
        by_all = columns.reshape(6, -1)
        moved = by_all[:3] - skew(lever) @ by_all[3:]
        by_zeros = moved[:, -len(self._zeros) :]
        slope = np.zeros((3, len(self.estimate.mean)))
        slope[:, self._calibration] = moved[:, : -len(self._zeros)] @ self._factor
        slope[:, self._drift], slope[:, self._warmth] = by_zeros, warmer * by_zeros
        return position[0] + lever, slope

    def _look(self, touch: Touch) -> None:
        """Say what no drift within its prior explains."""
        check = "Check the calibration with new rows: suta-calib check RESULT SAMPLES."
        if not touch.used and len(self.touches) > 1 and not self.touches[-2].used:
            self._alarm(
                "far",
                f"two touches, the last of {touch.point}, are off by {mm(touch.off):.2f} mm, which "
                "neither the calibration's ± nor a drift of the zeros explains. A link, the tip or "
                f"a point may have moved. {check}",
            )
        # Standard deviations of its prior that a zero has drifted by before it is called too far:
        # by chance one in 16,000.
        too_far = 4.0
        for joint, (drift, std) in self.zeros.items():
            if abs(drift) > too_far * self.spec.drift.zeros:
                self._alarm(
                    joint,
                    f"the zero of {joint} has drifted by {with_std(drift, std, 'rad', sign=True)}, "
                    f"more than {too_far:g} times what was assumed. {check}",
                )

    def _alarm(self, what: str, sentence: str) -> None:
        if what not in self._said:
            self._said.add(what)
            self.alarms.append(sentence)


def read_recalibration(path: str | Path) -> RecalibrationSpec:
    """Read a file of points that do not move, and of what may drift.

    Raises:
        InputError: unreadable, an unknown, missing or unusable key (with its line).
    """
    return read_as(RecalibrationSpec, YamlSection(read_yaml(Path(path), InputError), InputError))
