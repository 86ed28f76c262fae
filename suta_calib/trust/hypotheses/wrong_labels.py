"""Single rows whose label is wrong: those that are far off, and agree with another landmark.

A robust fit gives few wrong rows hardly any weight, so that neither its residuals nor another
reading of all rows show them. At such a fit each row that is far off is tried with every other
name.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.solver.compiled_residual import TermErrors
from suta_calib.solver.solution import Solution
from suta_calib.terms.term import Term
from suta_calib.trust import Pattern, SpoiltData, Truth
from suta_calib.trust.simulated_faults import with_columns
from suta_calib.words import listed

# The label column of what is touched on an artefact.
LANDMARK: Final = "landmark"
# Times the median error beyond which a row is far off, and below which it agrees.
FAR, NEAR = 10.0, 3.0


@dataclass(frozen=True)
class WrongLabel:
    """A row that agrees with another label.

    Attributes:
        origin: the row, by file and number.
        label: what it says.
        likely: what it agrees with.
    """

    origin: str
    label: str
    likely: str


class WrongLabels(Pattern):
    """Rows of fitted terms whose errors are ordinary with another landmark's name alone."""

    name = "wrong labels"
    about = "Single rows have the label of another landmark."
    role = "rows"

    def matches(self, answer: Solution) -> Iterator[str]:
        """One on all of these rows."""
        rows = [row for term in answer.problem.terms for row in _wrong_in(term, answer)]
        if rows:
            yield _sentence(rows)

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """One row has the label of another landmark."""
        samples = data.poses.samples
        if data.touched is None or LANDMARK not in samples.labels:
            raise SamplesError("samples without landmarks", "landmarks", where=data.kind)
        labels = samples.labels[LANDMARK].astype(object)
        row = int(rng.integers(len(labels)))
        label = str(labels[row])
        labels[row] = next(name for name in data.touched.landmarks if name != label)
        effect = f"{labels[row]} is probably {label} in {samples.origin[row]}"
        return SpoiltData(_with_labels(data, labels), effect=effect)


def _sentence(rows: Sequence[WrongLabel]) -> str:
    """Which names fit which rows."""
    by_names: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        by_names.setdefault((row.label, row.likely), []).append(row.origin)
    exchanged = [(a, b) for a, b in by_names if a < b and (b, a) in by_names]
    names = [
        f"{label} is probably {likely} in {listed(origins, 4)}"
        for (label, likely), origins in list(by_names.items())[:6]
    ]
    more = f", and {len(by_names) - 6} more" if len(by_names) > 6 else ""
    of_pairs = (
        f" In these rows {listed([f'{a} and {b}' for a, b in exchanged], 4)} were exchanged."
        if exchanged
        else ""
    )
    several = len(rows) > 1
    return (
        f"{'Labels of' if several else 'The label of'} {len(rows)} "
        f"row{'s' if several else ''} {'are' if several else 'is'} probably wrong: "
        f"{'; '.join(names)}{more}.{of_pairs} With {'these names' if several else 'this name'} "
        f"{'their errors are' if several else 'its error is'} as small as those of the other rows. "
        "Correct the samples, and calibrate again."
    )


def _wrong_in(term: Term, solution: Solution) -> Iterator[WrongLabel]:
    labels, block = term.poses.samples.labels.get(LANDMARK), term.blocks[0]
    # Of a distance either end may be wrong.
    if term.touched is None or labels is None or block.samples.shape[1] != 1 or not len(block):
        return
    rows, error = block.samples[:, 0], _errors(term, solution)
    typical = float(np.median(error))
    far = np.flatnonzero(error > FAR * max(typical, 1e-12))
    names = list(term.touched.landmarks)
    # With so many wrong rows the fit is not reliable.
    # Names that are tried: each costs an evaluation of all rows.
    if not len(far) or len(far) > 0.3 * len(error) or len(names) > 200:
        return
    tried = np.array([_renamed_errors(term, solution, rows[far], name, far) for name in names])
    best = np.argmin(tried, axis=0)
    for k, which in enumerate(best.tolist()):
        row = int(rows[far[k]])
        if tried[which, k] < NEAR * typical and names[which] != str(labels[row]):
            yield WrongLabel(term.poses.samples.origin[row], str(labels[row]), names[which])


def _renamed_errors(
    term: Term, solution: Solution, rows: IntArray, name: str, residuals: IntArray
) -> FloatArray:
    """Errors of some rows, all of them with the same name."""
    labels = term.poses.samples.labels[LANDMARK].astype(object)
    labels[rows] = name
    return _errors(_with_labels(term, labels), solution)[residuals]


def _with_labels(term: Term, labels: np.ndarray[tuple[int], np.dtype[np.object_]]) -> Term:
    every = {**term.poses.samples.labels, LANDMARK: labels.astype(np.str_)}
    return with_columns(term, labels=every)


def _errors(term: Term, solution: Solution) -> FloatArray:
    """Lengths of the first block's residuals, m or rad."""
    problem = solution.problem
    first, *_ = TermErrors(term, problem.names[: problem.arm_count])(solution.values)
    return np.asarray(np.linalg.norm(first, axis=1))
