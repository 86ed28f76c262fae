"""What a data set can and cannot determine, before anything is solved.

Everything here follows from the Jacobian at the nominal arm and the assumed noise: readings are
needed, measured values are not believed yet.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from suta_calib import plotting
from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, Level, judged
from suta_calib.display import Displayable
from suta_calib.solver.covariance import predicted_covariance, predicted_scale_covariance
from suta_calib.solver.fitted import Fitted
from suta_calib.solver.held_geometry import held_geometry
from suta_calib.solver.identifiability import WEAK, Identification, schur_complement
from suta_calib.solver.information import Information, predicted_information
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import INFORMED, State
from suta_calib.solver.solve import identify_at
from suta_calib.trust.explanation import Explanation, explain
from suta_calib.trust.prior_splits import PriorSplit, prior_splits
from suta_calib.trust.scale_effects import held_scale
from suta_calib.units import Unit


@dataclass(frozen=True)
class Indices:
    """Observability indices of L parameters from m samples; larger is better.

    All are dimensionless: σ1 ≥ … ≥ σL are the singular values of the Jacobian with residuals in
    units of their noise and parameters in units of their plausible range. Compared and proven in
    Sun, Hollerbach (2008), doi:10.1109/ROBOT.2008.4543393.

    Attributes:
        o1: (σ1 … σL)^(1/L) / √m, D-optimality; Borm, Menq (1991),
            doi:10.1177/027836499101000106.
        o2: σL / σ1, the inverse condition number; Driels, Pathre (1990).
        o3: σL, E-optimality; Nahvi, Hollerbach, Hayward (1994).
        o4: σL² / σ1, noise amplification; Nahvi, Hollerbach (1996).
        o5: 1 / Σ 1/σ, A-optimality; Sun, Hollerbach (2008).
    """

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float

    @classmethod
    def of(cls, singular_values: FloatArray, samples: int) -> Indices:
        """Indices of singular values (L,), any order; all zero where one is zero or there is none.

        Args:
            singular_values: of the scaled, whitened Jacobian of the parameters in question.
            samples: number of measured poses, m.
        """
        s = np.asarray(singular_values, dtype=float)
        if not len(s) or s.min() <= 0.0 or samples < 1:
            return cls(0.0, 0.0, 0.0, 0.0, 0.0)
        least, most = float(s.min()), float(s.max())
        o1 = float(np.exp(np.mean(np.log(s)))) / samples**0.5
        return cls(o1, least / most, least, least**2 / most, 1.0 / float(np.sum(1.0 / s)))

    def as_dict(self) -> dict[str, float]:
        """By the names of the literature, ``O1`` … ``O5``."""
        return {name.upper(): value for name, value in asdict(self).items()}


@dataclass(frozen=True)
class Prospect(Displayable):
    """One parameter before the fit.

    Attributes:
        name, owner, unit, nominal: as in the problem.
        plausible: how far off it might be, m or rad: the yardstick for ``std``.
        bound: half-width of its bounds, or None without bounds.
        prior: standard deviation of its prior, or None.
        std: predicted standard deviation, m or rad; None where it would not be estimated.
        state: what it would come out as: ``identified``, ``unidentified``, ``prior``, ``fixed``.
        given: fixed parameters relative to which its value would have its meaning.
        redundant: whether no data of these kinds could tell it.
        as_drawn: whether the tip depends on it all the same; otherwise it is a convention.
    """

    name: str
    owner: str
    unit: Unit
    nominal: float
    plausible: float
    bound: float | None
    prior: float | None
    std: float | None
    state: State
    given: tuple[str, ...] = ()
    redundant: bool = False
    as_drawn: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Observability(Displayable):
    """What the data of a problem can tell.

    Attributes:
        problem: what was asked about.
        identification: which parameters would be held, and their combinations.
        prospects: every parameter, in the problem's order.
        explanations: one for each held parameter: why, and what to do.
        samples: number of measured poses.
        equations: number of residual components.
        unknowns: number of free parameters, the terms' own included.
        asked: number of free parameters of the arm (of the terms, where there is no arm).
        rank: how many of those are determined by the data (and priors).
        singular_values: (L,) of the identified parameters' Jacobian, descending; the terms' own
            unknowns are free to follow. Parameters in plausible ranges, residuals in sigmas.
        indices: O1 to O5 of these singular values.
        notes: which held length carries the scale; a reason for care unless the arm's grade says
            how good it is.
        splits: zeros of joints that only priors tell apart; a reason for care.
    """

    problem: Problem
    identification: Identification
    prospects: dict[str, Prospect]
    explanations: tuple[Explanation, ...]
    samples: int
    equations: int
    unknowns: int
    asked: int
    rank: int
    singular_values: FloatArray
    indices: Indices
    notes: tuple[str, ...] = ()
    splits: tuple[PriorSplit, ...] = ()

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Names of the parameters that would be held."""
        return tuple(p.name for p in self.prospects.values() if p.state == "unidentified")

    @property
    def redundant(self) -> tuple[str, ...]:
        """Those of them that no data of these kinds could tell."""
        return tuple(e.fixed for e in self.explanations if e.reason == "redundant")

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; inf where nothing is identified."""
        s = self.singular_values
        return float(s[0] / s[-1]) if len(s) and s[-1] > 0 else float("inf")

    @property
    def sentence(self) -> str:
        """One sentence on what to expect."""
        determined = f"{self.rank} of {self.asked} unknowns can be determined"
        by_prior = sum(p.state == "prior" for p in self.prospects.values())
        prior = f", {by_prior} of them mostly by their priors" if by_prior else ""
        arm = set(self.problem.names[: self.problem.arm_count])
        conventions = len(arm.intersection(self.redundant))
        redundant = f"; {conventions} redundant" if conventions else ""
        samples = f"{self.samples} samples ({self.equations} equations)"
        return f"{determined} from {samples}{prior}{redundant}"

    @property
    def in_a_line(self) -> str:
        """`sentence`."""
        return self.sentence

    def plot(self, ax: Any = None) -> Any:
        """Draw how well each parameter of the arm will be known, beside how far off it may be.

        Args:
            ax: `Axes` to draw on; those of a new figure by default.

        Returns:
            The `Axes`: a bar for each parameter, on a log axis without unit.
        """
        asked = [p for p in self.prospects.values() if p.state != "fixed"]
        arm = set(self.problem.names[: self.problem.arm_count])
        shown = [p for p in asked if p.name in arm] or asked
        axes = plotting.axes_or_new(ax, (6.5, 1.2 + plotting.ROW_HEIGHT * len(shown)))
        shares = [None if p.std is None else p.std / p.plausible for p in shown]
        plotting.draw_prospects(axes, [p.name for p in shown], shares, WEAK)
        return axes

    @property
    @judged
    def assessment(self) -> Assessment:
        """Care where other data could tell what these cannot; `explanations` say which."""
        open_ones = len(self.unidentified) > len(self.redundant)
        arm = self.problem.arm
        assumed = bool(self.notes) and (arm is None or not all(arm.grades.values()))
        notes = (*(split.sentence for split in self.splits), *self.notes)
        level: Level = "care" if open_ones or assumed or self.splits else "good"
        return Assessment(level, self.sentence, notes)


@checked
def observe(problem: Problem, x: FloatArray | None = None) -> Observability:
    """Predict what a calibration with these readings would and would not find.

    Args:
        problem: terms and parameters.
        x: (n,) where to linearise; nominal with closed-form own unknowns by default.

    Returns:
        States, predicted standard deviations and indices at the assumed noise levels.
    """
    x = problem.start() if x is None else x
    sigmas = problem.assumed_sigmas()
    information = predicted_information(problem, x, sigmas)
    identification = identify_at(problem, x, sigmas)
    free = np.array([p.free for p in problem.parameters.values()], dtype=bool)
    held = np.zeros(len(free), dtype=bool)
    held[identification.fixed] = True
    estimated = np.flatnonzero(free & ~held)
    explanations = explain(problem, x, identification)
    covariance = predicted_covariance(problem, information, estimated)
    fit = Fitted(problem, x, sigmas, estimated)
    covariance += predicted_scale_covariance(fit)
    held_length = None
    geometry = held_geometry(fit, covariance, robust=False)
    if geometry is not None:
        covariance += geometry.of_estimate @ geometry.of_estimate.T
        held_length = held_scale(problem, geometry)
    with np.errstate(divide="ignore"):
        splits = prior_splits(problem, x, covariance, 1.0 / problem.stated_precision())
    prospects = _prospects(problem, covariance, identification, estimated)
    prospects |= {
        e.fixed: replace(prospects[e.fixed], redundant=True, as_drawn=e.as_drawn)
        for e in explanations
        if e.reason == "redundant"
    }
    judged = slice(problem.arm_count or len(free))
    asked, fixed = int(free[judged].sum()), int(held[judged].sum())
    singular = _singular_values(problem, information, prospects)
    samples = sum(len(term.poses) for term in problem.terms)
    return Observability(
        problem=problem,
        identification=identification,
        prospects=prospects,
        explanations=explanations,
        samples=samples,
        equations=sum(len(block) * block.size for block in problem.blocks),
        unknowns=int(free.sum()),
        asked=asked,
        rank=asked - fixed,
        singular_values=singular,
        indices=Indices.of(singular, samples),
        notes=() if held_length is None else (held_length.sentence,),
        splits=splits,
    )


def _prospects(
    problem: Problem, covariance: FloatArray, identification: Identification, estimated: IntArray
) -> dict[str, Prospect]:
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # As of an estimate: nobody knows less than before the data.
    std = np.fmin(
        std, [np.inf if p.prior is None else p.prior for p in problem.parameters.values()]
    )
    will_be = set(estimated.tolist())
    prospects = {}
    for k, p in enumerate(problem.parameters.values()):
        predicted = float(std[k]) if k in will_be else None
        state: State = "identified"
        if not p.free:
            state = "fixed"
        elif predicted is None:
            state = "unidentified"
        elif p.prior is not None and predicted**2 > INFORMED * p.prior**2:
            state = "prior"
        given = () if predicted is None else identification.given(p.name)
        bound = p.upper - p.nominal if np.isfinite(p.upper) else None
        properties = (p.name, p.owner, p.unit, p.nominal, p.plausible, bound, p.prior)
        prospects[p.name] = Prospect(*properties, predicted, state, given)
    return prospects


def _singular_values(
    problem: Problem, information: Information, prospects: dict[str, Prospect]
) -> FloatArray:
    """Of the identified parameters' Jacobian, after the own unknowns have followed."""
    identified = np.array([p.state == "identified" for p in prospects.values()])
    unit = problem.parameters.array("plausible")
    scaled = information.curvature * np.outer(unit, unit)
    arm = np.arange(len(unit)) < (problem.arm_count or len(unit))
    arm_columns, own_columns = np.flatnonzero(identified & arm), np.flatnonzero(identified & ~arm)
    (reduced,) = schur_complement([scaled], np.zeros(len(unit)), arm_columns, own_columns)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(reduced)[::-1], 0.0)))
