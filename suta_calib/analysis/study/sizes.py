"""What the study of sizes found: the error by number of sets, and how many sets are enough."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.analysis.study.plan import StudyPlan
from suta_calib.analysis.study.trial import Trial, nominal_rms
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment

# Share of trials without a result from which the mean of the others says little.
MANY_FAILED: Final = 0.05
# Reasons that a reader is told; the rest are counted.
MOST_REASONS: Final = 3


@dataclass(frozen=True, eq=False)
class SizeResult:
    """All trials with one number of sets.

    Attributes:
        size: sets in each trial.
        trials: how many were run.
        distinct: how many different subsets they drew.
        rms: (solved,) RMS of the held-out errors, m, of the trials that have a result.
        improvement: how much smaller the mean is than that of the smallest size, as a fraction.
    """

    size: int
    trials: int
    distinct: int
    rms: FloatArray
    improvement: float = math.nan

    @property
    def failed(self) -> int:
        """Trials without a result: data too few, or not converged."""
        return self.trials - len(self.rms)

    @property
    def mean(self) -> float:
        """Over the trials with a result, m."""
        return float(self.rms.mean()) if len(self.rms) else math.nan

    @property
    def std(self) -> float:
        """Between trials (n - 1), m; NaN for fewer than two."""
        return float(self.rms.std(ddof=1)) if len(self.rms) > 1 else math.nan

    @property
    def minimum(self) -> float:
        """Of all trials, m."""
        return float(self.rms.min()) if len(self.rms) else math.nan

    @property
    def maximum(self) -> float:
        """Of all trials, m."""
        return float(self.rms.max()) if len(self.rms) else math.nan


@dataclass(frozen=True, eq=False)
class SizeStudy:
    """Error on held-out data by number of sets.

    Attributes:
        plan: what was run.
        sizes: one result a size, ascending.
        tolerance: fraction by which a mean may exceed the largest size's and still be enough.
        failures: reasons trials had no result, with how often.
        uncalibrated: RMS, m, of the nominal arm on the validation data; NaN without them.
    """

    plan: StudyPlan
    sizes: tuple[SizeResult, ...]
    tolerance: float
    failures: dict[str, int]
    uncalibrated: float

    @property
    def baseline(self) -> int | None:
        """The size improvements are relative to: the smallest with a result."""
        return next((s.size for s in self.sizes if len(s.rms)), None)

    @property
    def recommended(self) -> int | None:
        """The smallest size from which on every mean is within the tolerance of the largest's."""
        solved = [s for s in self.sizes if len(s.rms)]
        enough = None
        for result in reversed(solved):
            if result.mean > solved[-1].mean * (1 + self.tolerance):
                break
            enough = result.size
        return enough

    @property
    def levelled(self) -> bool:
        """Whether a smaller size than the largest is enough, so that the curve has levelled off."""
        largest = next((s.size for s in reversed(self.sizes) if len(s.rms)), None)
        return self.recommended is not None and self.recommended != largest

    @property
    def assessment(self) -> Assessment:
        """Whether the recommendation may be relied on."""
        if self.baseline is None:
            return Assessment.of(
                "no size can be judged: no trial has a result", bad=self._reasons()
            )
        return Assessment.of(self._sentence(), care=self._cautions())

    def _sentence(self) -> str:
        largest = [s for s in self.sizes if len(s.rms)][-1].size
        percent = f"{100 * self.tolerance:g} %"
        if not self.levelled:
            return (
                f"no size below {largest} is within {percent} of the mean error with {largest}: "
                "more may help"
            )
        return (
            f"{self.recommended} {self._unit(self.recommended)} "
            f"{'is' if self.recommended == 1 else 'are'} enough: the mean error is within "
            f"{percent} of that with {largest}"
        )

    def _reasons(self) -> list[str]:
        """Why trials have no result, the most frequent first."""
        told = [f"{problem} ({count} trials)." for problem, count in self.failures.items()]
        more = len(told) - MOST_REASONS
        return told[:MOST_REASONS] + ([f"And {more} further reasons."] if more > 0 else [])

    def _unit(self, count: int | None) -> str:
        unit = self.plan.data.sets.unit
        return unit if count == 1 else f"{unit}s"

    def _cautions(self) -> list[str]:
        found = []
        if not self.levelled:
            found.append("The curve has not levelled off: study more sets than these.")
        bad = [s for s in self.sizes if s.failed > MANY_FAILED * s.trials]
        if bad:
            told = ", ".join(f"{s.failed} of {s.trials} with {s.size}" for s in bad)
            found.append(
                f"Trials without a result: {told}. The figures are of the others, so they are "
                "better than such data deserve."
            )
        if self.plan.left_out:
            first, last = self.plan.left_out[0], self.plan.left_out[-1]
            sizes = f"{first}" if first == last else f"{first} to {last}"
            found.append(f"There are {len(self.plan.data.sets)} sets: not studied: {sizes}.")
        if not self.plan.data.validation:
            found.append(
                "The job has no validation data: the sets that a trial did not draw stood in for "
                "them. They come from the same measurement, which flatters the figures."
            )
        return found


def judge_sizes(plan: StudyPlan, trials: Sequence[Trial], tolerance: float) -> SizeStudy:
    """Summarise the trials of a study of sizes.

    Args:
        plan: what was run.
        trials: of `run_study`.
        tolerance: fraction a mean may exceed the largest size's by and still be enough.
    """
    results = [_result(plan, size, trials) for size in plan.sizes]
    first = next((r.mean for r in results if len(r.rms)), math.nan)
    with_gain = tuple(
        SizeResult(r.size, r.trials, r.distinct, r.rms, 1.0 - r.mean / first) for r in results
    )
    failures = Counter(trial.problem for trial in trials if trial.problem)
    uncalibrated = nominal_rms(plan.data)
    return SizeStudy(plan, with_gain, tolerance, dict(failures.most_common()), uncalibrated)


def _result(plan: StudyPlan, size: int, trials: Sequence[Trial]) -> SizeResult:
    mine = [trial for trial in trials if trial.size == size]
    drawn = {plan.data.chosen(size, trial.number) for trial in mine}
    rms = np.array([trial.rms for trial in mine if not trial.problem])
    return SizeResult(size, len(mine), len(drawn), rms)
