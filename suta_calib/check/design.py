"""Which few measurements would show most of what may change, before they are made.

Candidates are measured as the calibrated arm would have it. A set of them shows a change of sizes T
by the evidence that is expected of it, ½ log |I + T N T| (the mixture of `follow`), with N the
curvature that a check would have. The set with the largest evidence, on average over everything
that may change, is looked for one candidate after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from suta_calib.analysis.planning import (
    Candidate,
    Place,
    Pool,
    Reach,
    Region,
    Situation,
    candidate_pool,
)
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.check.checking import Checker, Checking, FoundPower
from suta_calib.check.follow import SIZE
from suta_calib.check.suspects import Suspect, suspects_of
from suta_calib.display import Displayable
from suta_calib.errors import JobError, SamplesError
from suta_calib.terms.term import Term
from suta_calib.threads import single_threaded
from suta_calib.trust.linear_fit import LinearFit


@dataclass(frozen=True, eq=False)
class CheckDesign(Displayable):
    """Measurements for a check.

    Attributes:
        situation: the calibration.
        chosen: what to measure, the most telling first.
        evidence: (n,) expected of the first one, the first two, …, on average.
        power: what change they would show together.
        candidates: how many there were.
    """

    situation: Situation
    chosen: tuple[Candidate, ...]
    evidence: FloatArray
    power: tuple[FoundPower, ...]
    candidates: int


@single_threaded
def design_check(
    situation: Situation,
    checker: Checker,
    count: int = 5,
    places: Sequence[Place] | None = None,
    region: Region | None = None,
    seed: int = 0,
) -> CheckDesign:
    """Choose measurements that would show most.

    Args:
        situation: the data of a calibration, and its solution.
        checker: the same, for checks.
        count: how many.
        places: what could be measured; searched in the region by default.
        region: where; around what was measured by default.
        seed: of the search.

    Raises:
        JobError: the arm reaches none of the places.
    """
    region = Region.around(situation) if region is None else region
    if places is None:
        # Candidates among which five hardly differ from the best five, and whose rows are weighed
        # together within seconds.
        places = candidate_pool(
            situation, region, Pool(placements=12, points=12, poses=60), 1, seed
        )
        # What sees the arm anywhere needs nothing to be put down.
        postures = [place for place in places if place.kind == "pose"]
        places = postures or places
    candidates = Reach(situation, 1, seed).candidates(places).candidates
    rows = list[tuple[Candidate, Term]]()
    for candidate in candidates:
        try:
            rows.append((candidate, situation.term(candidate)))
        except SamplesError:
            continue
    if not rows:
        hint = "give another region"
        raise JobError("no candidate", "one that the arm reaches and that is seen", hint=hint)
    checking = checker.checking([term for _, term in rows])
    parts = _rows_of(checking, [term for _, term in rows])
    suspects = suspects_of(checking.start, checker.values)
    chosen, evidence = list[int](), list[float]()
    for _ in range(min(count, len(rows))):
        left = [k for k in range(len(rows)) if k not in chosen]
        values = [_evidence(checking, suspects, parts, [*chosen, k]) for k in left]
        best = int(np.argmax(values))
        chosen.append(left[best])
        evidence.append(values[best])
    together = checker.checking([rows[k][1] for k in chosen]).run()
    return CheckDesign(
        situation,
        tuple(rows[k][0] for k in chosen),
        np.array(evidence),
        together.power,
        len(rows),
    )


def _rows_of(checking: Checking, terms: Sequence[Term]) -> list[IntArray]:
    """Of each term, the components of the rows that look at it."""
    shared, first = checking.start.shared, np.cumsum([0, *(len(term.poses) for term in terms)])
    looks = np.zeros((len(shared.own), int(first[-1])))
    for members, by_tip in zip(shared.sample, shared.by_tip, strict=True):
        each = np.zeros((len(members), looks.shape[1]))
        # A row that looks at fewer samples than others does not move with the rest.
        each[np.arange(len(members)), members] = np.linalg.norm(by_tip, axis=1)
        looks += each if shared.combined is None else np.abs(shared.combined) @ each
    return [np.flatnonzero(looks[:, a:b].any(axis=1)) for a, b in pairwise(first.tolist())]


def _evidence(
    checking: Checking,
    suspects: Sequence[Suspect],
    parts: Sequence[IntArray],
    chosen: Sequence[int],
) -> float:
    """Expected of a set of candidates, on average over the suspects."""
    rows, start = np.concatenate([parts[k] for k in chosen]), checking.start
    root = np.linalg.cholesky(checking.total[np.ix_(rows, rows)])
    columns = [start.jacobian[np.ix_(rows, checking.own)], *(s.columns[rows] for s in suspects)]
    white, own = np.linalg.solve(root, np.hstack(columns)), len(checking.own)
    known = start.problem.prior_precision()[checking.own]
    fit = LinearFit(white[:, :own], np.zeros(len(rows)), known)
    total, first = 0.0, own
    for suspect in suspects:
        size = np.array([SIZE.get(unit, 1.0) for unit in suspect.units])
        end = first + len(size)
        curvature = size[:, None] * fit.curvature(white[:, first:end]) * size
        values = np.maximum(np.linalg.eigvalsh(curvature), 0.0)
        total += 0.5 * float(np.sum(np.log1p(values))) / len(size)
        first = end
    return total / len(suspects)
