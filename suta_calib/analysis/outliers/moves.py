"""Whether an instrument, an artefact or a point was moved while its rows were taken.

The rows of one pose are given another pose from some row on: an `Effect` in stretches of rows,
beside the job's fit with the whole geometry of the arm free (`touches`), its rows weighed by
Huber's rule (`trust.evidence`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from suta_calib.analysis.outliers.answer import Move, Thresholds
from suta_calib.analysis.outliers.touches import RobustLinearFit
from suta_calib.arrays import IntArray
from suta_calib.solver.losses import huber_threshold
from suta_calib.terms import Term
from suta_calib.trust.evidence import Effect, LinearFit, Stretches, weigh_effects


def find_moves(
    term: Term, names: Sequence[str], fit: RobustLinearFit, thresholds: Thresholds
) -> tuple[Move, ...]:
    """The most significant change of every pose that changed.

    Args:
        term: whose first block is linearised, one residual for each sample.
        names: of the columns of the linear fit.
        fit: with nothing moved.
        thresholds: how far a move must take its rows, m, and how unlikely it must be by chance.
    """
    n, size = fit.residual.shape
    rest, sigma, _ = fit.solve(np.zeros((n * size, 0)))
    length, huber = np.linalg.norm(rest, axis=1) / sigma, huber_threshold(size)
    linear = LinearFit(
        fit.jacobian / sigma,
        fit.residual.reshape(-1) / sigma,
        fit.precision,
        fit.deviation,
        np.repeat(np.minimum(1.0, huber / np.maximum(length, huber)), size),
    )
    moves, shifts = [], np.zeros((n * size, 0))
    for what, rows, columns in _poses(term, names):
        # Rows on either side of a change, beside those that its pose needs.
        least = -(-len(columns) // size) + 3
        starts = range(least, len(rows) - least + 1)
        if len(rows) < 2 * least:
            continue
        order = np.full(n, -1, dtype=np.intp)
        order[rows] = np.arange(len(rows))
        places = np.array([(start, len(rows)) for start in starts], dtype=np.intp)
        windows = Stretches(np.repeat(order, size), places)
        by_pose = fit.jacobian[:, columns]
        for evidence in weigh_effects(linear, [Effect(what, by_pose / sigma, windows=windows)]):
            if evidence.window is None or evidence.p_value > thresholds.significance:
                continue
            shift = by_pose * windows[evidence.window][:, None]
            first = starts[evidence.window]
            moved = (shift @ fit.solve(shift)[2]).reshape(n, size)[rows[first:]]
            distance = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
            if distance > thresholds.bias:
                shifts = np.hstack([shifts, shift])
                # Probabilities below are as good as zero, and no more exact.
                p, left = max(evidence.p_value, 1e-12), fit.solve(shifts)[1]
                moves.append(Move(what, term.poses.samples.origin[rows[first]], distance, p, left))
    return tuple(moves)


def _poses(term: Term, names: Sequence[str]) -> Iterator[tuple[str, IntArray, list[int]]]:
    """What may have been moved, its rows in their order, and the columns of where it stands."""
    noun, unknown = (term.place, term.place_unknown) if term.place else (term.mark, term.mark)
    if term.medium != "touch":
        unknowns = [
            p.name for p in term.own_parameters if not (noun and p.owner.startswith(f"{noun}["))
        ]
        yield f"the {term.medium}", np.arange(len(term.poses)), [names.index(n) for n in unknowns]
    labels = term.poses.samples.labels.get(noun)
    for label in () if labels is None else dict.fromkeys(labels.tolist()):
        start = f"{unknown}[{label}]"
        columns = [k for k, name in enumerate(names) if name.startswith(start)]
        if columns:
            yield f"{noun} {label}", np.flatnonzero(labels == label), columns
