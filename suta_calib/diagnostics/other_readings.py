"""The same samples, read in another way: every mistake that a laboratory makes, undone.

A reading is one change to what was read (a sign, a swap, a shift by rows, another unit) or to the
terms (an artefact mirrored, an instrument that stood elsewhere), with the words for what would have
to be so. `causes` finds out which of them the data agree with.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SutaCalibError
from suta_calib.geometry.numbers import (
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from suta_calib.measurements import Samples
from suta_calib.measurements.samples import joined
from suta_calib.model.arm import ArmModel
from suta_calib.model.lengths import other_lengths
from suta_calib.terms import ArmPoses, Term
from suta_calib.terms.seen import SeenTerm
from suta_calib.units import from_deg, from_mm, mm

Change = Callable[[Samples], Samples]
# The label column of what is touched on an artefact.
LANDMARK: Final = "landmark"
# Part of the rows that are a whole row late, beside which a clock has made it another row.
UNSURE: Final = 0.1
# Parts of a file, in one of which a clock may have been set anew; not in the last.
SET_IN: Final = ("first", "middle", "last")


@dataclass(frozen=True)
class ReadingOptions:
    """How many readings.

    Attributes:
        shifts: rows by which what was observed may be late or early; beyond a few the usual cause
            is a file in another order, which is tried apart.
        drifts: rows by which it may have become late or early at the end of a file.
        parts: of a file, in one of which rows may be missing; files share them.
        lost: rows that may be missing there.
        rows_left: share of the rows that must have a partner after a shift: few rows fit anything.
        most_files: files of which one alone may be late are tried among so many.
        most_landmarks: pairs of landmarks are exchanged only among so many (pairs grow with their
            square).
    """

    shifts: int = 20
    drifts: int = 5
    parts: int = 6
    lost: int = 5
    rows_left: float = 0.33
    most_files: int = 20
    most_landmarks: int = 40


def other_readings(
    terms: Sequence[Term], options: ReadingOptions
) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """The terms with their samples or artefacts read in another way.

    Args:
        terms: over one arm.
        options: how many readings.

    Yields:
        What would have to be so, as the end of "the data agree if …", and the terms.
    """
    yield from _of_samples(terms, options)
    yield from _of_terms(terms)
    yield from _mirrored(terms)
    yield from _given_mirrored(terms)


def _of_samples(
    terms: Sequence[Term], options: ReadingOptions
) -> Iterator[tuple[str, tuple[Term, ...]]]:
    poses = terms[0].poses
    assert isinstance(poses, ArmPoses)
    samples = [term.poses.samples for term in terms]
    changes = [readings_of_joints(poses.arm), _of_rows(samples, options)]
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


def _of_terms(terms: Sequence[Term]) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """As each kind says that what it observes is misread: in all of its terms at once."""
    ways: dict[str, dict[int, Term]] = {}
    for k, term in enumerate(terms):
        for sentence, read in term.misread:
            ways.setdefault(sentence, {})[k] = read
    for sentence, way in ways.items():
        yield sentence, tuple(way.get(k, term) for k, term in enumerate(terms))


def readings_of_joints(arm: ArmModel) -> Iterator[tuple[str, Change]]:
    """What encoders do: they count the other way, start elsewhere, are exchanged, say degrees.

    Yields:
        Each as `other_readings` says it, and the change of the samples.
    """
    names, one = arm.joints, np.eye(len(arm.joints))
    turning = np.array([joint.type != "prismatic" for joint in arm.chain.moving])
    for k, name in enumerate(names):
        flipped = one * np.where(one[k], -1.0, 1.0)
        yield f"{name} counts the other way (sign: -1)", partial(_mapped, flipped, 0.0)
    for k in np.flatnonzero(turning).tolist():
        for angle in (90.0, -90.0, 180.0):
            shift = partial(_mapped, one, from_deg(angle) * one[k])
            yield f"{names[k]} reads {-angle:g}° too much", shift
    for sentence, order in _orders(names):
        yield sentence, partial(_mapped, one[list(order)], 0.0)
    in_degrees = one * np.where(turning, from_deg(1.0), 1.0)
    yield "the joints' columns are in degrees, not rad", partial(_mapped, in_degrees, 0.0)


def _orders(names: Sequence[str]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Which joint's readings each joint's column holds, in every way that columns are mixed up."""
    rows = list(range(len(names)))
    found = {tuple(rows)}
    ways = list[tuple[str, list[int]]]()
    for a, b in combinations(rows, 2):
        swapped = [b if row == a else a if row == b else row for row in rows]
        ways.append((f"the columns of {names[a]} and {names[b]} are exchanged", swapped))
    for step, other in ((-1, "next"), (1, "one before")):
        sentence = f"the joints' columns each stand under the name of the {other}"
        ways.append((sentence, [*rows[step:], *rows[:step]]))
    ways.append(("the joints' columns stand in the opposite order", rows[::-1]))
    # As ROS lists joint states, whatever the order along the arm.
    by_name = sorted(rows, key=lambda row: names[row])
    sentence = "the joints' readings stand in the alphabetical order of the joints' names"
    ways.append((sentence, by_name))
    sentence = "the joints' names stand in alphabetical order, their readings in that of the arm"
    ways.append((sentence, np.argsort(by_name).tolist()))
    for sentence, way in ways:
        if tuple(way) not in found:
            found.add(tuple(way))
            yield sentence, tuple(way)


def _of_instrument(oriented: bool) -> Iterator[tuple[str, Change]]:
    for sentence, factors in (
        ("the measured positions are in mm, not m", [from_mm(1.0)] * 3),
        ("the measured positions are in m, but were divided by 1000", [mm(1.0)] * 3),
        ("the instrument's frame is left-handed", [1.0, -1.0, 1.0]),
    ):
        yield sentence, partial(_scaled, np.array(factors))
    if oriented:
        # Positions alone say no more than that one of the axes is mirrored, turns say which.
        for axis, factors in (("x", [-1.0, 1.0, 1.0]), ("z", [1.0, 1.0, -1.0])):
            sentence = f"the instrument's frame is left-handed: {axis} has the wrong sign"
            yield sentence, partial(_scaled, np.array(factors))
        yield "the measured poses are inverted", _inverted
        yield "the quaternions' order is w x y z", _reordered


def _of_rows(samples: Sequence[Samples], options: ReadingOptions) -> Iterator[tuple[str, Change]]:
    """What was seen or touched stands in another row than the readings that belong to it."""
    files = dict.fromkeys(file for s in samples for file in s.file_names.tolist())
    for rows in range(1, options.shifts + 1):
        count = "one row" if rows == 1 else f"{rows} rows"
        for sentence, offset in ((f"{count} late", rows), (f"{count} early", -rows)):
            yield f"what was seen or touched is {sentence}", partial(_slid, offset, "")
    yield "what was seen or touched is in the opposite order", _backwards
    for rows in range(1, options.drifts + 1):
        for sign, slow in ((1, "slow"), (-1, "fast")):
            late = f"{rows} row{'s' * (rows > 1)} {'late' if sign > 0 else 'early'}"
            clock = "the clock of what was seen or touched"
            sentence = f"{clock} runs {slow}: {late} at the end"
            yield sentence, partial(_drifted, sign * rows)
            # Of one file it is known better where.
            for part, which in enumerate(SET_IN[:-1] if len(files) > 1 else ()):
                sentence = f"{clock} was set in the {which} part of a file: {late} from there on"
                yield sentence, partial(_out_of_step, sign * rows, "", part, len(SET_IN))
    if len(files) > options.most_files:
        return
    for file in files:
        yield from _of_lost_rows(samples, file, max(options.parts // len(files), 2), options.lost)
    if len(files) > 1:
        for file in files:
            for sentence, offset in (("late", 1), ("early", -1)):
                yield (
                    f"what was seen or touched is one row {sentence} in {file}",
                    partial(_slid, offset, file),
                )


def _of_lost_rows(
    samples: Sequence[Samples], file: str, parts: int, most: int
) -> Iterator[tuple[str, Change]]:
    """A file that is in step up to where rows are missing of what was read, or of what was seen."""
    rows = next(rows for s in samples if (rows := np.flatnonzero(s.file_names == file)).size)
    origin = next(s.origin for s in samples if file in s.file_names)
    if len(rows) < 2 * parts:
        return
    for count in range(1, most + 1):
        are = "a row is" if count == 1 else f"{count} rows are"
        # Behind the last part nothing would be out of step.
        for part, within in enumerate(np.array_split(rows, parts)[:-1]):
            where = f"between {origin[within[0]]} and {origin[within[-1]]}"
            for what, offset in (("the joints' readings", count), ("what was observed", -count)):
                change = partial(_out_of_step, offset, file, part, parts)
                yield f"{are} missing among {what}, {where}", change


def _of_landmarks(
    samples: Sequence[Samples], options: ReadingOptions
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


def moved_half_way(terms: Sequence[Term]) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """As if what is external had stood elsewhere in the second half of its rows, or in a file."""
    what = "the instrument, the artefact or what was touched"
    for sentence, parts in (
        (f"{what} was moved after the first half of the rows", _half),
        (f"{what} was moved between the files", lambda samples, _: samples.file_names),
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


def on_unknown_mounts(terms: Sequence[Term]) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """As if what an instrument sees sat anywhere on the tip's link, and not at the tip."""
    read = [term.on_unknown_mount for term in terms]
    sentences = [each[0] for each in read if each is not None]
    if sentences:
        pairs = zip(read, terms, strict=True)
        yield sentences[0], tuple(term if other is None else other[1] for other, term in pairs)


def elsewhere(terms: Sequence[Term]) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """As if one of the given poses had not been given."""
    for k, term in enumerate(terms):
        for label in term.given:
            rest = {name: pose for name, pose in term.given.items() if name != label}
            read = (*terms[:k], replace(term, given=rest), *terms[k + 1 :])
            what = f"{term.place} {label}".strip() if term.place else label or f"the {term.medium}"
            yield f"{what} is not where its given pose says", read


def other_units(
    terms: Sequence[Term],
) -> Iterator[list[tuple[str, tuple[Term, ...]]]]:
    """As if a length of the arm had been written in another unit; units of one length together."""
    poses = terms[0].poses
    assert isinstance(poses, ArmPoses)
    units: dict[tuple[str, ...], list[tuple[str, tuple[Term, ...]]]] = {}
    for each in other_lengths(poses.arm):
        with suppress(SutaCalibError):
            arm = poses.arm.at(each.values)
            read = tuple(term.over_poses(ArmPoses(arm, term.poses.samples)) for term in terms)
            units.setdefault(tuple(each.values), []).append((each.sentence, read))
    yield from units.values()


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
            read[k] = replace(read[k], artefact=replace(term.touched, landmarks=marks))
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
    """Readings paired with what was observed ``offset`` rows later, in all files or in one."""
    rows = np.arange(len(samples))
    slid = samples.file_names == file if file else np.ones(len(rows), dtype=np.bool_)
    return _partners(samples, rows + offset * slid, np.ones(len(rows), dtype=np.bool_))


def _out_of_step(offset: int, file: str, part: int, parts: int, samples: Samples) -> Samples:
    """The same from one of ``parts`` on, which is left out: nobody knows where in it."""
    files = samples.file_names
    other, sure = np.arange(len(samples)), np.ones(len(samples), dtype=np.bool_)
    for name in np.unique(files):
        mine = np.flatnonzero(files == name)
        # Of other terms the file has no rows, or other files of this one hardly any.
        if name != (file or name) or len(mine) < parts:
            continue
        within = np.array_split(mine, parts)[part]
        other[mine[mine > within[-1]]] += offset
        # Nor have the first behind it a partner, if what was observed is what is missing.
        sure[mine[(mine >= within[0]) & (mine <= within[-1] + max(-offset, 0))]] = False
    return _partners(samples, other, sure)


def _drifted(last: int, samples: Samples) -> Samples:
    """Readings paired with what was observed ever later in each file, by ``last`` rows at its end.

    Rows near which another row begins to be the partner are left out: nobody knows to a row where.
    """
    files, rows = samples.file_names, np.arange(len(samples))
    other, sure = rows.copy(), np.zeros(len(rows), dtype=np.bool_)
    for file in np.unique(files):
        mine = np.flatnonzero(files == file)
        progress = (abs(last) + 1) * (np.arange(len(mine)) + 0.5) / len(mine)
        steps = np.floor(progress)
        other[mine] += int(np.sign(last)) * steps.astype(np.intp)
        # Before the first change, and after the last, there is nothing to be unsure of.
        change = np.clip(np.round(progress), 1, abs(last))
        sure[mine] = np.abs(progress - change) > UNSURE
    return _partners(samples, other, sure)


def _partners(samples: Samples, other: IntArray, sure: NDArray[np.bool_]) -> Samples:
    """Readings paired with what was observed in row ``other`` (n,), where that is ``sure`` (n,).

    Rows without a partner in their file are left out.
    """
    files, rows = samples.file_names, np.arange(len(samples))
    inside = np.clip(other, 0, len(rows) - 1)
    kept = rows[(other == inside) & (files[inside] == files) & sure]
    return _paired(samples, kept, other[kept])


def _backwards(samples: Samples) -> Samples:
    files, rows = samples.file_names, np.arange(len(samples))
    order = rows.copy()
    for file in np.unique(files):
        order[files == file] = rows[files == file][::-1]
    return _paired(samples, rows, order)


def _paired(samples: Samples, rows: IntArray, seen: IntArray) -> Samples:
    return replace(samples.take(seen), q=samples.q[rows])
