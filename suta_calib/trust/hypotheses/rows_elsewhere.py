"""Rows of another target, or seen from another place: the same displacement in some rows."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.terms.term import Term
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, Rule, SpoiltData, Truth
from suta_calib.trust.evidence import log_ways
from suta_calib.trust.examination import samples_of
from suta_calib.trust.simulated_faults import random_shift, with_columns

# Rows of the smaller part: fewer are single mishaps, which a robust loss leaves out.
FEWEST: Final = 5


class RowsElsewhere(AddedVariable):
    """``seen = expected + d`` in some rows that nothing else names, with one d for all of them.

    Which rows these are is found from the residuals, in the axes of the base (the instrument was
    bumped, read in another frame) and in those of the tip (another target was seen). To find one
    part of k among n rows is to choose among n over k windows, and the p-value allows for it
    (Bonferroni): normal noise, however it is cut, never passes.
    """

    name = "rows elsewhere"
    about = "Some rows are of another target, or were measured from another place."

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """The likelier of the two sorts of axes, where residuals fall into two parts."""
        count = len(answer.position)
        if count < 2 * FEWEST or any(b.samples.shape[1] > 1 for b in answer.problem.blocks):
            return
        best: tuple[float, str, FloatArray, BoolArray] | None = None
        for frame, axes in (("base", np.eye(3)), ("tip", answer.rotation)):
            columns = answer.by_shift(np.broadcast_to(axes, (count, 3, 3)))
            split = _two_parts(_displacements(answer, columns), answer.rule)
            if split is not None and (best is None or split[0] < best[0]):
                best = split[0], frame, columns, split[1]
        if best is not None:
            _, frame, columns, smaller = best
            window = answer.row_of_sample(smaller.astype(float))
            ways = log_ways(len(smaller), int(smaller.sum()))
            about = smaller, answer
            yield Effect(frame, columns, windows=[window], about=about, log_choices=ways)

    def sentence(self, evidence: Evidence) -> str:
        """How many rows, by how much and in whose axes, and what to do."""
        smaller, answer = evidence.effect.about
        origin = [row for term in answer.problem.terms for row in term.poses.samples.origin]
        first = origin[int(np.argmax(smaller))] if origin else f"row {int(np.argmax(smaller)) + 1}"
        length, std = evidence.length()
        axes = {"base": "one direction in space", "tip": "one direction on the tip"}
        return (
            f"{int(smaller.sum())} of {len(smaller)} rows ({first} is the first) are "
            f"{1e3 * length:.3g} ± {1e3 * std:.2g} mm away from the others, all in "
            f"{axes[evidence.effect.name]}. They seem to be of another target, or measured from "
            "another place. Give these rows another label, or leave them out."
        )

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """A fourth of the rows saw a point that is 4 mm off on the tip."""
        samples = data.poses.samples
        assert samples.position is not None
        assert samples.rotation is not None
        by = random_shift(rng, 4e-3)
        elsewhere = rng.permutation(len(samples)) < len(samples) // 4
        position = samples.position + elsewhere[:, None] * (samples.rotation @ by)
        return SpoiltData(with_columns(data, position=position), by, "tip")


def _displacements(answer: Examination, columns: FloatArray) -> FloatArray:
    """(samples, 3) by which each tip seems to be displaced, m; NaN where its rows do not tell.

    By whitened columns (m, 3) of displacements.
    """
    count = len(answer.position)
    sample = samples_of(answer.rows)
    square, slope = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(square, sample, columns[:, :, None] * columns[:, None, :])
    np.add.at(slope, sample, columns * answer.fit.settled[:, None])
    displacement = np.full((count, 3), np.nan)
    determined = np.linalg.cond(square) < 1e6
    displacement[determined] = -np.linalg.solve(square[determined], slope[determined][..., None])[
        ..., 0
    ]
    return displacement


def _two_parts(points: FloatArray, rule: Rule) -> tuple[float, BoolArray] | None:
    """The split of points (n, 3) into two parts that chance does not make.

    Returns:
        The logarithm of its p-value, all splits of this size allowed for, and (n,) which points
        are in the smaller part; None where there is no such split.
    """
    usable = np.flatnonzero(np.isfinite(points).all(axis=1))
    cloud = points[usable]
    if len(cloud) < 2 * FEWEST:
        return None
    middle = np.median(cloud, axis=0)
    farthest = np.argsort(np.linalg.norm(cloud - middle, axis=1))[::-1]
    best: tuple[float, BoolArray] | None = None
    # A search begins from each of some rows.
    for seed in farthest[np.linspace(0, len(cloud) // 2, 12).astype(int)]:
        split = _split(cloud, middle, cloud[seed])
        if split is not None and (best is None or split[0] < best[0]):
            best = split
    if best is None or best[0] > math.log(rule.false_alarm):
        return None
    smaller = np.zeros(len(points), dtype=np.bool_)
    smaller[usable[best[1]]] = True
    return best[0], smaller


def _split(cloud: FloatArray, one: FloatArray, other: FloatArray) -> tuple[float, BoolArray] | None:
    """Points (n, 3) by which of two middles they are nearer to, from given middles on."""
    smaller = np.zeros(len(cloud), dtype=np.bool_)
    for _ in range(20):
        nearer = cloud @ (other - one) > 0.5 * (other + one) @ (other - one)
        if min(nearer.sum(), (~nearer).sum()) < FEWEST:
            return None
        if np.array_equal(nearer, smaller):
            break
        smaller = nearer
        one, other = np.median(cloud[~smaller], axis=0), np.median(cloud[smaller], axis=0)
    if smaller.sum() > len(smaller) / 2:
        smaller = ~smaller
    parts = (cloud[smaller], cloud[~smaller])
    # By the median, so that mishaps hide no gap; of three normal components, its square is 2.366.
    scatter = max(
        float(np.sqrt(np.median(np.sum((p - np.median(p, axis=0)) ** 2, axis=1)) / 2.366))
        for p in parts
    )
    # Distance of the two parts over the scatter inside them. Normal noise that is cut in two at its
    # middle has 2.6; what a model lacks passes from one part to the other without a gap.
    separated = 5.0
    if np.linalg.norm(one - other) < separated * max(scatter, 1e-12):
        return None
    total = float(np.sum((cloud - cloud.mean(axis=0)) ** 2))
    inside = sum(float(np.sum((p - p.mean(axis=0)) ** 2)) for p in parts)
    n, ways = len(cloud), log_ways(len(cloud), int(smaller.sum()))
    # Of the likelihood ratio; two sorts of axes were tried.
    chance = 0.5 * (3 * n - 6) * math.log(max(inside / max(total, 1e-300), 1e-300))
    return chance + ways + math.log(2.0), smaller
