"""A fit's problem with all that its arm can be given beside the fit's own unknowns.

Whether a fit lacks something is asked beside all of the geometry: a bent link must not be taken for
an eccentric encoder.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import UrdfError
from suta_calib.model.parameters import (
    CABLE,
    COMPLIANCE,
    COUPLING,
    FAMILIES,
    GEAR_RATIO,
    OFFSET,
    Family,
    ParameterSet,
)
from suta_calib.model.robot import AnyArm
from suta_calib.solver.information import curvature_at
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms import Term

LOOKS_LIKE: Final[dict[Family, str]] = {
    "ecc_1": "an eccentric encoder",
    "ecc_2": "an eccentric encoder",
    "compliance": "a joint that yields under gravity",
    "bending": "a link or bearing that bends under gravity",
    "gain": "a reading with a wrong scale factor",
    "backlash": "backlash",
    "hysteresis": "a joint that lags behind by friction",
    "ripple": "the ripple of a strain wave gear",
    "expansion": "thermal expansion",
    COUPLING: "a joint that another joint's motor moves too",
    "cable": "a joint whose cables run about the axis of its neighbour",
}


def neighbours(arm: AnyArm) -> dict[str, tuple[str, str]]:
    """Couplings to look for, by name: which joint is moved, and by whose motor.

    Those of neighbours in the chain, in either direction, and those that a ``<transmission>`` of
    the URDF says: any two joints together would explain any error.
    """
    pairs = {}
    for chain in arm.arms:
        order = [segment.owner for segment in chain.movers]
        for name, other in chain.couplings.items():
            moved = chain.nongeometric[name].owner
            beside = other in order and abs(order.index(moved) - order.index(other)) == 1
            if beside or other in chain.chain.coupled.get(moved, ()):
                pairs[name] = (moved, other)
    return pairs


def causes(family: Family, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Names of a family's parameters by cause: each other joint that moves this one is its own."""
    size = {COUPLING: 1, "cable": len(CABLE)}.get(family, len(names))
    return [tuple(names[k : k + size]) for k in range(0, len(names), size or 1)]


def recorded(terms: Iterable[Term]) -> bool:
    """Whether some samples are rows of recordings in motion, which tell what joints remember.

    An arm rests where it touches, and how it came there is not seen.
    """
    return any(t.medium != "touch" and t.poses.samples.travel is not None for t in terms)


def offered_names(
    arm: AnyArm, *, in_motion: bool = False
) -> dict[tuple[str, Family], tuple[str, ...]]:
    """Names by joint and family that this arm can be given; no compliance without masses.

    Of couplings those of `neighbours`; hysteresis and cables where rows are of recordings in
    motion: the postures of touches are too few to tell a cable from a bent link.
    """
    offered: dict[tuple[str, Family], tuple[str, ...]] = {}
    for joint in dict.fromkeys(p.owner for p in arm.nongeometric.values()):
        for family, keys in FAMILIES.items():
            names = tuple(f"{joint}.{key}" for key in keys)
            if not all(name in arm.nongeometric for name in names):
                continue
            if family == "hysteresis" and not in_motion:
                continue
            if family == "ripple" and not arm.nongeometric[f"{joint}.{GEAR_RATIO}"].nominal:
                continue
            if family in (COMPLIANCE, "bending"):
                try:
                    arm.select(*names)
                except UrdfError:
                    continue
            offered[joint, family] = names
    for name, (joint, _) in neighbours(arm).items():
        offered[joint, COUPLING] = (*offered.get((joint, COUPLING), ()), name)
    if in_motion:
        offered |= {(s.owner, "cable"): s.cables for s in arm.movers if s.cables}
    return offered


def offered_beside(problem: Problem) -> dict[tuple[str, Family], tuple[str, ...]]:
    """`offered_names` of a problem's arm, as its samples were taken."""
    assert problem.arm is not None
    return offered_names(problem.arm, in_motion=recorded(problem.terms))


def extended_problem(
    solution: Solution, candidates: Sequence[str] = ()
) -> tuple[Problem, FloatArray]:
    """The problem with all of the geometry and the candidates unknown, at the same point."""
    values = solution.values
    extended = Problem(solution.problem.terms, with_geometry(solution.problem, candidates))
    if solution.weights is not None:
        extended = extended.with_thresholds(solution.weights.thresholds)
    start = [values.get(p.name, p.nominal) for p in extended.parameters.values()]
    return extended, np.array(start)


def with_geometry(problem: Problem, candidates: Sequence[str] = ()) -> ParameterSet:
    """The arm's parameters of a problem, with all of the geometry and the candidates."""
    arm, fitted = problem.arm, problem.arm_parameters
    assert arm is not None
    more = [
        p
        for n, p in arm.offered.items()
        if n not in fitted and (n in arm.geometric or p.key == OFFSET or n in candidates)
    ]
    return ParameterSet([*fitted.values(), *more])


def effective_unknowns(solution: Solution) -> float:
    """How many unknowns the data have told: the trace of the fit's hat matrix.

    A prior takes no equation's place: only what the data tell of an unknown in spite of it, they
    spend.
    """
    problem, free = solution.problem, solution.free
    curvature = curvature_at(problem, solution.x, solution.sigmas, robust=True)
    information = curvature[np.ix_(free, free)]
    with_prior = information + np.diag(problem.prior_precision()[free])
    return float(np.trace(np.linalg.lstsq(with_prior, information, rcond=None)[0]))


def known_beforehand(problem: Problem) -> FloatArray:
    """(n,) precision of every parameter without the data: its prior's, or of what is plausible.

    Observations that never meet a length leave an arm's size open: without an end to what is
    plausible it would shrink to nothing, and take all residuals with it. Where things stand or were
    touched may be anything. It counts against rows as often as these repeat one another.
    """
    precision, terms = problem.prior_precision(), problem.terms
    rows = sum(len(b) * b.size for term in terms for b in term.blocks)
    once = problem.parameters.array("plausible") ** -2.0
    repeated = rows / sum(term.equations() for term in terms)
    open_ended = (precision == 0) & (np.arange(len(precision)) < problem.arm_count)
    return np.where(open_ended, repeated * once, precision)
