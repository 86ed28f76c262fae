"""How far estimates scatter between trials, beside the standard deviation that was predicted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.analysis.study.plan import StudyPlan
from suta_calib.analysis.study.sizes import MANY_FAILED
from suta_calib.analysis.study.trial import ESTIMATED, Trial
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.solver.solution import Estimate

# Percentiles that enclose 95 %.
INTERVAL: Final = (2.5, 97.5)
# Fewer values have no spread worth a number.
FEWEST: Final = 10
# Spread over prediction that is called right, beyond what so many trials leave to chance.
RIGHT: Final = (0.8, 1.25)
MOST_NAMES: Final = 6


@dataclass(frozen=True, eq=False)
class TrialScatter:
    """One quantity over the trials that told it.

    Attributes:
        values: (told,) m or rad.
    """

    values: FloatArray

    @property
    def enough(self) -> bool:
        """Whether there are enough values to speak of a spread."""
        return len(self.values) >= FEWEST

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
        low, high = np.percentile(self.values, INTERVAL)
        return float(low), float(high)


@dataclass(frozen=True, eq=False)
class ParameterSpread:
    """One parameter of the arm.

    Attributes:
        estimate: of the calibration with all data.
        spread: of the trials' estimates that mean the same: told, and relative to the same held
            parameters.
        predicted: standard deviation to compare with, m or rad: the calibration's own in a
            bootstrap, the root mean square of the trials' in a Monte-Carlo study; NaN if unknown.
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
        if not math.isfinite(self.ratio) or (self.priors and self.ratio < 1):
            return True
        counts = [len(self.spread.values), *([self.sets] if self.sets else [])]
        chance = 2.0 * math.sqrt(sum(1.0 / (2.0 * (n - 1)) for n in counts))
        return RIGHT[0] / (1 + chance) < self.ratio < RIGHT[1] * (1 + chance)


@dataclass(frozen=True, eq=False)
class SpreadStudy:
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
    def assessment(self) -> Assessment:
        """Whether standard deviations may be believed."""
        estimated = [p for p in self.parameters.values() if math.isfinite(p.ratio)]
        if not estimated:
            reasons = "; ".join(self.failures) or "too few trials"
            return Assessment.of("no parameter was told", bad=[f"No spread can be told: {reasons}"])
        ratios = [p.ratio for p in estimated]
        sentence = (
            f"{len(estimated)} parameters told in {self.solved} trials; their spread is "
            f"{min(ratios):.2f} to {max(ratios):.2f} times the predicted standard deviation"
        )
        return Assessment.of(sentence, care=self._cautions())

    def _cautions(self) -> list[str]:
        found = []
        for word, names in (
            ("more", [n for n, p in self.parameters.items() if _off(p) and p.ratio > 1]),
            ("less", [n for n, p in self.parameters.items() if _off(p) and p.ratio < 1]),
        ):
            if names:
                found.append(f"Scattered {word} than predicted: {_listed(names)}.")
        if found and self.plan.data.kind == "bootstrap" and self.plan.data.sets.unit == "set":
            found.append(
                "Repeats of a placement share what the model gets wrong there; this bootstrap "
                "takes them for independent, the prediction does not: try --unit placement."
            )
        rarely = [n for n, p in self.parameters.items() if self._rarely(p)]
        if rarely:
            found.append(f"Not identified in every trial: {_listed(rarely)}.")
        failed = self.plan.trials - self.solved
        if failed > MANY_FAILED * self.plan.trials:
            found.append(f"{failed} of {self.plan.trials} trials gave no result.")
        return found

    def _rarely(self, parameter: ParameterSpread) -> bool:
        estimated = len(parameter.spread.values)
        return parameter.estimate.state in ESTIMATED and estimated < (1 - MANY_FAILED) * self.solved


def judge_spread(plan: StudyPlan, trials: Sequence[Trial]) -> SpreadStudy:
    """Summarise the trials of a bootstrap or a Monte-Carlo study.

    Args:
        plan: what was run.
        trials: of `run_study`.
    """
    assert plan.solution is not None
    arm = plan.solution.problem.names[: plan.solution.problem.arm_count]
    parameters = {name: _of(plan, plan.solution.estimates[name], trials) for name in arm}
    failures = Counter(trial.problem for trial in trials if trial.problem)
    solved = [trial for trial in trials if not trial.problem]
    rms = np.array([trial.rms for trial in solved if math.isfinite(trial.rms)])
    return SpreadStudy(
        plan,
        parameters,
        TrialScatter(rms),
        plan.full_rms,
        len(solved),
        dict(failures.most_common()),
    )


def _of(plan: StudyPlan, estimate: Estimate, trials: Sequence[Trial]) -> ParameterSpread:
    estimated = [t.estimates[estimate.name] for t in trials if estimate.name in t.estimates]
    values, stds = np.array(estimated).reshape(-1, 2).T
    priors = any(p.prior is not None for p in plan.data.parameters.values())
    if plan.data.kind == "bootstrap":
        predicted = math.nan if estimate.std is None else estimate.std
        return ParameterSpread(
            estimate, TrialScatter(values), predicted, len(plan.data.sets), priors
        )
    predicted = float(np.sqrt(np.mean(stds**2))) if len(stds) else math.nan
    return ParameterSpread(estimate, TrialScatter(values), predicted, 0, priors)


def _off(parameter: ParameterSpread) -> bool:
    return not parameter.as_predicted


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more
