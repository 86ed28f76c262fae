"""What a camera saw, as if it were all nearer or farther: as another camera's file makes it.

Who finds poses with the focal length of another camera finds directions nearly right, and every
distance along the axis too long by one factor. Nobody knows the factor beforehand, and a nominal
arm is too coarse to tell it: it is a step of Gauss and Newton from the fit, and a fit anew.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from suta_calib.diagnostics.common_scale import scale_step
from suta_calib.errors import SutaCalibError
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import Term

# Of the axis along which a camera looks.
DEPTH: Final = (0.0, 0.0, 1.0)
# Steps, and from which on the next is none worth taking.
STEPS: Final = 4
SETTLED: Final = 1e-4
# Factors, less one, that are no rounding and still another camera's.
LEAST, MOST = 5e-3, 0.7


def other_depths(
    solution: Solution, options: SolverOptions
) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """The terms with what was seen in poses nearer or farther by one factor.

    Args:
        solution: the job's own fit, of terms over one arm.
        options: how the terms are fitted anew.

    Yields:
        What would have to be so, as the end of "the data agree if …", and the terms.
    """
    given = solution.problem
    mine = [_seen_as_poses(term) for term in given.terms]
    if not any(mine):
        return
    found, factor = solution, 1.0
    with suppress(SutaCalibError):
        for _ in range(STEPS):
            too_long = scale_step(found, "depth", mine, DEPTH).value
            factor /= 1.0 + max(too_long, LEAST - 1.0)
            if abs(factor - 1.0) > MOST:
                return
            terms = _at_depths(given.terms, mine, factor)
            if abs(too_long) < SETTLED:
                break
            found = solve(Problem(terms, given.arm_parameters), options)
        by = 1.0 / factor - 1.0
        if abs(by) > LEAST:
            yield (
                f"what was seen is {100 * abs(by):.2f} % too {'far' if by > 0 else 'near'} along "
                "the axis z of what saw it, as with another camera's file",
                terms,
            )


def _seen_as_poses(term: Term) -> bool:
    samples = term.poses.samples
    return samples.position is not None and samples.rotation is not None


def _at_depths(terms: Sequence[Term], mine: Sequence[bool], factor: float) -> tuple[Term, ...]:
    found = list[Term]()
    for term, seen in zip(terms, mine, strict=True):
        samples = term.poses.samples
        if seen and samples.position is not None:
            nearer = np.asarray(samples.position * [1.0, 1.0, factor])
            term = term.over_poses(term.poses.with_samples(replace(samples, position=nearer)))
        found.append(term)
    return tuple(found)
