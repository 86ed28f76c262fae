"""Common parts of the results of pivot, hand-eye and registration, and their contradictions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from typing import Any, Final, ParamSpec, TypeVar

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.assessment import Level, attempt
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rms_length
from suta_calib.pose_calibration.optimality import Optimality
from suta_calib.solver.solution import Solution
from suta_calib.trust.evidence import Evidence
from suta_calib.trust.examination import Examination
from suta_calib.trust.hypotheses.moved_at_a_row import Moved
from suta_calib.trust.hypotheses.outlier_block import OutlierBlock
from suta_calib.trust.hypothesis import Finding
from suta_calib.trust.rule import Rule
from suta_calib.trust.uncertainty_budget import AS_STATED, KnownScatter
from suta_calib.units import text
from suta_calib.words import listed

# Part of the rows that, where they disagree, leave open who is right.
MANY_OUTLIERS: Final = 0.4
# Nor is a tool so long, or all that a tracker sees of a hand or points so large, m: they seem
# so large where millimetres are called metres.
LONGEST_TIP: Final = 10.0
LARGEST: Final = 30.0


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedRows:
    """Rows of a file that an answer was fitted to.

    Attributes:
        covariance: of the answer's unknowns, m and rad.
        residuals: (n, 3) of all rows, m.
        inliers: (n,) rows that were fitted.
        suspects: (n,) those of them that stand out, but that the others do not prove wrong; where
            all rows were to be believed, those that they do.
        notes: what the files of the data give to think about, one sentence each.
        optimality: what is proven of its being the best, where that was asked.
        numbers: (n,) of the rows in their file, from 0; None where they are all of it.
    """

    covariance: FloatArray
    residuals: FloatArray
    inliers: BoolArray
    suspects: BoolArray
    notes: tuple[str, ...] = ()
    optimality: Optimality | None = None
    numbers: IntArray | None = None

    def rows_in_file(self, which: BoolArray) -> tuple[int, ...]:
        """Numbers, from 0, of some of the rows (n,)."""
        rows = np.flatnonzero(which)
        return tuple((rows if self.numbers is None else self.numbers[rows]).tolist())

    @cached_property
    def rms(self) -> float:
        """Root mean square length of the inliers' residuals, m."""
        return rms_length(self.residuals[self.inliers])

    @property
    def outliers(self) -> tuple[int, ...]:
        """Rows judged outliers, from 0."""
        return self.rows_in_file(~self.inliers)

    def agreed(self, what: str, *turned: str) -> str:
        """How well the rows that were fitted agree, as the end of a sentence."""
        to = " and ".join([text(self.rms, "m", with_unit=True), *turned])
        return f"{int(self.inliers.sum())} of {len(self.inliers)} {what} agree to {to} RMS"


def set_aside(what: str, inliers: BoolArray, names: str = "they") -> list[str]:
    """That many rows, ``what`` in the plural, were left out, where it is not too many."""
    lost = int(np.sum(~inliers))
    # So many are no accident.
    if not 0.3 < lost / len(inliers) <= MANY_OUTLIERS:
        return []
    return [
        f"{lost} of {len(inliers)} {what} do not agree with the others and are left out, more "
        f"than is usual. Find out what {names} have in common."
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class RobustAnswer(FittedRows):
    """Common base of the results of pivot, hand-eye and registration.

    Attributes:
        solution: of the solver.
        all_believed: whether they were to be: plain least squares.
        unjudged: what of judging it failed, one sentence each.
        examination: the answer, prepared for the hypotheses about wrong data.
        weighed: the evidence on every hypothesis about wrong data, supported or not.
        rule: when evidence is reported.
        scatter: how well the scatter behind the covariance is known.
    """

    solution: Solution
    all_believed: bool = False
    unjudged: tuple[str, ...] = ()
    examination: Examination | None = None
    weighed: tuple[Finding, ...] = ()
    rule: Rule = Rule()
    scatter: KnownScatter = AS_STATED

    def evidence(self, hypothesis: str) -> Evidence | None:
        """On a hypothesis by its name; None where it was not tested."""
        return next((f.evidence for f in self.weighed if f.hypothesis.name == hypothesis), None)

    def finding(self, hypothesis: str) -> Finding | None:
        """A hypothesis by its name, where the data support it."""
        return next((f for f in self.findings if f.hypothesis.name == hypothesis), None)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Hypotheses about wrong data that the data support."""
        return tuple(finding for finding in self.weighed if finding.supported(self.rule))

    @property
    def moved(self) -> Finding | None:
        """What was moved while rows were measured, or where outliers begin; None if nothing."""
        return self.finding(Moved.name) or self.finding(OutlierBlock.name)

    def others_found(self, *but: str) -> list[str]:
        """Sentences about all other findings; those ``but`` are the answer's own."""
        but = (*but, Moved.name, OutlierBlock.name)
        return [f.sentence for f in self.findings if f.hypothesis.name not in but]

    def objections(self, what: str, inliers: BoolArray, size: float = 0.0) -> list[str]:
        """Reasons why the result must not be used, one sentence each."""
        objections = list[str]()
        if size > LARGEST:
            objections.append(
                f"The {what} span {size:.0f} m, more than any tool, hand or target. Are they in "
                "mm? Then name the columns x_mm, y_mm, z_mm."
            )
        if not self.solution.converged:
            objections.append(f"The solver did not converge: {self.solution.sentence}.")
        share = 1.0 - float(inliers.mean())
        if share > MANY_OUTLIERS:
            objections.append(f"{share:.0%} of the {what} do not agree with the others.")
        return objections

    def notes_on_rows(self, what: str) -> list[str]:
        """Rows, ``what`` in the plural, that are far from the others but were used."""
        rows = listed([str(row) for row in self.rows_in_file(self.suspects)])
        if not rows:
            return []
        if self.all_believed:
            return [
                f"Of the {what}, {rows} (rows from 0) contradict the others and make the result "
                "wrong, because --no-robust uses all rows. Solve robustly, or find out what "
                "happened in these rows."
            ]
        return [
            f"Of the {what}, {rows} (rows from 0) are far from the others. There are too few "
            "others to prove them wrong: they are used, and ± is wider because of them."
        ]


P = ParamSpec("P")
A = TypeVar("A", bound=RobustAnswer)


def doubting(solve: Callable[P, A]) -> Callable[P, A]:
    """A solver that tells which rows contradict the others where it is to believe all of them.

    Args:
        solve: believes all rows where its keyword ``robust`` is False; what it would leave out
            otherwise are then the `suspects` of its answer.
    """

    @wraps(solve)
    def solved(*args: P.args, **kwargs: P.kwargs) -> A:
        answer = solve(*args, **kwargs)
        if kwargs.get("robust", True):
            return answer
        judging: dict[str, Any] = {**kwargs, "robust": True}
        failed = list[str]()
        suspects = attempt(
            "judged: rows that contradict the others",
            lambda: _contradicting(lambda: solve(*args, **judging), answer),
            answer.suspects,
            failed,
        )
        unjudged = (*answer.unjudged, *failed)
        return replace(answer, suspects=suspects, all_believed=True, unjudged=unjudged)

    return solved


def _contradicting(solve_robustly: Callable[[], RobustAnswer], answer: RobustAnswer) -> BoolArray:
    """(n,) rows that a robust answer leaves out."""
    try:
        wrong = solve_robustly().outliers
        return np.isin(answer.rows_in_file(np.ones_like(answer.inliers)), wrong)
    except SamplesError:
        # Too few rows agree to identify the correct ones.
        return answer.suspects


def exchanged(held: FloatArray, standing: FloatArray, std: float) -> Level:
    """Whether what is on the tool lies farther from it than what stands lies from its frame, m.

    Inverted poses exchange the two, and leave no residual that would tell. ``care`` where it does
    by more than chance (``std``); ``bad`` where no tool is that long either.
    """
    near, far = float(np.linalg.norm(held)), float(np.linalg.norm(standing))
    # Standard deviations by which one of two lengths is the longer.
    if near - far <= 3.0 * std:
        return "good"
    # Nothing that a hand holds reaches farther than a metre.
    return "bad" if near > max(1.0, 2.0 * far) else "care"
