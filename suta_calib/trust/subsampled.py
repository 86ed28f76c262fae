"""A fit as part of its rows shows it: what looks for causes among many needs no more of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from suta_calib.arrays import IntArray
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.block import first_of_each, joined, numbered
from suta_calib.terms.term import Term

# Samples of one term that show what its residuals look like: a cause that needs more of them to
# stand out is smaller than what it is mistaken for.
MOST_SAMPLES: Final = 5_000
# Corners by which a picture tells where its board is nearly as well as by a thousand: what else is
# wrong with it, they share.
ENOUGH_CORNERS: Final = 12
# Corners of a picture that are looked at, where all its noise is.
MOST_CORNERS: Final = 60


def thinned(solution: Solution) -> Solution:
    """The same solution over at most some `MOST_SAMPLES` of each term's samples, in their order.

    They are evenly spaced, and the first of every label among them, so that all unknowns stay what
    they are; of corners in pictures, some `MOST_SAMPLES` in all but `ENOUGH_CORNERS` in each. What
    rows look at together, as distances do at the touches of one placement, is kept together.
    """
    problem = solution.problem
    terms = [
        of_fewer_corners(_thinned(term), max(ENOUGH_CORNERS, MOST_SAMPLES // len(term.poses)))
        for term in problem.terms
    ]
    if all(a is b for a, b in zip(terms, problem.terms, strict=True)):
        return solution
    fewer = Problem(terms, problem.arm_parameters)
    if fewer.names != problem.names:
        return solution
    if solution.weights is not None:
        fewer = solution.weights.applied_to(fewer)
    return replace(solution, problem=fewer)


def _thinned(term: Term) -> Term:
    count = len(term.poses)
    if count <= MOST_SAMPLES:
        return term
    first = [block.samples[first_of_each(block.own_columns), 0] for block in term.blocks]
    group = _looked_at_together(term)
    kept, step = np.zeros(group.max() + 1, dtype=np.bool_), -(-count // MOST_SAMPLES)
    even = np.arange(0, len(kept), step)
    if len(kept) < count:
        # Placements often follow in turn: one of each few, but not always the same of them.
        even += np.random.default_rng(0).integers(step, size=len(even))
    kept[even[even < len(kept)]] = True
    kept[group[np.concatenate(first)]] = True
    return term if kept.all() else term.take(np.flatnonzero(kept[group]))


def _looked_at_together(term: Term) -> IntArray:
    """(samples,) groups, by first appearance, of what rows look at together, by whole places."""
    several = [block.samples for block in term.blocks if block.samples.shape[1] > 1]
    alone = np.arange(len(term.poses), dtype=np.intp)
    if not several:
        return alone
    pairs = np.concatenate([each[:, [0, k]] for each in several for k in range(1, each.shape[1])])
    links = coo_array((np.ones(len(pairs)), pairs.T), (len(alone),) * 2)
    _, together = connected_components(links, directed=False)
    return numbered(joined(together.astype(np.intp), term.places[1]))[1]


def of_fewer_corners(term: Term, most: int) -> Term:
    """The same pictures by at most so many of their corners, of one random choice from the board.

    A choice by counting would meet the board's columns, and might be one of them: a line.
    """
    samples = term.poses.samples
    if samples.pixels is None:
        return term
    order = np.random.default_rng(0).permutation(samples.pixels.shape[1])
    detected = np.isfinite(samples.pixels[:, order]).all(axis=2)
    left_out = np.cumsum(detected, axis=1) > most
    if not (left_out & detected).any():
        return term
    pixels = samples.pixels.copy()
    pixels[:, order] = np.where(left_out[:, :, None], np.nan, pixels[:, order])
    return term.over_poses(term.poses.with_samples(replace(samples, pixels=pixels)))


def spread_out(terms: Sequence[Term], most: int) -> list[Term]:
    """Some samples of each term, a random choice, with no more than so many numbers in all.

    Of pictures there are at most `MOST_CORNERS` corners each.
    """
    terms = [of_fewer_corners(term, MOST_CORNERS) for term in terms]
    share, chosen = most / max(numbers_of(terms), 1), list[Term]()
    if share >= 1.0:
        return terms
    for term in terms:
        pairs = any(block.samples.shape[1] > 1 for block in term.blocks)
        # Of distances between touches, half as many touches leave a quarter.
        count = max(round(len(term.poses) * (share**0.5 if pairs else share)), 1)
        rows = np.random.default_rng(0).permutation(len(term.poses))[:count]
        chosen.append(term.take(np.sort(rows)))
    return chosen


def numbers_of(terms: Sequence[Term]) -> int:
    """How many numbers rows are: one sample tells no more than the six of where its tip is."""
    return sum(
        min(len(block) * block.size, 6 * len(term.poses))
        if block.samples.shape[1] == 1
        else len(block) * block.size
        for term in terms
        for block in term.blocks
    )
