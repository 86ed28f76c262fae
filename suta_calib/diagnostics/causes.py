"""What is wrong with data that contradict themselves: the same data, read in another way.

A sign, a swap, a shift by rows, another unit, an instrument that was moved: each is one change to
the samples. The change that makes them agree far better with the arm is named as the cause. First
every change is tried on the nominal arm with only what is external registered, which costs
milliseconds; the few best are then fitted like the job itself, so that what is named has been
seen to explain the data.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import combinations
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.diagnostics.held_out import robust_level
from suta_calib.errors import SamplesError, SutaCalibError
from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.ipopt import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, Term
from suta_calib.units import from_deg, from_mm, mm

Change = Callable[[Samples], Samples]
# The label column of what is touched on an artefact.
LANDMARK: Final = "landmark"


@dataclass(frozen=True)
class CauseOptions:
    """How hard to look, and what counts as found.

    Attributes:
        shifts: rows by which what was observed may be late or early; beyond a few the usual cause
            is a file in another order, which is tried apart.
        fitted: alternatives, best first, that are fitted like the job.
        far_better: a reading is the cause where its fit leaves so many times less; chance and a
            few more unknowns do not do that.
        explained: a reading explains the data only if it leaves at most so many times the noise
            that is stated or assumed: what is merely less wrong is no cause.
        most_landmarks: pairs of landmarks are exchanged only among so many (pairs grow with their
            square).
        cap: residuals count as so many times their robust level at most: two of fifteen landmarks
            exchanged must still be seen, a few gross rows must not decide.
    """

    shifts: int = 20
    fitted: int = 4
    far_better: float = 2.0
    explained: float = 10.0
    most_landmarks: int = 40
    cap: float = 10.0


@dataclass(frozen=True)
class Cause:
    """A reading of the data under which they agree.

    Attributes:
        sentence: what would have to be so, as the end of "the data agree if …".
        before: `misfit` of the job's own fit, in the unit of the first block.
        after: the same of the data read in the other way, fitted likewise.
    """

    sentence: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class _Alternative:
    """Terms read in another way; ``always`` where the nominal arm is too coarse to rank it."""

    sentence: str
    terms: tuple[Term, ...]
    always: bool = False


def find_cause(solution: Solution, options: CauseOptions = CauseOptions()) -> Cause | None:
    """The one change to the samples under which they agree far better with the arm.

    Args:
        solution: the job's own fit, of terms over one arm.
        options: how hard to look.

    Returns:
        The first reading, by how well it agrees with the nominal arm, whose fit is far better than
        the present one; None where there is none.
    """
    if solution.problem.arm is None:
        return None
    parameters = solution.problem.arm_parameters
    # Readings are told apart by what the job gives: wrong ones widen priors until they fit.
    problem = Problem(solution.problem.terms, parameters)
    cap = options.cap * _level(problem, solution.x)
    present = misfit(problem, solution.x, cap)
    explained = min(present / options.far_better, options.explained * problem.assumed_sigmas()[0])
    # The nominal arm is far coarser than any fit: there residuals are capped by its own level.
    nominal = Problem(problem.terms)
    registered = nominal.start()
    coarse = options.cap * _level(nominal, registered)
    limit = misfit(nominal, registered, coarse)
    scored = [(_registered(a.terms, coarse), a) for a in _alternatives(problem.terms, options)]
    hopeful = sorted((pair for pair in scored if pair[0] < limit), key=lambda pair: pair[0])
    first = [a for _, a in hopeful[: options.fitted]]
    for alternative in [*first, *(a for _, a in scored if a.always and a not in first)]:
        after = _fitted(alternative.terms, parameters, cap)
        if after < explained:
            return Cause(alternative.sentence, present, after)
    return None


def misfit(problem: Problem, x: FloatArray, cap: float) -> float:
    """Root mean square of a residual component of the first unit, priors counted with it.

    Norms count as ``cap`` at most, so that a few gross rows do not decide which reading is right;
    a parameter counts as so many assumed noise levels as it is prior standard deviations off.
    """
    residuals = _first(problem, x)
    squared = [np.minimum(np.einsum("nd,nd->n", r, r), r.shape[1] * cap**2) for r in residuals]
    pulls = (x - problem.parameters.array("nominal")) ** 2 * problem.prior_precision()
    known = float(pulls.sum()) * problem.assumed_sigmas()[0] ** 2
    return math.sqrt((sum(s.sum() for s in squared) + known) / sum(r.size for r in residuals))


def _level(problem: Problem, x: FloatArray) -> float:
    return float(np.sqrt(np.mean([robust_level(r) ** 2 for r in _first(problem, x)])))


def _first(problem: Problem, x: FloatArray) -> list[FloatArray]:
    """Residuals of the blocks that have the first one's unit."""
    lines = problem.linearise(x, problem.assumed_sigmas())
    unit = lines[0].view.block.unit
    return [line.residual for line in lines if line.view.block.unit == unit]


def _registered(terms: Sequence[Term], cap: float) -> float:
    """With the nominal arm, and what is external at its closed-form start."""
    try:
        problem = Problem(terms)
        return misfit(problem, problem.start(), cap)
    except SutaCalibError:
        return math.inf


def _fitted(terms: Sequence[Term], parameters: ParameterSet, cap: float) -> float:
    few = SolverOptions(starts=1, max_iterations=50, weights=None)
    try:
        solution = solve(Problem(terms, parameters), few)
    except SutaCalibError:
        return math.inf
    return misfit(solution.problem, solution.x, cap)


# ── Readings ─────────────────────────────────────────────────────────────────────────────────
def _alternatives(terms: Sequence[Term], options: CauseOptions) -> Iterator[_Alternative]:
    for sentence, change in _changes(terms, options):
        with suppress(SutaCalibError):
            yield _Alternative(sentence, tuple(_read(term, change) for term in terms))
    moved = [part for term in terms for part in _in_halves(term)]
    if len(moved) > len(terms) or any(m is not t for m, t in zip(moved, terms, strict=False)):
        yield _Alternative(
            "the instrument, the artefact or what was touched was moved after the first half of "
            "the rows",
            tuple(moved),
            always=True,
        )


def _read(term: Term, change: Change) -> Term:
    assert isinstance(term.poses, ArmPoses)
    samples = change(term.poses.samples)
    if not len(samples):
        raise SamplesError("no rows that are left", "some", where=term.kind)
    return term.over_poses(ArmPoses(term.poses.arm, samples))


def _changes(terms: Sequence[Term], options: CauseOptions) -> Iterator[tuple[str, Change]]:
    poses = terms[0].poses
    assert isinstance(poses, ArmPoses)
    samples = [term.poses.samples for term in terms]
    yield from _of_joints(poses.arm)
    if any(s.position is not None for s in samples):
        yield from _of_instrument(any(s.rotation is not None for s in samples), options)
    if any(LANDMARK in s.labels for s in samples):
        yield from _of_landmarks(samples, options)


def _of_joints(arm: ArmModel) -> Iterator[tuple[str, Change]]:
    turning = [k for k, j in enumerate(arm.chain.moving) if j.type != "prismatic"]
    names = arm.joints
    for k, name in enumerate(names):
        yield f"{name} counts the other way (sign: -1)", partial(_joint, k, -1.0, 0.0)
    for k in turning:
        for angle in (90.0, -90.0, 180.0):
            yield f"{names[k]} reads {-angle:g}° too much", partial(_joint, k, 1.0, from_deg(angle))
    for j, k in combinations(range(len(names)), 2):
        yield f"the columns of {names[j]} and {names[k]} are exchanged", partial(_exchanged, j, k)
    yield "the joints' columns are in degrees, not rad", partial(_in_degrees, turning)


def _of_instrument(oriented: bool, options: CauseOptions) -> Iterator[tuple[str, Change]]:
    yield "the measured positions are in mm, not m", partial(_scaled, np.full(3, from_mm(1.0)))
    yield (
        "the measured positions are in m, but were divided by 1000",
        partial(_scaled, np.full(3, mm(1.0))),
    )
    yield "the instrument's frame is left-handed", partial(_scaled, np.array([1.0, -1.0, 1.0]))
    if oriented:
        yield "the measured poses are inverted", _inverted
        yield "the quaternions' order is w x y z", _reordered
    for rows in range(1, options.shifts + 1):
        count = "one row" if rows == 1 else f"{rows} rows"
        yield f"what the instrument saw is {count} late", partial(_slid, rows)
        yield f"what the instrument saw is {count} early", partial(_slid, -rows)
    yield "what the instrument saw is in the opposite order", _backwards


def _of_landmarks(
    samples: Sequence[Samples], options: CauseOptions
) -> Iterator[tuple[str, Change]]:
    names = dict.fromkeys(str(n) for s in samples for n in s.labels.get(LANDMARK, ()))
    if len(names) <= options.most_landmarks:
        for a, b in combinations(names, 2):
            yield f"landmarks {a} and {b} are exchanged", partial(_renamed, a, b)
    yield "the labels of landmarks are one row late", partial(_labels_slid, 1)
    yield "the labels of landmarks are one row early", partial(_labels_slid, -1)


def _in_halves(term: Term) -> list[Term]:
    """The term as if what is external had stood elsewhere for the second half of its rows."""
    samples = term.poses.samples
    assert isinstance(term.poses, ArmPoses)
    if term.place in samples.labels and term.own:
        label = samples.labels[term.place].astype(object)
        for name in np.unique(samples.labels[term.place]):
            rows = np.flatnonzero(samples.labels[term.place] == name)
            label[rows[len(rows) // 2 :]] = f"{name} (moved)"
        labels = {**samples.labels, term.place: label.astype(np.str_)}
        return [term.over_poses(ArmPoses(term.poses.arm, replace(samples, labels=labels)))]
    if term.own and "label" in {f.name for f in fields(term)}:
        first, second = np.array_split(np.arange(len(samples)), 2)
        moved: Any = term.take(second)
        return [term.take(first), replace(moved, label=f"{moved.label} (moved)")]
    return [term]


def _joint(k: int, factor: float, more: float, samples: Samples) -> Samples:
    q = samples.q.copy()
    q[:, k] = factor * q[:, k] + more
    return replace(samples, q=q)


def _exchanged(j: int, k: int, samples: Samples) -> Samples:
    q = samples.q.copy()
    q[:, [j, k]] = q[:, [k, j]]
    return replace(samples, q=q)


def _in_degrees(turning: Sequence[int], samples: Samples) -> Samples:
    q = samples.q.copy()
    q[:, turning] = from_deg(q[:, turning])
    return replace(samples, q=q)


def _scaled(factors: FloatArray, samples: Samples) -> Samples:
    if samples.position is None:
        return samples
    return replace(samples, position=samples.position * factors)


def _inverted(samples: Samples) -> Samples:
    if samples.position is None or samples.rotation is None:
        return samples
    back = np.swapaxes(samples.rotation, 1, 2)
    position = -np.einsum("nij,nj->ni", back, samples.position)
    return replace(samples, rotation=back, position=position)


def _reordered(samples: Samples) -> Samples:
    """Numbers that stand as x y z w were w x y z."""
    if samples.rotation is None:
        return samples
    x, y, z, w = quaternion_from_rotation(samples.rotation).T
    return replace(samples, rotation=rotation_from_quaternion(np.column_stack([y, z, w, x])))


def _slid(rows: int, samples: Samples) -> Samples:
    """Readings paired with what was seen ``rows`` later; rows without a partner are left out."""
    seen = _followers(samples, rows)
    kept = np.flatnonzero(seen >= 0)
    return _paired(samples, kept, seen[kept])


def _backwards(samples: Samples) -> Samples:
    files = _files(samples)
    order = np.concatenate([np.flatnonzero(files == k)[::-1] for k in np.unique(files)])
    return _paired(samples, np.sort(order), order)


def _paired(samples: Samples, rows: IntArray, seen: IntArray) -> Samples:
    read, other = samples.take(rows), samples.take(seen)
    return replace(read, position=other.position, rotation=other.rotation)


def _followers(samples: Samples, rows: int) -> IntArray:
    """For each row the one ``rows`` further in its file, -1 without one."""
    files, n = _files(samples), len(samples)
    other = np.arange(n) + rows
    inside = (other >= 0) & (other < n)
    same = inside & (files[np.clip(other, 0, n - 1)] == files)
    return np.where(same, other, -1).astype(np.intp)


def _files(samples: Samples) -> IntArray:
    names = [origin.rpartition(":")[0] for origin in samples.origin]
    return np.unique(names, return_inverse=True)[1].astype(np.intp)


def _renamed(a: str, b: str, samples: Samples) -> Samples:
    if LANDMARK not in samples.labels:
        return samples
    old = samples.labels[LANDMARK]
    new = np.where(old == a, b, np.where(old == b, a, old))
    return replace(samples, labels={**samples.labels, LANDMARK: new})


def _labels_slid(rows: int, samples: Samples) -> Samples:
    if LANDMARK not in samples.labels:
        return samples
    other = _followers(samples, rows)
    kept = np.flatnonzero(other >= 0)
    names = samples.labels[LANDMARK][other[kept]]
    left = samples.take(kept)
    return replace(left, labels={**left.labels, LANDMARK: names})
