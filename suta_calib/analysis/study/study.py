"""A study of a job from beginning to end, and what it found.

A study of *sizes* says how many sets are enough; a bootstrap or a Monte-Carlo study how far
estimates scatter between trials, beside the standard deviation that was predicted.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.analysis.study.plan import (
    Request,
    StudyLog,
    StudyPlan,
    identity,
    plan_study,
    run_study,
)
from suta_calib.analysis.study.trial import ESTIMATED, Trial, held_out_rms, nominal_rms
from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.job.calibration import CalibrationJob
from suta_calib.solver.solution import Estimate
from suta_calib.solver.solve import Progress
from suta_calib.units import shown
from suta_calib.words import listed

# Share of trials without a result from which the others say little.
MANY_FAILED: Final = 0.05


@dataclass(frozen=True, eq=False)
class SizeResult(Displayable):
    """All trials with one number of sets.

    Attributes:
        size: sets in each trial.
        trials: how many were run.
        distinct: how many different subsets they drew.
        rms: (solved,) RMS of the held-out errors, m, of the trials that have a result.
        improvement: part by which the mean is smaller than that of the smallest size.
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
        """Over the trials with a result, m; NaN without any, as the smallest and largest."""
        return float(self.rms.mean()) if len(self.rms) else math.nan

    @property
    def std(self) -> float:
        """Between trials (n - 1), m; NaN for fewer than two."""
        return float(self.rms.std(ddof=1)) if len(self.rms) > 1 else math.nan

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest, m."""
        return (self.rms.min(), self.rms.max()) if len(self.rms) else (math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class SizeStudy(Displayable):
    """Error on held-out data by number of sets.

    Attributes:
        plan: what was run.
        sizes: one result a size, ascending.
        tolerance: part by which a mean may exceed the largest size's.
        failures: reasons trials had no result, with how often.
        uncalibrated: RMS, m, of the nominal arm on the validation data; NaN without them.
    """

    plan: StudyPlan
    sizes: tuple[SizeResult, ...]
    tolerance: float
    failures: dict[str, int]
    uncalibrated: float

    @property
    def solved(self) -> list[SizeResult]:
        """Those with a result."""
        return [s for s in self.sizes if len(s.rms)]

    @property
    def baseline(self) -> int | None:
        """The size improvements are relative to: the smallest with a result."""
        return self.solved[0].size if self.solved else None

    @property
    def recommended(self) -> int | None:
        """The smallest size from which on every mean is within the tolerance of the largest's."""
        enough = None
        for result in reversed(self.solved):
            if result.mean > self.solved[-1].mean * (1 + self.tolerance):
                break
            enough = result.size
        return enough

    @property
    def levelled(self) -> bool:
        """Whether a smaller size than the largest is enough, so that the curve has levelled off."""
        return self.recommended is not None and self.recommended != self.solved[-1].size

    @property
    @judged
    def assessment(self) -> Assessment:
        """Whether the recommendation may be relied on."""
        # Reasons that are listed; the rest are counted.
        most_reasons = 3
        if not self.solved:
            # Why trials have no result, the most frequent first.
            bad = [f"{problem} ({count} trials)." for problem, count in self.failures.items()]
            more = len(bad) - most_reasons
            bad = bad[:most_reasons] + ([f"There are {more} further reasons."] if more > 0 else [])
            return Assessment.of("No size can be judged: no trial has a result", bad=bad)
        largest, enough = self.solved[-1].size, self.recommended
        percent = f"{shown(self.tolerance, '%'):g} %"
        sentence = (
            f"No size below {largest} is within {percent} of the mean error with {largest}: more "
            "may help"
        )
        if self.levelled:
            unit = self.plan.data.sets.unit
            sets_are = f"{unit} is" if enough == 1 else f"{unit}s are"
            sentence = (
                f"{enough} {sets_are} enough: the mean error is within {percent} of that with "
                f"{largest}"
            )
        return Assessment.of(sentence, care=self._cautions())

    def _cautions(self) -> list[str]:
        cautions = []
        if not self.levelled:
            cautions.append("The curve has not levelled off: measure and study more sets.")
        if bad := [s for s in self.sizes if s.failed > MANY_FAILED * s.trials]:
            failures = ", ".join(f"{s.failed} of {s.trials} with {s.size}" for s in bad)
            cautions.append(
                f"Trials without a result: {failures}. The figures are for the other trials, so "
                "they are too optimistic."
            )
        if self.plan.left_out:
            first, last = self.plan.left_out[0], self.plan.left_out[-1]
            sizes = f"{first}" if first == last else f"{first} to {last}"
            cautions.append(
                f"There are only {len(self.plan.data.sets)} sets; not studied: {sizes}."
            )
        if not self.plan.data.validation:
            cautions.append(
                "The job has no validation data, so each trial was judged on the sets that it "
                "did not use. They come from the same measurement, so the figures are too "
                "optimistic."
            )
        return cautions


@dataclass(frozen=True, eq=False)
class TrialScatter(Displayable):
    """One quantity, (told,) m or rad, over the trials that told it."""

    values: FloatArray

    @property
    def enough(self) -> bool:
        """Whether there are enough values for a spread that is worth a number."""
        return len(self.values) >= 10

    @property
    def mean(self) -> float:
        """NaN where there are too few values, as for the others."""
        return float(self.values.mean()) if self.enough else math.nan

    @property
    def std(self) -> float:
        """Standard deviation (n - 1)."""
        return float(self.values.std(ddof=1)) if self.enough else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Percentile interval of 95 %."""
        if not self.enough:
            return (math.nan, math.nan)
        low, high = np.percentile(self.values, (2.5, 97.5)).tolist()
        return low, high


@dataclass(frozen=True, eq=False)
class ParameterSpread(Displayable):
    """One parameter of the arm.

    Attributes:
        estimate: of the calibration with all data.
        spread: of the trials' estimates that are relative to the same held parameters.
        predicted: standard deviation, m or rad: the calibration's own in a bootstrap, the root
            mean square of the trials' in a Monte-Carlo study; NaN if unknown.
        sets: how many sets a bootstrap drew from; 0 where nothing was drawn.
        priors: whether the job has any.
    """

    estimate: Estimate
    spread: TrialScatter
    predicted: float
    sets: int = 0
    priors: bool = False

    @property
    def ratio(self) -> float:
        """Spread over prediction; NaN where one of them is not known."""
        return self.spread.std / self.predicted if self.predicted > 0 else math.nan

    @property
    def as_predicted(self) -> bool:
        """Whether the ratio is right, but for chance; true where there is none to judge.

        The standard deviation of n values is uncertain by 1/√(2 (n - 1)) of itself, and that of a
        bootstrap also by what its sets leave to chance. A prior is not drawn anew, and through
        correlations it keeps more than its own parameter together: with one, a spread that is too
        small proves nothing.
        """
        # Spread over prediction that is called right, beyond what so many trials leave to chance.
        right = (0.8, 1.25)
        if not math.isfinite(self.ratio) or (self.priors and self.ratio < 1):
            return True
        counts = [len(self.spread.values), *([self.sets] if self.sets else [])]
        chance = 2.0 * math.sqrt(sum(1.0 / (2.0 * (n - 1)) for n in counts))
        return right[0] / (1 + chance) < self.ratio < right[1] * (1 + chance)


@dataclass(frozen=True, eq=False)
class SpreadStudy(Displayable):
    """Scatter of a calibration's answer.

    Attributes:
        plan: what was run.
        parameters: of the arm, by name.
        validation: RMS of the held-out errors, m, over the trials.
        full_rms: the same, m, of the calibration with all data; NaN without validation data.
        solved: trials with a result.
        failures: reasons trials had none, with how often.
    """

    plan: StudyPlan
    parameters: dict[str, ParameterSpread]
    validation: TrialScatter
    full_rms: float
    solved: int
    failures: dict[str, int]

    @property
    @judged
    def assessment(self) -> Assessment:
        """Whether standard deviations may be believed."""
        estimated = [p for p in self.parameters.values() if math.isfinite(p.ratio)]
        if not estimated:
            reasons = "; ".join(self.failures) or "too few trials"
            return Assessment.of(
                "No parameter was identified", bad=[f"The spread cannot be determined: {reasons}"]
            )
        ratios = [p.ratio for p in estimated]
        sentence = (
            f"{len(estimated)} parameters identified in {self.solved} trials; their spread is "
            f"{min(ratios):.2f} to {max(ratios):.2f} times the predicted standard deviation"
        )
        return Assessment.of(sentence, care=self._cautions())

    def _cautions(self) -> list[str]:
        cautions = []
        off = {name: p.ratio for name, p in self.parameters.items() if not p.as_predicted}
        if more := [name for name, ratio in off.items() if ratio > 1]:
            cautions.append(f"Scattered more than predicted: {listed(more)}.")
        if less := [name for name, ratio in off.items() if ratio < 1]:
            cautions.append(f"Scattered less than predicted: {listed(less)}.")
        if cautions and self.plan.data.kind == "bootstrap" and self.plan.data.sets.unit == "set":
            cautions.append(
                "The repeats of a placement share the model's errors there. This bootstrap "
                "treats them as independent, the prediction does not. Try --unit placement."
            )
        often = (1 - MANY_FAILED) * self.solved
        estimated = {n: p for n, p in self.parameters.items() if p.estimate.state in ESTIMATED}
        if rarely := [n for n, p in estimated.items() if len(p.spread.values) < often]:
            cautions.append(f"Not identified in every trial: {listed(rarely)}.")
        failed = self.plan.trials - self.solved
        if failed > MANY_FAILED * self.plan.trials:
            cautions.append(f"{failed} of {self.plan.trials} trials gave no result.")
        return cautions


Study = SizeStudy | SpreadStudy


@checked
def study_of_job(
    job: CalibrationJob,
    request: Request,
    log: Path | None = None,
    *,
    resume: bool = False,
    anyway: bool = False,
    workers: int = 1,
    dask: str | None = None,
    progress: Progress | None = None,
) -> Study:
    """Repeat a job's calibration over parts of its data, and summarise what came of it.

    Args:
        job: what is calibrated.
        request: what is asked for.
        log: file that finished trials are written to, for an interrupted study to go on.
        resume: go on with the trials in the log.
        anyway: study a job whose answer must not be used, too.
        workers: processes on this computer; the answer does not depend on how many.
        dask: address of a Dask scheduler to run on instead.
        progress: called with (trials done, trials).

    Raises:
        SamplesError: too few sets, or none of the sizes is possible.
        JobError: the log is of another study.
        NotUsableError: the answer with all data must not be used.
        InputError: no Dask scheduler answers, or its workers cannot run a trial.
    """
    solution = job.usable_solution(anyway=anyway)
    plan = plan_study(
        job.parameters, job.observations, job.validation, job.options(), request, solution
    )

    into = nullcontext() if log is None else StudyLog(log, identity(job, plan.data), plan.names)
    with into as opened:
        trials = run_study(
            plan, opened, resume=resume, workers=workers, dask=dask, progress=progress
        )
    if request.kind == "size":
        return judge_sizes(plan, trials, request.tolerance)
    return judge_spread(plan, trials)


def judge_sizes(plan: StudyPlan, trials: Sequence[Trial], tolerance: float) -> SizeStudy:
    """Summarise the trials of a study of sizes.

    Args:
        plan: what was run.
        trials: of `run_study`.
        tolerance: part by which a mean may exceed the largest size's.
    """
    results = []
    for size in plan.sizes:
        mine = [trial for trial in trials if trial.size == size]
        drawn = {plan.data.chosen(size, trial.number) for trial in mine}
        rms = np.array([trial.rms for trial in mine if not trial.problem])
        results.append(SizeResult(size, len(mine), len(drawn), rms))
    first = next((r.mean for r in results if len(r.rms)), math.nan)
    with_gain = tuple(replace(r, improvement=1.0 - r.mean / first) for r in results)
    failures = Counter(trial.problem for trial in trials if trial.problem)
    uncalibrated = nominal_rms(plan.data)
    return SizeStudy(plan, with_gain, tolerance, dict(failures.most_common()), uncalibrated)


def judge_spread(plan: StudyPlan, trials: Sequence[Trial]) -> SpreadStudy:
    """Summarise the trials of a bootstrap or a Monte-Carlo study.

    Args:
        plan: what was run.
        trials: of `run_study`.
    """
    solution, data = plan.solution, plan.data
    assert solution is not None
    priors = any(p.prior is not None for p in data.parameters.values())
    bootstrap = data.kind == "bootstrap"
    parameters = {}
    for name in solution.problem.arm_parameters:
        estimate = solution.estimates[name]
        estimated = [t.estimates[name] for t in trials if name in t.estimates]
        values, stds = np.array(estimated).reshape(-1, 2).T
        predicted = math.nan if estimate.std is None else estimate.std
        if not bootstrap:
            predicted = float(np.sqrt(np.mean(stds**2))) if len(stds) else math.nan
        sets = len(data.sets) if bootstrap else 0
        parameters[name] = ParameterSpread(estimate, TrialScatter(values), predicted, sets, priors)
    failures = dict(Counter(trial.problem for trial in trials if trial.problem).most_common())
    solved = [trial for trial in trials if not trial.problem]
    errors = TrialScatter(np.array([t.rms for t in solved if math.isfinite(t.rms)]))
    full_rms = held_out_rms(solution, data.validation)
    return SpreadStudy(plan, parameters, errors, full_rms, len(solved), failures)
