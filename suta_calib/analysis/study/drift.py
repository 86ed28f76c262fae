"""How the error grows when an arm's parameters walk, and when to calibrate again.

Screws settle, printed parts creep, an encoder's ring slips: what was calibrated is no longer so.
The walk is taken for a Brownian motion of every estimated parameter, independent of the others,
whose size after a time t is the stated rate times √t. Trials move the calibrated values along such
walks and look at the held-out data with them: to first order that is the same as an arm that walks
away from its calibration. Nothing here can be learnt from one calibration: rates come from the
changes between two, divided by the root of the time between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError, SamplesError
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import Progress
from suta_calib.terms import Term
from suta_calib.threads import single_threaded
from suta_calib.trust.accuracy import block_residuals, fit_own
from suta_calib.units import mm, text

# Share of trials on either side of the reported interval.
_OUTSIDE: Final = 0.05


@dataclass(frozen=True)
class DriftOptions:
    """What walks, how fast, and what may become of the errors.

    Attributes:
        angle_rate: standard deviation of each angle and joint offset after one day, rad.
        length_rate: the same of each length, m.
        days: how long to look ahead; the walk's steps are of equal length.
        tolerance: part by which the held-out RMS may grow before a new calibration is due.
        trials: walks.
        steps: times that are looked at.
        seed: of the walks.
    """

    angle_rate: float = 0.0
    length_rate: float = 0.0
    days: float = 90.0
    tolerance: float = 0.1
    trials: int = 100
    steps: int = 12
    seed: int = 0

    def __post_init__(self) -> None:
        sizes = (self.angle_rate, self.length_rate)
        if min(sizes) < 0 or not max(sizes) > 0 or not all(map(math.isfinite, sizes)):
            raise ParameterError(
                "no drift rate of the parameters",
                "a positive rate for angles, for lengths, or for both",
                where="drift",
                hint="divide the difference of two calibrations by the square root of the days "
                "between them",
            )


@dataclass(frozen=True)
class DriftPoint:
    """The held-out errors after a time, over all walks.

    Attributes:
        days: since the calibration.
        rms: root mean square over walks and errors, m.
        low, high: RMS that one walk in twenty is below, and one in twenty above, m.
    """

    days: float
    rms: float
    low: float
    high: float


@dataclass(frozen=True)
class DriftStudy(Displayable):
    """How held-out errors grow.

    Attributes:
        options: what was asked.
        now: held-out RMS on the day of the calibration, m.
        points: after equal steps of time.
        first_over: (trials,) days after which a walk is over the limit; infinite where it stays
            below all the time.
    """

    options: DriftOptions
    now: float
    points: tuple[DriftPoint, ...]
    first_over: FloatArray

    @property
    def limit(self) -> float:
        """Held-out RMS from which on a new calibration is due, m."""
        return (1.0 + self.options.tolerance) * self.now

    @property
    def interval(self) -> float:
        """Days after which one walk in twenty is over the limit; infinite where fewer are."""
        return float(np.quantile(self.first_over, _OUTSIDE, method="higher"))

    @property
    @judged
    def assessment(self) -> Assessment:
        """When to calibrate again, for these rates."""
        limit = f"{mm(self.limit):.3f} mm"
        if math.isinf(self.interval):
            return Assessment.of(
                f"No calibration is due within {self.options.days:g} days: by then, fewer than 5 % "
                f"of the arms have drifted beyond {limit} RMS at the tip"
            )
        above = text(self.options.tolerance, "%", decimals=0, with_unit=True)
        sentence = (
            f"Calibrate again after {self.interval:.3g} days: then 5 % of the arms exceed "
            f"{limit} RMS ({above} above the present error)"
        )
        early = self.interval <= self.options.days / self.options.steps
        care = (
            ["This is the first time that was simulated. Choose a shorter time (--days)."]
            if early
            else []
        )
        return Assessment.of(sentence, care=care)


@single_threaded
@checked
def drift_study(
    solution: Solution,
    validation: Sequence[Term],
    options: DriftOptions,
    progress: Progress | None = None,
) -> DriftStudy:
    """Let a calibration's estimated parameters walk and look at held-out errors with them.

    Args:
        solution: a converged one, over an arm.
        validation: data that were not fitted; the errors are those of the first term's kind.
        options: rates, times and the limit.
        progress: called with (walks done, walks).

    Raises:
        SamplesError: nothing is held out.
    """
    if not validation:
        raise SamplesError(
            "no validation data", "data that were not fitted, to show how errors grow"
        )
    arm = solution.problem.arm_parameters
    rate = {"rad": options.angle_rate, "m": options.length_rate}
    walking = [e for e in solution.arm_estimates.values() if e.std is not None]
    names = [estimate.name for estimate in walking]
    size = np.array([rate.get(arm[name].unit, 0.0) for name in names])
    judged = [term for term in validation if term.kind == validation[0].kind]
    with_unknowns = any(term.own_parameters for term in judged)
    first = np.cumsum([0, *(len(term.blocks) for term in judged)])[:-1]

    def held_out(values: dict[str, float]) -> float:
        fitted = fit_own(judged, arm, values) if with_unknowns else values
        residuals = block_residuals(judged, arm, fitted)
        squares = [np.sum(residuals[k] ** 2, axis=1) for k in first]
        return float(np.sqrt(np.mean(np.concatenate(squares))))

    values = {name: solution.values[name] for name in arm.names}
    days = options.days * np.arange(1, options.steps + 1) / options.steps
    random, step = np.random.default_rng(options.seed), math.sqrt(options.days / options.steps)
    rms = np.empty((options.trials, options.steps))
    for trial in range(options.trials):
        walk = np.cumsum(step * size * random.standard_normal((options.steps, len(size))), axis=0)
        for k, away in enumerate(walk.tolist()):
            moved = {n: values[n] + by for n, by in zip(names, away, strict=True)}
            rms[trial, k] = held_out(values | moved)
        if progress is not None:
            progress(trial + 1, options.trials)
    low, high = np.quantile(rms, [_OUTSIDE, 1 - _OUTSIDE], axis=0)
    total = np.sqrt(np.mean(rms**2, axis=0))
    now = held_out(values)
    over = rms > (1.0 + options.tolerance) * now
    first_over = np.where(over.any(axis=1), days[np.argmax(over, axis=1)], math.inf)
    points = map(DriftPoint, days.tolist(), total.tolist(), low.tolist(), high.tolist())
    return DriftStudy(options, now, tuple(points), first_over)
