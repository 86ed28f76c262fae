"""A residual map: a correction of the calibrated tip, and whether left-out data prove it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np
from scipy.special import stdtr

from suta_calib import analysis, plotting
from suta_calib.analysis.residual_map.residuals import TipResiduals, own_columns, tip_derivative
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError, SamplesError
from suta_calib.model.arm import ArmModel
from suta_calib.trust.accuracy import Metrics
from suta_calib.units import Unit, text
from suta_calib.words import listed

# Chance that a map of pure noise passes one test.
LEVEL: Final = 0.01
# Part of the RMS that it must remove: less is not worth a second file beside the URDF.
WORTH: Final = 0.05
SORTS: Final = {
    "joints": "a curve of each joint",
    "posture": "a function of the posture",
}


@dataclass(frozen=True, eq=False)
class LeftOut(Displayable):
    """Errors of rows that were left out block by block, without and with a map.

    Attributes:
        by: ``posture`` (rows whose readings are alike) or ``time`` (stretches of the recording, or
            places).
        block: (n,) number of the block of each row, from 0.
        before, after: (n, 3) error without and with the map, m, base axes.
        predicted: (n, 3) standard deviation that the map predicts for ``after``, m.
    """

    by: Literal["posture", "time"]
    block: IntArray
    before: FloatArray
    after: FloatArray
    predicted: FloatArray

    @cached_property
    def sizes(self) -> tuple[FloatArray, FloatArray]:
        """Norms (n,) before and after, m."""
        before, after = (np.linalg.norm(e, axis=1) for e in (self.before, self.after))
        return before, after

    @property
    def metrics(self) -> tuple[Metrics, Metrics]:
        """Before and after."""
        before, after = map(Metrics.of, self.sizes)
        return before, after

    @property
    def blocks(self) -> int:
        """How many blocks there are."""
        return int(self.block.max()) + 1

    @cached_property
    def p_value(self) -> float:
        """Chance of such a gain if the map removes nothing: a one-sided t test paired by block."""
        before, after = self.sizes
        squares = before**2 - after**2
        mean = float(squares.mean())
        off = np.bincount(self.block, squares - mean, self.blocks)
        count = self.blocks
        std = float(np.sqrt(np.sum(off**2) * count / (count - 1))) / len(squares)
        if std == 0.0:
            return 0.5 if mean == 0.0 else float(mean < 0.0)
        return float(stdtr(count - 1, -mean / std))

    @property
    def proven(self) -> bool:
        """Whether the map removes more than chance does, and enough to be worth it."""
        before, after = self.metrics
        return self.p_value < LEVEL and after.rms < (1.0 - WORTH) * before.rms

    @property
    def wider(self) -> float:
        """Factor on the predicted standard deviations that makes them as large as the errors."""
        ratio = float(np.sqrt(np.mean((self.after / self.predicted) ** 2)))
        return max(ratio, 1.0)

    def coverage(self, times: float, wider: float = 1.0) -> float:
        """Share of the errors of one axis within so many (widened) standard deviations."""
        return float(np.mean(np.abs(self.after) <= times * wider * self.predicted))


@dataclass(frozen=True, eq=False)
class Validated(Displayable):
    """Errors of validation rows without and with a map.

    Attributes:
        name: which rows.
        before, after: (n,) norms, m.
    """

    name: str
    before: FloatArray
    after: FloatArray

    @property
    def metrics(self) -> tuple[Metrics, Metrics]:
        """Before and after."""
        return Metrics.of(self.before), Metrics.of(self.after)

    @classmethod
    def together(cls, parts: Sequence[Validated]) -> Validated:
        """All rows of several."""
        before, after = ([getattr(p, k) for p in parts] for k in ("before", "after"))
        return cls("all", np.concatenate(before), np.concatenate(after))


@dataclass(frozen=True, eq=False)
class MapCandidate(Displayable):
    """One sort of map that was tried.

    Attributes:
        sort: ``joints`` or ``posture``; see `SORTS`.
        tests: with blocks by posture; with blocks by time too, where those prove it.
        process: the map itself, fitted to all rows.
        validated: its errors on validation rows, by row of the job; empty without such rows.
    """

    sort: Literal["joints", "posture"]
    tests: tuple[LeftOut, ...]
    process: Any
    validated: tuple[Validated, ...] = ()

    @property
    def proven(self) -> bool:
        """Whether both tests prove it."""
        return all(test.proven for test in self.tests)

    @property
    def confirmed(self) -> bool:
        """Whether validation rows, where there are any, err less with it too."""
        if not self.validated:
            return True
        before, after = Validated.together(self.validated).metrics
        return after.rms < before.rms


@dataclass(frozen=True, eq=False)
class JointCurve(Displayable):
    """What is to be added to the reading of a joint.

    Attributes:
        joint, unit: whose; rad or m.
        reading: (g,) ascending, rad or m.
        correction, std: (g,) of the angle (or way), rad or m.
        tip: RMS of what it does to the tip in the measured postures, m.
    """

    joint: str
    unit: Unit
    reading: FloatArray
    correction: FloatArray
    std: FloatArray
    tip: float


@dataclass(frozen=True, eq=False, repr=False)
class ResidualMap(Displayable):
    """What is left of the tip's error after a calibration, where left-out blocks prove it.

    Attributes:
        arm: the chain, at nominal.
        values: of the calibration, SI.
        residuals: the errors that were looked at.
        tried: both sorts of map, with their tests.
        chosen: the one that is used; None where there is nothing left.
    """

    arm: ArmModel
    values: Mapping[str, float]
    residuals: TipResiduals
    tried: tuple[MapCandidate, ...]
    chosen: MapCandidate | None

    @property
    def in_a_line(self) -> str:
        """What it gains, or that there is nothing left."""
        return self.assessment.sentence

    @property
    def used(self) -> bool:
        """Whether there is a correction."""
        return self.chosen is not None

    @property
    def best(self) -> MapCandidate:
        """The map that predicts left-out postures best, whether it is used or not."""
        return min(self.tried, key=lambda c: c.tests[0].metrics[1].rms)

    @property
    def wider(self) -> float:
        """Factor on the standard deviations that left-out rows ask for."""
        return 1.0 if self.chosen is None else self.chosen.tests[0].wider

    @property
    def noise(self) -> float:
        """Standard deviation of what stays unexplained in one row, of one axis, m."""
        if self.chosen is None:
            return float(np.sqrt(np.mean(self.residuals.error**2)))
        return float(self.chosen.process.noise * self.wider)

    def correction(self, q: FloatArray) -> FloatArray:
        """What is to be added to the calibrated tip (n, 3), m, base axes; zero if nothing is left.

        Args:
            q: (n, joints) readings, in the order of ``arm.joints``, rad or m.
        """
        return self._predicted(q)[0]

    def std(self, q: FloatArray) -> FloatArray:
        """Standard deviation (n, 3) of the correction, m, base axes.

        Far from the measured postures it is that of an unknown correction. Where nothing is left,
        it is the scatter of the errors.
        """
        return self._predicted(q)[1] * self.wider

    def tip(self, q: FloatArray) -> FloatArray:
        """Position of the tip (n, 3), m, in the base: the calibrated arm's with the correction."""
        q = self._checked(q)
        return np.asarray(self.arm.forward(q, self.values)[1] + self.correction(q))

    def corrected_readings(self, q: FloatArray) -> FloatArray:
        """(n, joints) readings with the joints' curves added; these turn the tip right too.

        Raises:
            ParameterError: the map has no curves of joints.
        """
        if self.chosen is None or self.chosen.sort != "joints":
            problem = "a map without curves of joints" if self.used else "no map"
            raise ParameterError(problem, "a map of the joints; use correction(q) instead")
        corrected, process = self._checked(q).copy(), self.chosen.process
        columns = np.array(own_columns(self.arm))[process.columns]
        for k, column in enumerate(columns):
            corrected[:, column] += process.curve(k, corrected[:, column])[0]
        return corrected

    def _checked(self, q: FloatArray) -> FloatArray:
        q = np.atleast_2d(np.asarray(q, dtype=float))
        if q.shape[1:] != (len(self.arm.joints),) or not np.isfinite(q).all():
            problem = (
                "a reading that is no number" if q.shape[1:] == (len(self.arm.joints),) else ""
            )
            raise SamplesError(
                problem or f"readings of shape {q.shape}",
                f"(n, {len(self.arm.joints)}) finite readings, rad or m",
                where="q",
            )
        return q

    def _predicted(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        q = self._checked(q)
        if self.chosen is None:
            return np.zeros((len(q), 3)), np.full((len(q), 3), self.noise)
        jacobian = tip_derivative(self.arm, self.values, q)
        readings = q[:, own_columns(self.arm)]
        mean, std = self.chosen.process.predict(readings, jacobian)
        return mean, std

    @cached_property
    def curves(self) -> tuple[JointCurve, ...]:
        """What each joint is off by, where the map is one of joints; most effect first."""
        if self.chosen is None or self.chosen.sort != "joints":
            return ()
        process, q = self.chosen.process, self.residuals.q
        curves = []
        for k, column in enumerate(process.columns):
            joint = self.arm.own_joints[column]
            # Straight lines over a sixth of the length follow a curve within a hundredth of its
            # size; beyond three lengths from the data nothing is known of it.
            length = float(process.length[k])
            low, high = q[:, column].min() - 3 * length, q[:, column].max() + 3 * length
            count = int(np.clip(6 * (high - low) / length, 20, 1000)) + 1
            reading = np.linspace(low, high, count)
            correction, std = process.curve(k, reading)
            moved = (
                process.curve(k, q[:, column])[0][:, None] * self.residuals.jacobian[:, :, column]
            )
            tip = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
            unit = self.arm.units[joint]
            curves.append(JointCurve(joint, unit, reading, correction, std * self.wider, tip))
        return tuple(sorted(curves, key=lambda curve: -curve.tip))

    def plot(self, figure: Any = None) -> Any:
        """Draw left-out errors before and after, the map over two joints, and joints' curves.

        Args:
            figure: an empty `Figure` or `SubFigure`; a new one by default.

        Returns:
            The figure.
        """
        figure = plotting.figure_or_new(figure, analysis.residual_map.size_of(self))
        analysis.residual_map.draw_residual_map(figure, self)
        return figure

    @property
    @judged
    def assessment(self) -> Assessment:
        """What left-out blocks say, and how the correction is used."""
        if self.chosen is None:
            return Assessment.of(self._nothing(), facts=self._gross())
        test, process = self.chosen.tests[0], self.chosen.process
        before, after = (text(m.rms, "m") for m in test.metrics)
        share = 100.0 * (1.0 - test.metrics[1].rms / test.metrics[0].rms)
        sentence = (
            f"The residual map reduces the error of the tip in left-out postures from {before} to "
            f"{after} mm RMS (by {share:.0f} %)"
        )
        facts = [_proof(self.chosen.tests)]
        if self.chosen.validated:
            errors = Validated.together(self.chosen.validated).metrics
            rms, mean = ([text(getattr(m, k), "m") for m in errors] for k in ("rms", "mean"))
            facts.append(
                f"On {errors[0].count} validation rows the error falls from {rms[0]} to {rms[1]} "
                f"mm RMS (mean: {mean[0]} to {mean[1]} mm)."
            )
        share_of = [100.0 * test.coverage(k, self.wider) for k in (1.0, 2.0)]
        facts.append(
            f"About 68 % (95 %) of the left-out errors should lie within 1 (2) predicted standard "
            f"deviations: {share_of[0]:.0f} % ({share_of[1]:.0f} %) do."
        )
        unknown = text(process.unknown * self.wider, "m")
        facts.append(
            "The correction is for the postures that were measured. Far from them it is zero, and "
            f"its ± is {unknown} mm per axis."
        )
        facts.append(
            "A URDF cannot hold this map. calibrated.urdf and the other commands work without it; "
            "apply it with residual_map.py."
        )
        return Assessment.of(sentence, care=self._beside(), facts=[*facts, *self._gross()])

    @property
    def beside(self) -> tuple[str, ...]:
        """Estimated parameters that no URDF holds: the map is what is left after them."""
        offered = self.arm.nongeometric
        values = self.values.items()
        return tuple(n for n, v in values if n in offered and not offered[n].in_urdf(v))

    def _beside(self) -> list[str]:
        """What must be applied with the map."""
        if not (beside := self.beside):
            return []
        alone = {name: value for name, value in self.values.items() if name not in beside}
        with_all, without = (self.arm.forward(self.residuals.q, v)[1] for v in (self.values, alone))
        off = float(np.sqrt(np.mean(np.sum((with_all - without) ** 2, axis=1))))
        return [
            f"residual_map.py does not correct calibrated.urdf alone. A URDF cannot hold "
            f"{listed(beside, 3)} either, and without these the tip is off by {text(off, 'm')} mm "
            "(RMS in the measured postures). Apply three things together: calibrated.urdf, the "
            "corrections in result.json (track --result applies both), and the map. For a URDF "
            "and the map alone, run residual-map on a job that estimates the geometry alone: that "
            "map describes the effect of these parameters too."
        ]

    def _nothing(self) -> str:
        """That nothing is left, with the figure."""
        best = self.best
        before, after = (text(m.rms, "m") for m in best.tests[0].metrics)
        figure = f"{before} mm RMS without a map, {after} mm with the better one"
        if best.proven and not best.confirmed:
            held = [text(m.rms, "m") for m in Validated.together(best.validated).metrics]
            return (
                f"There is nothing left that a map can correct: in left-out postures the error "
                f"falls ({figure}), but not in the validation rows ({held[0]} to {held[1]} mm)"
            )
        failed = next((t for t in best.tests if not t.proven), best.tests[-1])
        why = f"p = {failed.p_value:.2g} in blocks by {failed.by}, needed: below {LEVEL:g}"
        if failed.p_value < LEVEL:
            why = f"needed: at least {100 * WORTH:.0f} % less, in blocks by {failed.by}"
        return (
            "There is nothing left that a map can correct: the error of the tip in left-out "
            f"postures is {figure} ({why})"
        )

    def _gross(self) -> Sequence[str]:
        if not self.residuals.gross:
            return ()
        rows = f"{self.residuals.gross} row{'s' * (self.residuals.gross != 1)}"
        return (f"{rows} with a gross error took no part.",)


def _proof(tests: Sequence[LeftOut]) -> str:
    """How it was tested, with the chance of each test."""
    parts = [
        f"{test.blocks} blocks by {test.by} "
        f"({'p < 0.001' if test.p_value < 1e-3 else f'p = {test.p_value:.2g}'})"
        for test in tests
    ]
    return (
        f"Tested by leaving out {' and '.join(parts)}: a paired t test of the blocks' squared "
        f"errors, level {LEVEL:g}."
    )
