"""Where the bases of the robots in a cell stand, as far as a search needs to know.

The pose of a robot's base may be anything: from where its URDF would have it no descent is sure to
find it. All arms stay as they are drawn, and each unknown base is turned through the 24 rotations
that take a cube to itself; from each of them the pose, and what else is unknown outside the arms,
go downhill.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.model.parameters import ParameterSet, is_base
from suta_calib.solver.nlp import RobustNlp
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.terms.term import Term


def with_bases_found(terms: Sequence[Term], parameters: ParameterSet) -> ParameterSet:
    """The unknowns of arms, those of bases that may be anywhere about where they roughly are."""
    owners = dict.fromkeys(
        p.owner for p in parameters.values() if is_base(p.owner) and p.free and p.prior is None
    )
    anywhere = ParameterSet(p for p in parameters.values() if p.owner in owners)
    if not anywhere:
        return parameters
    problem = Problem(terms, anywhere)
    free = np.flatnonzero([p.free for p in problem.parameters.values()])
    nlp = RobustNlp(problem, free, problem.assumed_sigmas())
    turns = [name for name in anywhere if name.endswith(".rx")]
    starts = []
    for rotation in _cube():
        vector = vector_from_rotation(rotation)
        values = {
            f"{name[:-1]}{axis}": float(angle)
            for name in turns
            for axis, angle in zip("xyz", vector, strict=True)
        }
        starts.append(problem.start(values))
    ends = SolverOptions(confirm=False).build_solver().minimise_all(nlp, starts, lambda _: None)
    best = min(ends, key=lambda end: end.cost if np.isfinite(end.cost) else np.inf)
    solved = problem.values(best.x)
    return ParameterSet(
        replace(p, nominal=solved[name]) if name in anywhere and p.free else p
        for name, p in parameters.items()
    )


def _cube() -> list[FloatArray]:
    """The 24 rotations that take a cube to itself, the one that does nothing first."""
    rotations = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for signs in product((1.0, -1.0), repeat=3)
        for order in permutations(range(3))
    ]
    return [rotation for rotation in rotations if np.linalg.det(rotation) > 0]
