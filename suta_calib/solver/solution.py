"""The solution: values, their covariance, and whether they can be used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np

from suta_calib import plotting
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable, named
from suta_calib.errors import ParameterError
from suta_calib.model.parameters import Parameter
from suta_calib.plotting.look import Change
from suta_calib.solver.covariance import Spread
from suta_calib.solver.identifiability import Identification
from suta_calib.solver.interface import Minimum
from suta_calib.solver.ipopt import STALLED
from suta_calib.solver.nlp import SAME_COST
from suta_calib.solver.problem import Problem
from suta_calib.solver.weights import Weights
from suta_calib.terms.length_scale import scale_carriers
from suta_calib.terms.term import Term
from suta_calib.units import Unit

State = Literal["identified", "unidentified", "prior", "at_bound", "fixed"]
# Who judges a solution, and is made of solutions.
_JUDGE: Final = "suta_calib.trust.assessment"
# Of the variance that a prior leaves, the part the data must take away to call it identified.
INFORMED = 0.5


@dataclass(frozen=True)
class Estimate(Displayable):
    """One parameter after the fit.

    Attributes:
        name, owner, unit, nominal: as in the problem.
        value: the estimate; nominal if the parameter was not estimated.
        std: its standard deviation, None where the value is not an estimate.
        state: ``identified``; ``unidentified`` (fixed at nominal, the data cannot tell);
            ``prior`` (most of what is known of it was known before); ``at_bound``; ``fixed``
            (not asked for).
        given: fixed parameters relative to which the value has its meaning.
    """

    name: str
    owner: str
    unit: Unit
    nominal: float
    value: float
    std: float | None
    state: State
    given: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Displayable):
    """The result of `solve`.

    Attributes:
        problem: what was solved.
        minimum: the best of all starts.
        attempts: every start's end, in order.
        before: what the data could tell at the start.
        identification: what they can tell at the solution: this decided what was fixed.
        free: indices of the parameters that were estimated.
        spread: how sure the values are, by origin.
        sigmas: noise of each block that weighs it, m or rad per component.
        noise: noise of each block as the residuals show it.
        timing: seconds by phase.
        weights: what was learned of noise levels and priors; None where they are as given.
        widening: factor on all standard deviations but the scale's part of them, from held-out
            errors that are larger than the fitted rows explain (`trust.held_out`).
    """

    problem: Problem
    minimum: Minimum
    attempts: tuple[Minimum, ...]
    before: Identification
    identification: Identification
    free: IntArray
    spread: Spread
    sigmas: tuple[float, ...]
    noise: tuple[float, ...]
    timing: dict[str, float]
    weights: Weights | None = None
    widening: float = 1.0

    @property
    def covariance(self) -> FloatArray:
        """(n, n) of all parameters, m and rad; zero rows where nothing was estimated."""
        return np.asarray(self.covariance_within_scale + self.spread.of_scale)

    @property
    def artefact_covariance(self) -> FloatArray:
        """(n, n), the part of it that comes from the artefact's stated uncertainty.

        Further touches cannot reduce it; zero where none is stated.
        """
        return self.spread.of_artefact

    @property
    def covariance_within_scale(self) -> FloatArray:
        """(n, n), in units of what carries the scale: `covariance` without its error."""
        return self.spread.within_scale * self.widening**2

    def covariance_seen_by(self, terms: Sequence[Term]) -> FloatArray:
        """(n, n) of what other observations should agree with: their own scale cancels.

        Args:
            terms: over the same arm; of another instrument, artefact or board all counts.
        """
        fitted = {(c.what, c.name) for c in scale_carriers(self.problem.terms)}
        same = all((c.what, c.name) in fitted for c in scale_carriers(terms))
        return self.covariance_within_scale if same else self.covariance

    @property
    def converged(self) -> bool:
        """Whether the best start ended in a minimum that fits well enough to be used."""
        return self.minimum.converged and not self.swamped

    @property
    def swamped(self) -> bool:
        """Whether the residuals are so large that the data determine almost nothing."""
        arm = self.problem.arm_count
        asked = sum(p.free for p in list(self.problem.parameters.values())[:arm])
        promised = asked - int(np.sum(self.before.fixed < arm))
        estimated = asked - int(np.sum(self.identification.fixed < arm))
        return estimated < promised / 2

    @property
    def agreeing(self) -> int:
        """Number of starts that ended in the lowest minimum."""
        lowest = min(a.cost for a in self.attempts)
        return sum(a.cost <= lowest * (1 + 1e-6) + SAME_COST for a in self.attempts)

    @property
    def sentence(self) -> str:
        """One sentence on whether the values can be used."""
        if self.minimum.converged and self.swamped:
            return (
                "not usable: the residuals are so large that these data determine almost nothing; "
                "look for a wrong unit, a wrong artefact, or a joint that turns the other way"
            )
        if not self.converged:
            stopped = f"{self.minimum.solver} said {self.minimum.status}"
            if self.minimum.status == STALLED:
                stopped = "no step lowered the cost, although it is not at a minimum,"
            return (
                f"not converged: {stopped} after "
                f"{self.minimum.iterations} iterations; look at the residuals for a wrong unit or "
                "artefact, tighten the bounds, or raise solver.max_iterations"
            )
        estimated = len(self.free)
        return (
            f"converged: {estimated} of {estimated + len(self.identification.fixed)} unknowns "
            f"estimated; {self.agreeing} of {len(self.attempts)} starts reached the same minimum"
        )

    @cached_property
    @judged
    def assessment(self) -> Assessment:
        """The verdict on the values, with notes.

        Judged when it is asked for, and of the fitted data alone: `calibrate` takes validation
        data too.
        """
        assessment: Assessment = named(_JUDGE, "assess_solution")(self)
        return assessment

    @property
    def x(self) -> FloatArray:
        """The parameter vector, in the problem's order."""
        return self.minimum.x

    @property
    def values(self) -> dict[str, float]:
        """Every parameter's value by name, SI."""
        return self.problem.values(self.x)

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Names of the parameters that the data do not determine."""
        return tuple(e.name for e in self.estimates.values() if e.state == "unidentified")

    @property
    def prior_variance(self) -> FloatArray:
        """(n,) of every parameter before the data, m² and rad²; inf where nothing was known."""
        with np.errstate(divide="ignore"):
            prior = 1.0 / self.problem.stated_precision()
        return prior if self.weights is None else prior + np.diag(self.weights.covariance)

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Every parameter with its standard deviation and state, in the problem's order."""
        variance = np.maximum(np.diag(self.covariance), 0.0)
        prior = self.prior_variance
        # A misfit may scatter an estimate more, but nobody knows less than before the data.
        std = np.sqrt(np.minimum(variance, prior))
        free, fixed = set(self.free.tolist()), set(self.identification.fixed.tolist())
        estimates_by_name = {}
        for k, p in enumerate(self.problem.parameters.values()):
            state = self._state(k, p, std[k] ** 2 > INFORMED * prior[k], free, fixed)
            given = self.identification.given(p.name) if k in free else ()
            spread = float(std[k]) if state in ("identified", "prior") else None
            estimates_by_name[p.name] = Estimate(
                p.name, p.owner, p.unit, p.nominal, float(self.x[k]), spread, state, given
            )
        return estimates_by_name

    @property
    def arm_estimates(self) -> dict[str, Estimate]:
        """Estimates of the arm's parameters, without the terms' own unknowns."""
        return {name: self.estimates[name] for name in self.problem.names[: self.problem.arm_count]}

    @property
    def arm_covariance(self) -> tuple[tuple[str, ...], FloatArray]:
        """Names (p,) of the arm's parameters, and their covariance (p, p).

        Of those that were estimated; then of those held at nominal that the tip hangs on though no
        residual shows it (`solver.held_geometry`), with the errors that all of them share.
        """
        rows = self.free[self.free < self.problem.arm_count]
        names, covariance = (
            [self.problem.names[k] for k in rows],
            self.covariance[np.ix_(rows, rows)],
        )
        if (held := self.spread.held) is None:
            return tuple(names), covariance
        across = held.of_estimate[rows] @ held.of_held.T
        both = np.block([[covariance, across], [across.T, held.of_held @ held.of_held.T]])
        return (*names, *held.names), both

    @property
    def in_a_line(self) -> str:
        """`sentence`."""
        return self.sentence

    @property
    def changes(self) -> list[Change]:
        """Change of every estimated parameter of the arm from nominal."""
        return [
            Change(e.name, e.unit, e.value - e.nominal, e.std, e.state == "prior")
            for e in self.arm_estimates.values()
            if e.std
        ]

    def plot_parameters(self, figure: Any = None) -> Any:
        """Draw the changes of the arm's parameters, ± one standard deviation, mm and deg.

        Args:
            figure: an empty `Figure` or `SubFigure`, for there is a panel for each unit; a new
                one by default.

        Returns:
            The figure.

        Raises:
            ParameterError: no parameter of the arm was estimated.
        """
        if not self.changes:
            raise ParameterError("no estimated parameter of the arm", "at least one to draw")
        height = 1.0 + plotting.ROW_HEIGHT * len(self.changes)
        figure = plotting.figure_or_new(figure, (plotting.WIDTH, height))
        plotting.draw_changes(figure, self.changes)
        return figure

    def plot_residuals(self, ax: Any = None) -> Any:
        """Draw a histogram of the residuals with the nominal arm and with this one.

        They are those of the fitted rows of the first kind of observation; own unknowns (where an
        artefact stands) begin in closed form for the nominal arm.

        Args:
            ax: `Axes` to draw on; those of a new figure by default.

        Returns:
            The `Axes`: mm, or degrees.
        """
        problem, first = self.problem, self.problem.terms[0].blocks[0]
        pairs = [(term.kind, block) for term in problem.terms for block in term.blocks]
        same_kind = [
            k
            for k, (kind, block) in enumerate(pairs)
            if (kind, block.name) == (problem.terms[0].kind, first.name)
        ]
        norms = []
        for x in (problem.start(), self.x):
            lines = problem.linearise(x, problem.assumed_sigmas())
            sizes = [np.linalg.norm(lines[k].residual, axis=1) for k in same_kind]
            norms.append(np.concatenate(sizes))
        axes = plotting.axes_or_new(ax, (6.5, 3.2))
        plotting.draw_histogram(axes, norms[0], norms[1], first.unit, first.name)
        return axes

    def correlation(self, *, arm: bool = False) -> tuple[tuple[str, ...], FloatArray]:
        """Correlations of the estimates.

        Args:
            arm: leave out the terms' own unknowns.

        Returns:
            Names (n,) of the estimated parameters, and their correlation matrix (n, n).
        """
        names = self.problem.names[: self.problem.arm_count if arm else None]
        rows = [k for k, name in enumerate(names) if self.estimates[name].std]
        covariance = self.covariance[np.ix_(rows, rows)]
        std = np.sqrt(np.diag(covariance))
        return tuple(names[k] for k in rows), covariance / np.outer(std, std)

    def _state(
        self, k: int, p: Parameter, as_before: bool, free: set[int], fixed: set[int]
    ) -> State:
        if k in fixed:
            return "unidentified"
        if not p.free:
            return "fixed"
        if k not in free or near_bound(p, float(self.x[k])):
            return "at_bound"
        return "prior" if as_before else "identified"


def near_bound(parameter: Parameter, value: float) -> bool:
    """Whether a value ended on one of its bounds."""
    gap, width = (
        min(value - parameter.lower, parameter.upper - value),
        parameter.upper - parameter.lower,
    )
    # A mass has one bound only.
    width = width if math.isfinite(width) else parameter.plausible
    return math.isfinite(gap) and gap < 1e-5 * width
