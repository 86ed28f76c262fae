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
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.diagnostics.held_out import robust_level
from suta_calib.errors import SutaCalibError
from suta_calib.geometry.numbers import (
    extent,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from suta_calib.measurements import Artefact, Samples
from suta_calib.measurements.samples import joined
from suta_calib.model.arm import ArmModel
from suta_calib.solver.ipopt import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, Term
from suta_calib.terms.seen import SeenTerm
from suta_calib.units import from_deg, from_mm, mm

Change = Callable[[Samples], Samples]
# The label column of what is touched on an artefact.
LANDMARK: Final = "landmark"
# A score beyond all others but infinity.
_UNRANKED: Final = 1e300


@dataclass(frozen=True)
class CauseOptions:
    """How hard to look, and what counts as found.

    Attributes:
        shifts: rows by which what was observed may be late or early; beyond a few the usual cause
            is a file in another order, which is tried apart.
        rows_left: share of the rows that must have a partner after a shift: few rows fit anything.
        fitted: alternatives, best first, that are fitted like the job.
        far_better: a reading is the cause where its fit leaves so many times less; chance and a
            few more unknowns do not do that.
        explained: a reading explains the data if it leaves at most so many times the noise that is
            stated or assumed, or one in so many of what was left: what is merely less wrong is no
            cause.
        alike: fits that are so many times the best one at most are as good.
        most_files: files of which one alone may be late are tried among so many.
        most_landmarks: pairs of landmarks are exchanged only among so many (pairs grow with their
            square).
        cap: residuals count as so many times their robust level at most: two of fifteen landmarks
            exchanged must still be seen, a few gross rows must not decide.
    """

    shifts: int = 20
    rows_left: float = 0.33
    fitted: int = 4
    far_better: float = 2.0
    explained: tuple[float, float] = (3.0, 20.0)
    alike: float = 1.2
    most_files: int = 20
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
        Of the readings that agree best with the nominal arm, the one whose fit is best and far
        better than the present one; the simplest of several; None where there is none.
    """
    if solution.problem.arm is None:
        return None
    # Readings are told apart by what the job gives: wrong ones widen priors until they fit.
    problem = solution.problem.as_given()
    cap = options.cap * _level(problem, solution.x)
    present = misfit(problem, solution.x, cap, len(solution.free))
    times, one_in = options.explained
    small = max(times * problem.assumed_sigmas()[0], present / one_in)
    explained = min(present / options.far_better, small)
    # The nominal arm is far coarser than any fit: there residuals are capped by its own level.
    nominal = Problem(problem.terms)
    registered = nominal.start()
    coarse = options.cap * _level(nominal, registered)
    limit = misfit(nominal, registered, coarse, len(nominal.names))
    readings = [*_readings(problem.terms, options), *_mirrored(problem.terms)]
    readings += _given_mirrored(problem.terms)
    scores = np.array([_registered(terms, coarse) for _, terms in readings])
    # A reading explains only the rows that it keeps.
    scores /= [_kept(terms, problem.terms) for _, terms in readings]
    ranked = [k for k in np.argsort(scores, kind="stable") if scores[k] < limit]
    tried = [(*readings[k], float(scores[k])) for k in ranked[: options.fitted]]
    # What the nominal arm is too coarse to rank: what stands elsewhere; and only where that is no
    # cause, for it leaves more open, what was moved.
    tried += [(*each, _UNRANKED) for each in _elsewhere(problem.terms)]
    tried += [(*each, math.inf) for each in _moved(problem.terms)]
    few = SolverOptions(starts=1, max_iterations=25, weights=None)
    causes, worst = list[Cause](), math.inf
    for sentence, terms, score in tried:
        if causes and score > worst:
            break
        with suppress(SutaCalibError):
            again = solve(Problem(terms, problem.arm_parameters), few)
            after = misfit(again.problem, again.x, cap, len(again.free))
            # An arm that hardly moves agrees with anything.
            after *= max(_travel(problem.terms) / _travel(terms), 1.0)
            after /= _kept(terms, problem.terms)
            if after < explained:
                causes.append(Cause(sentence, present, after))
                worst = min(worst, options.alike * score)
    # Labels that return make several shifts do: what was tried first is the simplest.
    order = [sentence for sentence, *_ in [*readings, *tried]]
    best = min((cause.after for cause in causes), default=0.0)
    alike = [cause for cause in causes if cause.after < options.alike * best]
    return min(alike, key=lambda cause: order.index(cause.sentence), default=None)


def misfit(problem: Problem, x: FloatArray, cap: float, fitted: int = 0) -> float:
    """Root mean square of a residual component, priors counted with it, in the first block's unit.

    Blocks count in units of their noise, those of the first block being the yardstick. Norms count
    as ``cap`` at most, so that a few gross rows do not decide which reading is right; a parameter
    counts as so many noise levels as it is prior standard deviations off.

    Args:
        problem: terms and parameters.
        x: (n,) where.
        cap: as many times the first block's unit.
        fitted: how many parameters followed these residuals.
    """
    residuals = _alike(problem, x)
    squared = [np.minimum(np.einsum("nd,nd->n", r, r), r.shape[1] * cap**2) for r in residuals]
    pulls = (x - problem.parameters.array("nominal")) ** 2 * problem.prior_precision()
    known = float(pulls.sum()) * problem.assumed_sigmas()[0] ** 2
    count = sum(r.size for r in residuals)
    return math.sqrt((sum(s.sum() for s in squared) + known) / max(count - fitted, count / 10))


def _level(problem: Problem, x: FloatArray) -> float:
    return float(np.sqrt(np.mean([robust_level(r) ** 2 for r in _alike(problem, x)])))


def _alike(problem: Problem, x: FloatArray) -> list[FloatArray]:
    """Residuals of every block, in the first one's unit by their noise."""
    sigmas = problem.assumed_sigmas()
    lines = problem.linearise(x, sigmas)
    return [line.residual * (sigmas[0] / s) for line, s in zip(lines, sigmas, strict=True)]


def _registered(terms: Sequence[Term], cap: float) -> float:
    """Misfit with the nominal arm, and what is external at its closed-form start."""
    with suppress(SutaCalibError):
        problem = Problem(terms)
        return misfit(problem, problem.start(), cap, len(problem.names))
    return math.inf


# ── Readings ─────────────────────────────────────────────────────────────────────────────────
def _readings(
    terms: Sequence[Term], options: CauseOptions
) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """The terms with their samples read in another way, and what would have to be so."""
    poses = terms[0].poses
    assert isinstance(poses, ArmPoses)
    samples = [term.poses.samples for term in terms]
    changes = [_of_joints(poses.arm), _of_rows(samples, options)]
    if any(s.position is not None for s in samples):
        changes.append(_of_instrument(any(s.rotation is not None for s in samples)))
    if any(LANDMARK in s.labels for s in samples):
        changes.append(_of_landmarks(samples, options))
    for sentence, change in chain(*changes):
        changed = [change(s) for s in samples]
        with suppress(SutaCalibError):
            if all(
                len(c) >= options.rows_left * len(s) for c, s in zip(changed, samples, strict=True)
            ):
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


def _of_instrument(oriented: bool) -> Iterator[tuple[str, Change]]:
    for sentence, factors in (
        ("the measured positions are in mm, not m", [from_mm(1.0)] * 3),
        ("the measured positions are in m, but were divided by 1000", [mm(1.0)] * 3),
        ("the instrument's frame is left-handed", [1.0, -1.0, 1.0]),
    ):
        yield sentence, partial(_scaled, np.array(factors))
    if oriented:
        yield "the measured poses are inverted", _inverted
        yield "the quaternions' order is w x y z", _reordered


def _of_rows(samples: Sequence[Samples], options: CauseOptions) -> Iterator[tuple[str, Change]]:
    """What was seen or touched stands in another row than the readings that belong to it."""
    for rows in range(1, options.shifts + 1):
        count = "one row" if rows == 1 else f"{rows} rows"
        for sentence, offset in ((f"{count} late", rows), (f"{count} early", -rows)):
            yield f"what was seen or touched is {sentence}", partial(_slid, offset, "")
    yield "what was seen or touched is in the opposite order", _backwards
    files = dict.fromkeys(file for s in samples for file in _files(s).tolist())
    if 1 < len(files) <= options.most_files:
        for file in files:
            for sentence, offset in (("late", 1), ("early", -1)):
                yield (
                    f"what was seen or touched is one row {sentence} in {file}",
                    partial(_slid, offset, file),
                )


def _of_landmarks(
    samples: Sequence[Samples], options: CauseOptions
) -> Iterator[tuple[str, Change]]:
    names = dict.fromkeys(str(n) for s in samples for n in s.labels.get(LANDMARK, ()))
    if len(names) <= options.most_landmarks:
        for a, b in combinations(names, 2):
            yield f"landmarks {a} and {b} are exchanged", partial(_renamed, {a: b, b: a})
    numbered: dict[str, list[tuple[int, str]]] = {}
    for name in names:
        stem = name.rstrip("0123456789")
        if stem != name:
            numbered.setdefault(stem, []).append((int(name[len(stem) :]), name))
    # Counted anew for each stem, or on from the last number of one to the first of the next.
    apart = [[name for _, name in sorted(group)] for group in numbered.values()]
    on = [[name for stem in sorted(numbered) for _, name in sorted(numbered[stem])]]
    for rings, counted in ((apart, ""), (on, ", counted on from one letter to the next")):
        if counted and len(apart) < 2:
            continue
        for which, steps in (("one too low", 1), ("one too high", -1)):
            other = dict[str, str]()
            for ring in rings:
                other |= zip(ring, [*ring[steps:], *ring[:steps]], strict=True)
            if any(old != new for old, new in other.items()):
                yield f"the landmarks' numbers are {which}{counted}", partial(_renamed, other)


def _moved(terms: Sequence[Term]) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """As if what is external had stood elsewhere in the second half of its rows, or in a file."""
    what = "the instrument, the artefact or what was touched"
    for sentence, parts in (
        (f"{what} was moved after the first half of the rows", _half),
        (f"{what} was moved between the files", _files),
    ):
        apart: list[Term] = []
        for term in terms:
            samples = term.poses.samples
            part = parts(samples, samples.labels.get(term.place))
            if term.place in samples.labels and term.own:
                label = joined({"": samples.labels[term.place], "part": part}, ("", "part"))
                moved = replace(samples, labels={**samples.labels, term.place: label})
                apart.append(term.over_poses(term.poses.with_samples(moved)))
            elif isinstance(term, SeenTerm):
                for each in np.unique(part):
                    rows = np.flatnonzero(part == each)
                    apart.append(replace(term.take(rows), label=f"{term.label} {each}"))
            else:
                apart.append(term)
        if any(each not in terms for each in apart):
            yield sentence, tuple(apart)


def _elsewhere(terms: Sequence[Term]) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """As if one of the given poses had not been given."""
    for k, term in enumerate(terms):
        for label in term.given:
            rest = {name: pose for name, pose in term.given.items() if name != label}
            read = (*terms[:k], replace(term, given=rest), *terms[k + 1 :])
            what = f"{term.place} {label}".strip() if term.place else label or f"the {term.medium}"
            yield f"{what} is not where its given pose says", read


def _half(samples: Samples, place: NDArray[np.str_] | None) -> NDArray[np.str_]:
    """Which half of the rows each row is in, of those at one place where there are places."""
    later, rows = np.zeros(len(samples), dtype=bool), np.arange(len(samples))
    groups = [rows] if place is None else [rows[place == name] for name in np.unique(place)]
    for group in groups:
        later[group[len(group) // 2 :]] = True
    return np.where(later, "second half", "first half")


def _mirrored(terms: Sequence[Term]) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """As if the artefact had been certified in a left-handed frame."""
    read: list[Any] = list(terms)
    for k, term in enumerate(terms):
        if term.touched is not None:
            marks = {
                name: replace(mark, position=mark.position * [-1.0, 1.0, 1.0])
                for name, mark in term.touched.landmarks.items()
            }
            read[k] = replace(read[k], artefact=Artefact(term.touched.name, marks))
    if any(term.touched for term in terms):
        yield "the artefact is mirrored: its certificate's frame is left-handed", tuple(read)


def _given_mirrored(terms: Sequence[Term]) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """As if all given positions had been surveyed in a left-handed frame."""
    if not any(term.given for term in terms):
        return
    for axis, sign in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
        yield (
            f"the given positions are mirrored: their {axis} has the wrong sign",
            tuple(
                replace(
                    term,
                    given={
                        label: replace(pose, position=pose.position * sign)
                        for label, pose in term.given.items()
                    },
                )
                for term in terms
            ),
        )


def _kept(terms: Sequence[Term], given: Sequence[Term]) -> float:
    """Share of the rows that have a partner."""
    return sum(len(term.poses) for term in terms) / sum(len(term.poses) for term in given)


def _travel(terms: Sequence[Term]) -> float:
    """How far the nominal arm moves its tip, m."""
    return max(extent(np.vstack([term.poses.at({})[1] for term in terms])), 1e-9)


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


def _slid(offset: int, file: str, samples: Samples) -> Samples:
    """Readings paired with what was observed ``offset`` rows later, in all files or in one.

    Rows without a partner in their file are left out.
    """
    files, rows = _files(samples), np.arange(len(samples))
    other = rows + offset * (files == file if file else np.ones(len(rows), dtype=np.intp))
    inside = np.clip(other, 0, len(rows) - 1)
    kept = rows[(other == inside) & (files[inside] == files)]
    return _paired(samples, kept, other[kept])


def _backwards(samples: Samples) -> Samples:
    files, rows = _files(samples), np.arange(len(samples))
    order = rows.copy()
    for file in np.unique(files):
        order[files == file] = rows[files == file][::-1]
    return _paired(samples, rows, order)


def _paired(samples: Samples, rows: IntArray, seen: IntArray) -> Samples:
    return replace(samples.take(seen), q=samples.q[rows])


def _files(samples: Samples, place: NDArray[np.str_] | None = None) -> NDArray[np.str_]:
    del place
    return np.array([origin.rpartition(":")[0] for origin in samples.origin])
