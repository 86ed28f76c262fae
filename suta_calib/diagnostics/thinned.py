"""A fit as part of its rows shows it: what looks for causes among many needs no more of them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from suta_calib.arrays import IntArray
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.term import Term

# Samples of one term that show what its residuals look like: a cause that needs more of them to
# stand out is smaller than what it is mistaken for.
MOST_SAMPLES: Final = 5_000


@lru_cache(maxsize=4)
def thinned(solution: Solution) -> Solution:
    """The same solution over at most some `MOST_SAMPLES` of each term's samples, in their order.

    They are evenly spaced, and the first of every label among them, so that all unknowns stay what
    they are. Terms whose rows look at several samples, such as distances, are kept as they are.
    """
    problem = solution.problem
    terms = [_thinned(term) for term in problem.terms]
    if all(a is b for a, b in zip(terms, problem.terms, strict=True)):
        return solution
    fewer = Problem(terms, problem.arm_parameters)
    if fewer.names != problem.names:
        return solution
    if solution.weights is not None:
        fewer = fewer.with_priors_scaled(solution.weights.prior_scale)
    return replace(solution, problem=fewer)


def _thinned(term: Term) -> Term:
    count = len(term.poses)
    single = all(block.samples.shape[1] == 1 for block in term.blocks)
    if count <= MOST_SAMPLES or not single:
        return term
    even = np.arange(0, count, -(-count // MOST_SAMPLES), dtype=np.intp)
    rows: list[IntArray] = [even]
    for block in term.blocks:
        _, first = np.unique(block.own, axis=0, return_index=True)
        rows.append(block.samples[first, 0])
    return term.take(np.unique(np.concatenate(rows)))
