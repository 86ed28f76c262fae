"""What the standard uncertainty of a calibrated tip is made of, source by source.

The covariance of an estimate is a sum over sources (`solver.covariance`). Each is pushed through
the kinematics to the tip, at the postures of the fitted rows, and the motion that all postures
share is taken out, as a registration does: where a base frame is drawn is a convention. What is
left of a source is its contribution, in the sense of the GUM (JCGM 100:2008, 5.1): type A where
scatter shows it, type B where a statement of somebody does (a certificate, a drawing, a prior).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from scipy.special import stdtrit

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.solver.covariance import Source
from suta_calib.solver.held_geometry import registered_motion
from suta_calib.solver.solution import Solution
from suta_calib.terms.length_scale import scale_carriers
from suta_calib.terms.term import Term
from suta_calib.units import Unit
from suta_calib.words import listed

Evaluation = Literal["A", "B", "A, B"]
# What two standard deviations of a normal distribution hold.
COVERAGE: Final = 0.9545
SOURCES: Final[dict[Source, tuple[str, Evaluation]]] = {
    "scatter": ("scatter of the measurements", "A"),
    "noise levels": ("noise levels estimated from the same rows", "A"),
    "priors": ("priors of the parameters, as the job states them", "B"),
    "artefact": ("certified coordinates of the artefact", "B"),
    "seating": ("seats and links that keep their URDF values", "B"),
    "sensors": ("noise of the tilt sensors", "B"),
}
NOTHING: Final[Mapping[str, FloatArray]] = MappingProxyType({})
STATED: Final = "standard deviations that the files state"


@dataclass(frozen=True)
class KnownScatter(Displayable):
    """How well the scatter behind a covariance is known.

    Attributes:
        freedom: degrees of freedom; infinite where somebody states the scatter.
        student: whether the covariance has Student's variance for them already.
    """

    freedom: float = math.inf
    student: bool = False


AS_STATED: Final = KnownScatter()


@dataclass(frozen=True)
class Contribution(Displayable):
    """One source of uncertainty.

    Attributes:
        source: what it is.
        evaluation: ``A``, from scatter; ``B``, from what somebody states; both in a sum.
        std: its part of the standard uncertainty, in the unit of the budget.
        freedom: degrees of freedom behind it; infinite for a statement.
        student: whether the standard uncertainty is that of Student's distribution, and so √(ν/(ν -
            2)) times what scatters (JCGM 101:2008, 6.4.9.4): twice it covers what it should.
    """

    source: str
    evaluation: Evaluation
    std: float
    freedom: float = math.inf
    student: bool = False

    @property
    def uncertain(self) -> float:
        """Degrees of freedom that a coverage factor must still allow for."""
        return math.inf if self.student else self.freedom


@dataclass(frozen=True)
class UncertaintyBudget(Displayable):
    """Contributions to one measurand; those of different sources are independent.

    Attributes:
        of: the measurand.
        unit: of the standard uncertainties.
        contributions: of every source that adds something.
        name: of what the measurand belongs to, for keys.
    """

    of: str
    unit: Unit
    contributions: tuple[Contribution, ...]
    name: str = ""

    @property
    def std(self) -> float:
        """Combined standard uncertainty."""
        return math.sqrt(sum(part.std**2 for part in self.contributions))

    @property
    def freedom(self) -> float:
        """Effective degrees of freedom, by Welch and Satterthwaite (JCGM 100:2008, G.4.1).

        Those that a standard uncertainty allows for already (`Contribution.student`) do not count.
        """
        told = sum(part.std**4 / part.uncertain for part in self.contributions)
        return self.std**4 / told if told else math.inf

    @property
    def combined(self) -> Contribution:
        """All contributions together, with their effective degrees of freedom.

        Those count here that a standard uncertainty allows for already, too.
        """
        types = {part.evaluation for part in self.contributions}
        kind: Evaluation = types.pop() if len(types) == 1 else "A, B"
        told = sum(part.std**4 / part.freedom for part in self.contributions)
        freedom = self.std**4 / told if told else math.inf
        student = any(part.student for part in self.contributions)
        return Contribution("combined", kind, self.std, freedom, student)

    @property
    def factor(self) -> float:
        """Coverage factor for 95.45 %, by Student's t; 2 where much is known of the scatter."""
        return coverage_factor(self.freedom)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty."""
        return self.factor * self.std


def coverage_factor(freedom: float) -> float:
    """Factor on a standard uncertainty for a coverage of 95.45 %, never below 2.

    Args:
        freedom: degrees of freedom of the standard uncertainty, one at least; infinite for a
            statement.
    """
    if not math.isfinite(freedom):
        return 2.0
    return max(2.0, float(stdtrit(max(freedom, 1.0), (1.0 + COVERAGE) / 2.0)))


def tip_budget(solution: Solution, unknowns: float) -> UncertaintyBudget | None:
    """The budget of one coordinate of the tip; None where nothing moves it.

    Root mean square over the three axes and the postures of the fitted rows.

    Args:
        solution: that converged.
        unknowns: how many of them the data have told (`effective_unknowns`).
    """
    fit, spread, free = solution.spread.fit, solution.spread, solution.free
    if fit.problem.arm is None or not len(free):
        return None
    # The kinematics at the solution.
    fit.problem.linearise(fit.x, fit.problem.assumed_sigmas())
    none_held = np.zeros(0, dtype=np.intp)

    def at_tip(shifts: FloatArray) -> float:
        """Of independent shifts (n, k) of the estimate, m."""
        moved = registered_motion(fit, none_held, shifts[free], np.zeros((0, shifts.shape[1])))
        return float(np.linalg.norm(moved)) / math.sqrt(len(moved))

    equations = sum(map(_equations, fit.problem.terms))
    freedom = max(equations - unknowns, 1.0)
    parts = [
        Contribution(
            name,
            kind,
            solution.widening * at_tip(_root(spread.by_source[source])),
            freedom if kind == "A" else math.inf,
        )
        for source, (name, kind) in SOURCES.items()
    ]
    by_scale, scale_std = spread.by_scale, spread.scale_std
    for carrier in scale_carriers(fit.problem.terms):
        key = carrier.what, carrier.name
        shift = scale_std[key] * by_scale[key][:, None]
        name = f"scale of the {carrier.what} ({carrier.scale.sentence})"
        parts.append(Contribution(name, "B", at_tip(shift)))
    if spread.held is not None:
        # Its motion of the tip is less that of the whole arm already.
        size = float(np.linalg.norm(spread.held.tip)) / math.sqrt(3.0)
        parts.append(Contribution(f"{listed(spread.held.carriers)} as drawn", "B", size))
    # A nanometre: what no arm shows.
    told = tuple(part for part in parts if part.std > 1e-9)
    of = "one coordinate of the tip, relative to the others (RMS of the fitted postures)"
    return UncertaintyBudget(of, "m", told, "tip") if told else None


def axis_budget(
    of: str,
    unit: Unit,
    covariance: FloatArray,
    scatter: KnownScatter,
    stated: Mapping[str, FloatArray] = NOTHING,
    shown: Mapping[str, FloatArray] = NOTHING,
) -> UncertaintyBudget:
    """The budget of one coordinate of a vector, root mean square over its axes.

    Args:
        of: the measurand.
        unit: of the vector.
        covariance: (k, k) of the vector.
        scatter: how well what is not stated is known.
        stated: (k, k) part of the covariance by each source that somebody states.
        shown: likewise by sources that scatter shows apart from the rest.
    """
    parts = {**shown, **stated}
    left = max(float(np.trace(covariance - sum(parts.values()))), 0.0)
    name, kind = SOURCES["scatter"] if math.isfinite(scatter.freedom) else (STATED, "B")
    known = max(scatter.freedom, 1.0), scatter.student

    def per_axis(variance: float) -> float:
        return math.sqrt(variance / len(covariance))

    contributions = [
        Contribution(name, kind, per_axis(left), *known),
        *(Contribution(source, "A", per_axis(np.trace(p)), *known) for source, p in shown.items()),
        *(Contribution(source, "B", per_axis(np.trace(p))) for source, p in stated.items()),
    ]
    return UncertaintyBudget(of, unit, tuple(part for part in contributions if part.std > 0.0))


def pose_budgets(
    pose: str,
    covariance: FloatArray,
    scatter: KnownScatter,
    stated: Mapping[str, FloatArray] = NOTHING,
    shown: Mapping[str, FloatArray] = NOTHING,
) -> tuple[UncertaintyBudget, ...]:
    """The budgets of a coordinate of a pose's position, and of a small turn.

    Args:
        pose: its name.
        covariance: (6, 6) displacement, m, and turn, rad.
        scatter: as in `axis_budget`.
        stated: (6, 6) likewise.
        shown: (6, 6) likewise.
    """
    of: tuple[tuple[str, Unit, slice], ...] = (
        (f"one coordinate of the position of {pose}", "m", slice(0, 3)),
        (f"a small turn of {pose} about one axis", "rad", slice(3, 6)),
    )
    return tuple(
        replace(
            axis_budget(
                *(words, unit, covariance[at, at], scatter),
                {source: part[at, at] for source, part in stated.items()},
                {source: part[at, at] for source, part in shown.items()},
            ),
            name=pose,
        )
        for words, unit, at in of
    )


def _equations(term: Term) -> float:
    """How many independent numbers a term gives at most.

    Pairs share touches and corners share a picture: a cluster tells no more than where its tip is,
    or, where it shows turns too, than a pose.
    """
    turns = any(block.unit != "m" for block in term.blocks)
    clusters = int(term.clusters.max(initial=-1)) + 1
    return min(term.equations(), (6 if turns else 3) * clusters)


def _root(covariance: FloatArray) -> FloatArray:
    """(n, n) whose square is a covariance."""
    values, axes = np.linalg.eigh(covariance)
    return np.asarray(axes * np.sqrt(np.maximum(values, 0.0)))
