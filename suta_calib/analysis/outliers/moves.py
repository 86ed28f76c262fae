"""Whether an instrument, an artefact or a point was moved while its rows were taken.

The rows of one pose are given another pose from some row on. The residuals that the job's fit
leaves, with the whole geometry of the arm free to explain them (`touches`), are weighed by Huber's
rule and projected on what nothing else explains; by how much the second pose lessens them has an F
distribution if nothing was moved, and Bonferroni's factor counts the rows at which it might begin.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from scipy.special import fdtrc

from suta_calib.analysis.outliers.answer import Move, Thresholds
from suta_calib.analysis.outliers.touches import RobustLinearFit
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.solver.losses import huber_threshold
from suta_calib.terms import Term

# Rows on either side of a change, beside those that its pose needs.
TO_SPARE: Final = 3
# Singular value, of the largest, that is rounding.
ROUNDING: Final = 1e-10
# Probabilities below are as good as zero, and no more exact.
EPSILON: Final = 1e-12


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
    derivative = fit.jacobian.reshape(n, size, -1)
    rest, sigma, _ = fit.solve(np.zeros((n * size, 0)))
    length, huber = np.linalg.norm(rest, axis=1) / sigma, huber_threshold(size)
    root = np.repeat(np.sqrt(np.minimum(1.0, huber / np.maximum(length, huber))) / sigma, size)
    # Priors are rows like the others.
    priors = np.diag(np.sqrt(fit.precision))
    explained = np.vstack([fit.jacobian * root[:, None], priors])
    explained /= np.maximum(np.linalg.norm(explained, axis=0), 1e-300)
    basis, singular, _ = np.linalg.svd(explained, full_matrices=False)
    basis = basis[:, singular > ROUNDING * singular[0]]
    residual = np.concatenate([fit.residual.reshape(-1) * root, priors @ fit.deviation])
    left = residual - basis @ (basis.T @ residual)
    freedom = n * size + np.count_nonzero(fit.precision) - basis.shape[1]

    def later(rows: IntArray, columns: Sequence[int]) -> FloatArray:
        """(n d, c) derivatives by where something stands, in some rows only."""
        shift = np.zeros((n, size, len(columns)))
        shift[rows] = derivative[rows][:, :, columns]
        return shift.reshape(n * size, -1)

    found, known = [], np.zeros((n * size, 0))
    for what, rows, columns in _poses(term, names):
        free, least = len(columns), -(-len(columns) // size) + TO_SPARE
        chances: dict[int, float] = {}
        if len(rows) < 2 * least or freedom <= free:
            continue
        for k in range(least, len(rows) - least + 1):
            weighed = np.zeros((len(basis), free))
            weighed[: n * size] = later(rows[k:], columns) * root[:, None]
            moved = weighed - basis @ (basis.T @ weighed)
            gain = float(left @ moved @ np.linalg.lstsq(moved, left, ROUNDING)[0])
            unexplained = max(float(left @ left) - gain, 1e-300) / (freedom - free)
            chances[k] = float(fdtrc(free, freedom - free, gain / free / unexplained))
        k = min(chances, key=lambda k: chances[k])
        p = min(max(len(chances) * chances[k], EPSILON), 1.0)
        if p > thresholds.significance:
            continue
        shift = later(rows[k:], columns)
        moved = (shift @ fit.solve(shift)[2]).reshape(n, size)[rows[k:]]
        distance = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
        if distance > thresholds.bias:
            known = np.hstack([known, shift])
            left = fit.solve(known)[1]
            found.append(Move(what, term.poses.samples.origin[rows[k]], distance, p, left))
    return tuple(found)


def _poses(term: Term, names: Sequence[str]) -> Iterator[tuple[str, IntArray, list[int]]]:
    """What may have been moved, its rows in their order, and the columns of where it stands."""
    noun, unknown = (term.place, term.place_unknown) if term.place else (term.mark, term.mark)
    if term.medium != "touch":
        own = [p.name for p in term.own if not (noun and p.owner.startswith(f"{noun}["))]
        yield f"the {term.medium}", np.arange(len(term.poses)), [names.index(n) for n in own]
    labels = term.poses.samples.labels.get(noun)
    for label in () if labels is None else dict.fromkeys(labels.tolist()):
        start = f"{unknown}[{label}]"
        columns = [k for k, name in enumerate(names) if name.startswith(start)]
        if columns:
            yield f"{noun} {label}", np.flatnonzero(labels == label), columns
