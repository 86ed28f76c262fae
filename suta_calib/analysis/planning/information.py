"""What each candidate would tell about the arm, so that sets of them add up.

Every candidate has its own unknowns (where the point is, where the artefact stands); they follow
the arm and are eliminated (Schur complement), with the solver's own formulas for curvature,
variance by sample, and what noise feigns. What is left adds up over candidates, because different
candidates share no sample. An instrument's pose is shared by all samples, so it stays in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.analysis.planning.candidates import Candidate
from suta_calib.analysis.planning.situation import Situation
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.identifiability import Identification, identify, schur_complement
from suta_calib.solver.information import Information, predicted_information
from suta_calib.solver.problem import Problem
from suta_calib.terms import KINDS

# Unknowns that belong to one place: another place has its own.
_PRIVATE: Final = tuple(f"{kind.place_unknown}[" for kind in KINDS.values() if kind.place_unknown)


@dataclass(frozen=True, eq=False)
class Space:
    """The unknowns that data from different places have in common.

    Attributes:
        parameters: the arm's free ones, then those of instruments and of seats.
        arm_count: how many are the arm's.
    """

    parameters: ParameterSet
    arm_count: int

    @classmethod
    def of(cls, situation: Situation) -> Space:
        """The arm's free parameters, and unknowns of terms that are not of one place."""
        problem = situation.problem
        own = {p.name: p for t in problem.terms for p in t.own if not p.name.startswith(_PRIVATE)}
        arm = [p for p in list(problem.parameters.values())[: problem.arm_count] if p.free]
        return cls(ParameterSet([*arm, *own.values()]), len(arm))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, in order."""
        return self.parameters.names

    @property
    def unit(self) -> FloatArray:
        """(p,) how far off each might be: matrices here are in units of it."""
        return self.parameters.array("plausible")

    @property
    def precision(self) -> FloatArray:
        """(p,) 1/prior², in plausible units; zero where there is no prior."""
        prior = self.parameters.array("prior")
        known = ~np.isnan(prior)
        return np.where(known, (self.unit / np.where(known, prior, 1.0)) ** 2, 0.0)

    @property
    def regulariser(self) -> FloatArray:
        """(p,) precision of what is plausible before any data, or of the prior where it is more."""
        return np.maximum(self.precision, 1.0)

    def identify(self, information: SharedInformation, fixed: Sequence[str] = ()) -> Identification:
        """What such information determines; ``fixed`` parameters are taken as known."""
        parameters = ParameterSet(
            replace(
                p,
                prior=None if p.prior is None else p.prior / p.plausible,
                plausible=1.0,
                free=p.name not in fixed,
            )
            for p in self.parameters.values()
        )
        whole = Information(information.curvature, information.variance, information.noise_induced)
        return identify(parameters, self.arm_count, whole, self.precision)

    def covariance(self, information: SharedInformation, estimated: IntArray) -> FloatArray:
        """Sandwich (p, p) in SI units, with all but ``estimated`` taken as known."""
        inside = np.ix_(estimated, estimated)
        prior = np.diag(self.precision)
        bread = np.zeros_like(prior)
        bread[inside] = np.linalg.pinv((information.curvature + prior)[inside], 1e-12, True)
        spread = bread @ (information.variance + prior) @ bread
        return np.asarray(spread * np.outer(self.unit, self.unit))

    def plausible_covariance(self, information: SharedInformation) -> FloatArray:
        """The same with everything estimated, and plausible ranges as priors; SI units."""
        prior = np.diag(self.regulariser)
        bread = np.linalg.inv(information.curvature + prior)
        spread = bread @ (information.variance + prior) @ bread
        return np.asarray(spread * np.outer(self.unit, self.unit))


@dataclass(frozen=True, eq=False)
class SharedInformation:
    """Curvature, variance and noise-induced information (p, p), in plausible units; they add up."""

    curvature: FloatArray
    variance: FloatArray
    noise_induced: FloatArray

    def __add__(self, other: SharedInformation) -> SharedInformation:
        return SharedInformation(
            self.curvature + other.curvature,
            self.variance + other.variance,
            self.noise_induced + other.noise_induced,
        )

    def times(self, repeats: float) -> SharedInformation:
        """As many independent repeats."""
        return SharedInformation(
            repeats * self.curvature, repeats * self.variance, repeats * self.noise_induced
        )


def nothing(space: Space) -> SharedInformation:
    """No data."""
    zero = np.zeros((len(space.names),) * 2)
    return SharedInformation(zero, zero, zero)


def present(situation: Situation, space: Space) -> SharedInformation:
    """What the data at hand tell."""
    return _shared_information(situation.problem, situation.x, situation.sigmas, space)


def promised(situation: Situation, space: Space, candidate: Candidate) -> SharedInformation:
    """What a candidate would tell, all its repeats together."""
    term = situation.term(candidate)
    arm = list(situation.problem.parameters.values())[: situation.problem.arm_count]
    problem = Problem([term], ParameterSet(arm))
    values = {p.name: p.nominal for p in arm} | situation.values
    # One sample is too few for the closed-form start of what is shared and known.
    if not all(p.name in values for p in term.own):
        values = term.start_values(situation.values) | values
    x = np.array([values[name] for name in problem.names])
    return _shared_information(problem, x, situation.noise(term), space).times(candidate.repeats)


def _shared_information(
    problem: Problem, x: FloatArray, sigmas: Sequence[float], space: Space
) -> SharedInformation:
    """Information on the shared unknowns, the private ones having followed."""
    information = predicted_information(problem, x, sigmas)
    unit = problem.parameters.array("plausible")
    scale = np.outer(unit, unit)
    matrices = [information.curvature, information.variance, information.noise_induced]
    index = {name: k for k, name in enumerate(space.names)}
    fixed = {p.name for p in problem.parameters.values() if not p.free}
    kept = [k for k, name in enumerate(problem.names) if name in index]
    private = [k for k, n in enumerate(problem.names) if n not in index and n not in fixed]
    reduced = schur_complement(
        [m * scale for m in matrices],
        np.zeros(len(unit)),
        np.array(kept, dtype=np.intp),
        np.array(private, dtype=np.intp),
    )
    places = np.ix_(*[[index[problem.names[k]] for k in kept]] * 2)
    whole = [np.zeros((len(index),) * 2) for _ in reduced]
    for target, part in zip(whole, reduced, strict=True):
        target[places] = part
    return SharedInformation(*whole)
