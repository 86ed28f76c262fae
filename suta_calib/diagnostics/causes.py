"""What is wrong with data that contradict themselves: the same data, read in another way.

A sign, a swap, a shift by rows, another unit, an instrument that was moved: each is one change to
the samples. The change that makes them agree far better with the arm is named as the cause. First
every change is tried on the nominal arm with only what is external registered, which costs
milliseconds; the few best are then fitted like the job itself, so that what is named has been
seen to explain the data.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.diagnostics.held_out import robust_level
from suta_calib.errors import SutaCalibError
from suta_calib.geometry.numbers import quaternion_from_rotation, rotation_from_quaternion
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.solver.ipopt import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, Term
from suta_calib.terms.term import SeenTerm
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
    # Readings are told apart by what the job gives: wrong ones widen priors until they fit.
    problem = Problem(solution.problem.terms, solution.problem.arm_parameters)
    cap = options.cap * _level(problem, solution.x)
    present = misfit(problem, solution.x, cap)
    explained = min(present / options.far_better, options.explained * problem.assumed_sigmas()[0])
    # The nominal arm is far coarser than any fit: there residuals are capped by its own level.
    nominal = Problem(problem.terms)
    registered = nominal.start()
    coarse = options.cap * _level(nominal, registered)
    limit = misfit(nominal, registered, coarse)
    readings = [(*each, _registered(each[1], coarse)) for each in _readings(problem.terms, options)]
    first = sorted((each for each in readings if each[2] < limit), key=lambda each: each[2])
    hopeful = [(sentence, terms) for sentence, terms, _ in first[: options.fitted]]
    # The nominal arm is too coarse to rank this one.
    few = SolverOptions(starts=1, max_iterations=50, weights=None)
    for sentence, terms in [*hopeful, *_moved(problem.terms)]:
        with suppress(SutaCalibError):
            again = solve(Problem(terms, problem.arm_parameters), few)
            if (after := misfit(again.problem, again.x, cap)) < explained:
                return Cause(sentence, present, after)
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
    """Misfit with the nominal arm, and what is external at its closed-form start."""
    with suppress(SutaCalibError):
        problem = Problem(terms)
        return misfit(problem, problem.start(), cap)
    return math.inf


# ── Readings ─────────────────────────────────────────────────────────────────────────────────
def _readings(
    terms: Sequence[Term], options: CauseOptions
) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """The terms with their samples read in another way, and what would have to be so."""
    poses = terms[0].poses
    assert isinstance(poses, ArmPoses)
    samples = [term.poses.samples for term in terms]
    changes = [_of_joints(poses.arm)]
    if any(s.position is not None for s in samples):
        changes.append(_of_instrument(any(s.rotation is not None for s in samples), options))
    if any(LANDMARK in s.labels for s in samples):
        changes.append(_of_landmarks(samples, options))
    for sentence, change in chain(*changes):
        changed = [change(s) for s in samples]
        with suppress(SutaCalibError):
            if all(map(len, changed)):
                yield (
                    sentence,
                    tuple(
                        term.over_poses(term.poses.with_samples(read))
                        for term, read in zip(terms, changed, strict=True)
                    ),
                )


def _of_joints(arm: ArmModel) -> Iterator[tuple[str, Change]]:
    """What encoders do: they count the other way, start elsewhere, are exchanged, say degrees."""
    names, one = arm.joints, np.eye(len(arm.joints))
    turning = np.array([joint.type != "prismatic" for joint in arm.chain.moving])
    for k, name in enumerate(names):
        flipped = one * np.where(one[k], -1.0, 1.0)
        yield f"{name} counts the other way (sign: -1)", partial(_mapped, flipped, 0.0)
    for k in np.flatnonzero(turning).tolist():
        for angle in (90.0, -90.0, 180.0):
            shift = partial(_mapped, one, from_deg(angle) * one[k])
            yield f"{names[k]} reads {-angle:g}° too much", shift
    for a, b in combinations(range(len(names)), 2):
        swapped = one.copy()
        swapped[[a, b]] = one[[b, a]]
        sentence = f"the columns of {names[a]} and {names[b]} are exchanged"
        yield sentence, partial(_mapped, swapped, 0.0)
    in_degrees = one * np.where(turning, from_deg(1.0), 1.0)
    yield "the joints' columns are in degrees, not rad", partial(_mapped, in_degrees, 0.0)


def _of_instrument(oriented: bool, options: CauseOptions) -> Iterator[tuple[str, Change]]:
    for sentence, factors in (
        ("the measured positions are in mm, not m", [from_mm(1.0)] * 3),
        ("the measured positions are in m, but were divided by 1000", [mm(1.0)] * 3),
        ("the instrument's frame is left-handed", [1.0, -1.0, 1.0]),
    ):
        yield sentence, partial(_scaled, np.array(factors))
    if oriented:
        yield "the measured poses are inverted", _inverted
        yield "the quaternions' order is w x y z", _reordered
    for rows in range(1, options.shifts + 1):
        count = "one row" if rows == 1 else f"{rows} rows"
        for sentence, offset in ((f"{count} late", rows), (f"{count} early", -rows)):
            yield f"what the instrument saw is {sentence}", partial(_slid, offset, ())
    yield "what the instrument saw is in the opposite order", _backwards


def _of_landmarks(
    samples: Sequence[Samples], options: CauseOptions
) -> Iterator[tuple[str, Change]]:
    names = dict.fromkeys(str(n) for s in samples for n in s.labels.get(LANDMARK, ()))
    if len(names) <= options.most_landmarks:
        for a, b in combinations(names, 2):
            yield f"landmarks {a} and {b} are exchanged", partial(_renamed, {a: b, b: a})
    for sentence, offset in (("late", 1), ("early", -1)):
        yield (
            f"the labels of landmarks are one row {sentence}",
            partial(_slid, offset, (LANDMARK,)),
        )


def _moved(terms: Sequence[Term]) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """As if what is external had stood elsewhere for the second half of its rows."""
    halves: list[Term] = []
    for term in terms:
        samples = term.poses.samples
        if term.place in samples.labels and term.own:
            label = samples.labels[term.place].astype(object)
            for name in np.unique(samples.labels[term.place]):
                rows = np.flatnonzero(samples.labels[term.place] == name)
                label[rows[len(rows) // 2 :]] = f"{name} (moved)"
            labels = {**samples.labels, term.place: label.astype(np.str_)}
            halves.append(term.over_poses(term.poses.with_samples(replace(samples, labels=labels))))
        elif isinstance(term, SeenTerm):
            first, second = np.array_split(np.arange(len(samples)), 2)
            halves.append(term.take(first))
            halves.append(replace(term.take(second), label=f"{term.label} (moved)"))
        else:
            halves.append(term)
    if any(half not in terms for half in halves):
        yield (
            "the instrument, the artefact or what was touched was moved after the first half of "
            "the rows",
            tuple(halves),
        )


def _mapped(matrix: FloatArray, shift: FloatArray | float, samples: Samples) -> Samples:
    return replace(samples, q=samples.q @ matrix + shift)


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


def _renamed(names: Mapping[str, str], samples: Samples) -> Samples:
    if LANDMARK not in samples.labels:
        return samples
    new = np.array([names.get(str(old), str(old)) for old in samples.labels[LANDMARK]])
    return replace(samples, labels={**samples.labels, LANDMARK: new})


def _slid(offset: int, labels: Sequence[str], samples: Samples) -> Samples:
    """Readings paired with the labels, or else with what was seen, ``offset`` rows later.

    Rows without a partner in their file are left out.
    """
    if not set(labels) <= samples.labels.keys():
        return samples
    files, rows = _files(samples), np.arange(len(samples))
    other = np.clip(rows + offset, 0, len(rows) - 1)
    kept = rows[(other == rows + offset) & (files[other] == files)]
    return _paired(samples, kept, kept + offset, labels)


def _backwards(samples: Samples) -> Samples:
    files = _files(samples)
    order = np.concatenate([np.flatnonzero(files == k)[::-1] for k in np.unique(files)])
    return _paired(samples, np.sort(order), order)


def _paired(
    samples: Samples, rows: IntArray, seen: IntArray, labels: Sequence[str] = ()
) -> Samples:
    read, other = samples.take(rows), samples.take(seen)
    if labels:
        return replace(read, labels={**read.labels, **{n: other.labels[n] for n in labels}})
    return replace(read, position=other.position, rotation=other.rotation)


def _files(samples: Samples) -> IntArray:
    names = [origin.rpartition(":")[0] for origin in samples.origin]
    return np.unique(names, return_inverse=True)[1].astype(np.intp)
