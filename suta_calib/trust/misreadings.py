"""Samples, or pairs of poses, that are read in another way: what hypotheses about them share.

The angle by which hand and eye turn between two pairs is the same whatever X is, but it shows none
of these faults: a pose and its inverse turn by the same angle, and so do quaternions whose numbers
are exchanged in the same way everywhere. Whether an X closes all loops ``A X B`` shows them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError, SutaCalibError
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term
from suta_calib.terms.hand_eye_start import Poses, some_poses
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.trust.hypothesis import Reinterpretation, SpoiltData, Truth, known_hypotheses
from suta_calib.trust.rule import Rule
from suta_calib.trust.simulated_faults import arm_of, by_chain
from suta_calib.units import from_deg

# Files of which one alone may be out of step are tried among so many.
MOST_FILES: Final = 20


@dataclass(frozen=True, eq=False)
class Pairs:
    """Poses of a hand and of the target in its eye, pair by pair.

    Attributes:
        hand: ``T_base_hand``, rotations (n, 3, 3) and positions (n, 3).
        seen: ``T_eye_target``, the same.
        unit: of their lengths, in the unit that they were given in.
    """

    hand: Poses
    seen: Poses
    unit: float = 1.0

    @classmethod
    def of(cls, term: Term) -> Pairs:
        """Those of a term over measured poses."""
        samples = term.poses.samples
        assert samples.position is not None
        assert samples.rotation is not None
        return cls(term.poses.at({}), (samples.rotation, samples.position))

    def rows(self, hand: IntArray, seen: IntArray) -> Pairs:
        """Some poses of the hand, each with the target of another row."""
        return replace(self, hand=some_poses(self.hand, hand), seen=some_poses(self.seen, seen))

    @property
    def few(self) -> Pairs:
        """200 of them at most, evenly: enough to tell one reading from another."""
        rows = np.unique(np.linspace(0, len(self.hand[1]) - 1, 200).astype(np.intp))
        return self.rows(rows, rows)


Change = Callable[[Samples], Samples]
# What would have to be so, as "if …" (in braces the other setup), and the pairs then.
PairReading = tuple[str, Pairs]


class Misreading(Reinterpretation):
    """The samples of all terms, or pairs of poses, changed in the same way."""

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """What would have to be so, and the change of any term's samples that undoes it."""
        yield from ()

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """The terms with all samples changed, where enough of the rows are left.

        Of several chains, those of all, then those of each.
        """
        terms, keys = data.terms, set[tuple[bytes, ...]]()
        parts = [*by_chain(terms)]
        for where, part in parts:
            for description, change in self.changes(part):
                read = [change(t.poses.samples) if t in part else t.poses.samples for t in terms]
                # What is so in one chain may be so in all that have the joint, or the file.
                if len(parts) > 1:
                    numbers = tuple(map(_numbers, read))
                    if numbers in keys:
                        continue
                    keys.add(numbers)
                with suppress(SutaCalibError):
                    # Share of the rows that a reading must keep: few rows fit anything.
                    if all(
                        len(samples) >= 0.33 * len(term.poses)
                        for samples, term in zip(read, terms, strict=True)
                    ):
                        pairs = zip(terms, read, strict=True)
                        changed = tuple(_with_samples(*pair) for pair in pairs)
                        yield description + where, changed

    def fault(self, term: Term) -> tuple[str, Samples]:
        """One of these changes, which undoes itself.

        Returns:
            The description that undoes it, and the samples.
        """
        changes = [*self.changes([term])]
        description, change = changes[len(changes) // 2]
        return description, change(term.poses.samples)

    @property
    def reads_pairs(self) -> bool:
        """Whether pairs of poses can have it too."""
        return type(self).of_pairs is not Misreading.of_pairs

    def of_pairs(self, pairs: Pairs) -> Iterator[PairReading]:
        """All ways to read pairs of poses."""
        yield from ()

    def fault_of_pairs(self, pairs: Pairs) -> Pairs:
        """Pairs as somebody gets them wrong."""
        raise SamplesError("pairs of poses", "samples of an arm", where=self.name)

    def spoil(self, data: Term, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """A term whose samples, or pairs, have the `fault`."""
        if isinstance(data.poses, MeasuredPoses):
            pairs = self.fault_of_pairs(Pairs.of(data))
            rotation, position = pairs.seen
            reread = replace(data.poses.samples, rotation=rotation, position=position)
            return SpoiltData(data.over_poses(MeasuredPoses(*pairs.hand, reread)))
        description, samples = self.fault(data)
        return SpoiltData(_with_samples(data, samples), effect=description)


class MisreadJoints(Misreading):
    """The readings of the joints, column by column."""

    @abstractmethod
    def of_joints(self, arm: ArmModel, joints: Sequence[str]) -> Iterator[tuple[str, Change]]:
        """The same as `changes`, for some joints of an arm."""

    def changes(self, terms: Sequence[Term]) -> Iterator[tuple[str, Change]]:
        """Those of the joints that chains of the terms share: of a lone chain, of all."""
        arms = [*dict.fromkeys(map(arm_of, terms))]
        chains = Counter(joint for arm in arms for joint in arm.own_joints)
        least = min(len(arms), 2)
        return self.of_joints(arms[0], [j for j, count in chains.items() if count >= least])


def _numbers(samples: Samples) -> bytes:
    """What a change of samples changes."""
    arrays = (samples.q, samples.position, samples.rotation, samples.pixels)
    labels = "\n".join("\t".join(column.tolist()) for column in samples.labels.values())
    return b"".join([labels.encode(), *(a.tobytes() for a in arrays if a is not None)])


def _with_samples(term: Term, samples: Samples) -> Term:
    return term.over_poses(term.poses.with_samples(samples))


def mapped(matrix: FloatArray, shift: FloatArray | float, samples: Samples) -> Samples:
    """Readings times a matrix (joints, joints), plus a shift."""
    return replace(samples, q=samples.q @ matrix + shift)


def scaled(factors: FloatArray, samples: Samples) -> Samples:
    """Measured positions times factors (3,)."""
    if samples.position is None:
        return samples
    return replace(samples, position=samples.position * factors)


def renamed(names: Mapping[str, str], column: str, samples: Samples) -> Samples:
    """Labels of a column with other names."""
    if column not in samples.labels:
        return samples
    new = np.array([names.get(str(old), str(old)) for old in samples.labels[column]])
    return replace(samples, labels={**samples.labels, column: new})


# ── readings paired with the observations of other rows ─────────────────────────────────────────


def files_of(terms: Sequence[Term]) -> list[str]:
    """Names of all files, in their order."""
    return [*dict.fromkeys(f for term in terms for f in term.poses.samples.file_names.tolist())]


def slid(offset: int, file: str, samples: Samples) -> Samples:
    """Readings paired with what was observed ``offset`` rows later, in all files or in one."""
    rows = np.arange(len(samples))
    late = samples.file_names == file if file else np.ones(len(rows), dtype=np.bool_)
    return with_partners(samples, rows + offset * late, np.ones(len(rows), dtype=np.bool_))


def out_of_step(offset: int, file: str, part: int, parts: int, samples: Samples) -> Samples:
    """The same from one of ``parts`` on, which is left out: nobody knows where in it."""
    files = samples.file_names
    partner, sure = np.arange(len(samples)), np.ones(len(samples), dtype=np.bool_)
    for name in np.unique(files):
        mine = np.flatnonzero(files == name)
        # Of other terms the file has no rows, or other files of this one hardly any.
        if name != (file or name) or len(mine) < parts:
            continue
        within = np.array_split(mine, parts)[part]
        partner[mine[mine > within[-1]]] += offset
        # Nor have the first behind it a partner, if what was observed is what is missing.
        sure[mine[(mine >= within[0]) & (mine <= within[-1] + max(-offset, 0))]] = False
    return with_partners(samples, partner, sure)


def with_partners(samples: Samples, partner: IntArray, sure: BoolArray) -> Samples:
    """Readings paired with what was observed in row ``partner`` (n,), where ``sure`` (n,).

    Rows without a partner in their file are left out.
    """
    files, rows = samples.file_names, np.arange(len(samples))
    inside = np.clip(partner, 0, len(rows) - 1)
    usable = rows[(partner == inside) & (files[inside] == files) & sure]
    return paired(samples, usable, partner[usable])


def paired(samples: Samples, rows: IntArray, observed: IntArray) -> Samples:
    """Readings of some rows with what was observed in others."""
    return replace(samples.take(observed), q=samples.q[rows])


# ── which reading makes pairs agree ─────────────────────────────────────────────────────────────


def agreeing_reading(
    pairs: Pairs, scatter: float, spread: Callable[[Pairs], FloatArray], rule: Rule = Rule()
) -> tuple[str, float, float] | None:
    """The reading under which the loops close best; None where it is not far better.

    Args:
        pairs: as they were given.
        scatter: of their loops, in their unit of length.
        spread: scatter (2,) of the loops of pairs, in their unit of length and rad.
        rule: how much better is far better.

    Returns:
        What would have to be so, as "if …", and the scatter of the loops then, about every axis: in
        the given unit of length, and rad.
    """
    readings = (
        reading
        for hypothesis in known_hypotheses().values()
        if isinstance(hypothesis, Misreading)
        for reading in hypothesis.of_pairs(pairs)
    )
    spreads = ((spread(read.few), description, read.unit) for description, read in readings)
    (along, turned), description, unit = min(
        spreads,
        key=lambda reading: float(np.nan_to_num(reading[0][0], nan=np.inf)),
        default=(np.full(2, np.inf), "", 1.0),
    )
    # Times by which the scatter of the loops is less, where `Rule.far_better` asks for less: chance
    # halves it among so many readings of eight pairs, and never divides it by five.
    far_better = max(5.0, rule.far_better)
    # Loops of a reading turn no worse than this against one another, rad.
    turns_agree = from_deg(5.0)
    if not far_better * along < scatter or turned >= turns_agree:
        return None
    return description, float(unit * along), float(turned)
