"""Readings and observations of a moving arm that were not taken at the same moment."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData, Truth
from suta_calib.trust.simulated_faults import arm_of, with_columns
from suta_calib.units import ms, text


class LateRows(AddedVariable):
    """The tip is where it will be, or was, a part of a row later: its own motion, times the delay.

    Needs rows in the order of time, of an arm that moves smoothly.
    """

    name = "time offset"
    about = "Readings and observations of a moving arm were not taken at the same time."
    # An arm's own motion passes for a moved instrument, a creep or a coupling.
    before_others = True
    # Share of the squared residuals that is worth a report: geometry with priors takes up most of
    # an arm's own motion (simulated, 20 to 50 ms at 0.1 s: 16 to 84 % were left).
    worth = 0.1

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each term whose arm moved smoothly and whose clock is no unknown already."""
        for k, moving, velocity in in_motion(answer):
            # With times it is fitted (`trust.hypotheses.late_clock`).
            if moving.step is not None:
                continue
            columns = answer.by_motion(velocity)
            # Rows by which they may be late, at most: more is looked for by reading them again
            # (`trust.hypotheses.rows_late`).
            yield Effect(f"term {k + 1}", columns, np.array([1.0]), about=moving)

    def sentence(self, evidence: Evidence) -> str:
        """By how much they are late, what that is at the tip, and what to do."""
        return said_late(evidence)

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """Readings that are 0.2 rows old."""
        arm_of(data)
        q, late = data.poses.samples.q, 0.2
        rows = np.arange(len(q), dtype=float)
        older = np.stack([np.interp(rows - late, rows, column) for column in q.T], axis=1)
        return SpoiltData(with_columns(data, q=older), np.array([late]))


@dataclass(frozen=True)
class Moving:
    """Rows of a moving arm.

    Attributes:
        called: as the term is.
        seen: whether the tip was seen: an arm that touches has no time offset.
        step: from row to row, s; None where no time offset can be estimated.
        way: of the tip in this time, m, RMS.
    """

    called: str
    seen: bool
    step: float | None
    way: float


def in_motion(answer: Examination) -> Iterator[tuple[int, Moving, FloatArray]]:
    """Terms whose arm moved smoothly and whose clock is no unknown already.

    Each with its number, and the motion (samples, 6, 1) of the tips from row to row.
    """
    arm = answer.arm
    assert arm is not None
    # The tip's motion by each reading.
    motion = answer.motion @ arm.gearing
    for k, (first, end) in enumerate(pairwise(answer.boundaries.tolist())):
        term = answer.problem.terms[k]
        if term.of_clock:
            continue
        files = np.array([file for file, _ in term.poses.samples.files()])
        by_instrument, time = term.medium != "touch", term.poses.samples.time
        steps = per_row(answer.q[first:end], files, time)
        if steps is None:
            continue
        velocity = np.zeros((len(answer.q), 6, 1))
        velocity[first:end, :, 0] = np.einsum("nvj,nj->nv", motion[first:end], steps)
        step = None if time is None or not by_instrument else usual_step(time, files)
        yield (
            k,
            Moving(term.called, by_instrument, step, rms_length(velocity[first:end, :3, 0])),
            velocity,
        )


def said_late(evidence: Evidence) -> str:
    """By how much rows are late, what that is at the tip, and what to do."""
    rows, std, moving = float(evidence.size[0]), float(evidence.std[0]), evidence.effect.about
    size, bound = f"{abs(rows):.3f} ± {std:.3f} of the time between two rows", 100
    if moving.step is not None:
        late, late_std = (ms(value * moving.step) for value in (abs(rows), std))
        size, bound = f"{late:.2f} ± {late_std:.2f} ms", 100 * max(1, math.ceil(late / 50.0))
    column = "" if moving.step is not None else "the samples a column time, in s, and "
    return (
        f"The arm moved while the rows of {moving.called} were measured. The readings were "
        f"taken {'before' if rows > 0 else 'after'} the observations, by {size}: in this time "
        f"the tip moves by {text(abs(rows) * moving.way, 'm', with_unit=True)} (RMS). "
        + (
            f"Let the time offset be estimated: give {column}"
            f"their row of the observations the key time_offset_ms: {{bound: {bound}}}. "
            "Or let the arm rest at each row."
            if moving.seen
            else "Let the arm rest at each row."
        )
    )


def usual_step(time: FloatArray, files: Any) -> float | None:
    """The median time, s, from row to row (n,) of a file; None where times do not grow."""
    steps = np.diff(time)[files[1:] == files[:-1]]
    return float(np.median(steps)) if len(steps) and (steps > 0).all() else None


def per_row(q: FloatArray, files: Any, time: FloatArray | None = None) -> FloatArray | None:
    """(n, joints) motion of readings from row to row; None where the arm did not move smoothly.

    Each of the files (n,) that rows are of is a motion by itself. With a time (n,), s, it is the
    motion in the usual time between two rows.
    """
    step_time = None if time is None else usual_step(time, files)
    at = np.arange(len(q), dtype=float)
    if time is not None and step_time is not None:
        at = (time - time[0]) / step_time
    ends = [0, *(1 + np.flatnonzero(np.diff(files))).tolist(), len(q)]
    motion, correlated, total = np.zeros_like(q), 0.0, 0.0
    for first, end in pairwise(ends):
        # Rows that a motion needs.
        if end - first < 10:
            continue
        # An encoder that turns over goes on.
        part = np.unwrap(q[first:end], axis=0)
        step = np.diff(part, axis=0)
        size = np.linalg.norm(step, axis=1)
        # So many times the usual step are rows that are missing, across which nothing is known.
        gap = size > 5.0 * np.median(size)
        beside = np.convolve(gap, [1, 1]).astype(bool)
        motion[first:end] = np.where(beside[:, None], 0.0, np.gradient(part, at[first:end], axis=0))
        both = ~(gap[1:] | gap[:-1])
        correlated += float(np.sum((step[1:] * step[:-1])[both]))
        total += 0.5 * float(np.sum((step[1:] ** 2 + step[:-1] ** 2)[both]))
    # How alike two steps from row to row must be that follow one another (their mean correlation),
    # for rows of an arm that moves: 1 for a straight path, 0.5 for turns of 60° from step to step.
    # Rows at any postures have -0.5, those that go to and fro -1.
    smooth = 0.5
    return motion if total > 0.0 and correlated > smooth * total else None
