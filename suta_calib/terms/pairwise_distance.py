"""Distances between certified landmarks: needs no base pose, sees no rigid motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Final

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from suta_calib.arrays import BoolArray, FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.symbols import Symbol
from suta_calib.measurements import Artefact, Samples
from suta_calib.measurements.samples import joined
from suta_calib.model.parameters import Parameter
from suta_calib.terms.block import (
    LEARNT,
    Block,
    Certified,
    Noise,
    Pose,
    flat,
    grouped,
    norm,
)
from suta_calib.terms.landmark import (
    ARTEFACT_COLUMNS,
    ARTEFACT_GROUPINGS,
    TouchedLandmark,
    certified_positions,
    check_artefact_unit,
    positions_only,
    registered,
    seated,
)
from suta_calib.terms.length_scale import stretch_factors, stretch_parameters, stretched_point
from suta_calib.terms.observed import Observed
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.seating import Seating, seat_axes, seated_at
from suta_calib.terms.term import Term

# Distances of one term: each costs a kilobyte or two while it is solved, and m touches of one
# placement make m²/2 of them. From so many on, each touch is paired with some of the others only.
MOST_PAIRS: Final = 100_000


def _distance(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    length = data[0]
    if unknowns.numel():  # The tip sits off the landmarks' axes, by as much everywhere.
        length = norm(data[0:3] + ca.reshape(data[3:9], 3, 2) @ unknowns)
    return norm(poses[0].p - poses[1].p) - length


def _distance_stretched(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """The same on an artefact whose stretch is unknown: the last two of the own unknowns."""
    made = stretched_point(data[0:3], unknowns[-2:])
    if unknowns.numel() > 2:
        made = made + ca.reshape(data[3:9], 3, 2) @ unknowns[:2]
    return norm(poses[0].p - poses[1].p) - norm(made)


@dataclass(frozen=True, eq=False, repr=False)
class PairwiseDistance(Term):
    """``|p_i - p_j| - |l_i - l_j|`` for every two different landmarks of one placement and repeat.

    Pairs share samples, so their errors are correlated: the uncertainty of the solution accounts
    for that, and for the pairs that are left out where there are too many (`landmark_pairs`). A
    distance has no sign, so a mirrored arm would fit as well; bounds exclude it.

    Attributes:
        poses: samples with the labels placement, repeat and landmark.
        artefact: certified landmark positions.
        noise: scatter and robustness of a distance, m.
        seating: what the sockets leave open; the tip fits them exactly by default. Its rotation is
            of no use here.
        label: tells the seating in several artefacts apart.

    Raises:
        ArtefactError: a landmark without orientation where there is a seating.
        SamplesError: no placement holds two different landmarks, or a landmark is not certified.
    """

    kind = "pairwise_distance"
    order = 1
    about = (
        "distances between landmarks of an artefact that the tip is seated in, at any number of "
        "placements (at least two landmarks with the same placement and repeat)"
    )
    columns = ARTEFACT_COLUMNS
    needs_artefact = True
    has_angles = False
    place = "placement"
    place_unknown = "placement"
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = ARTEFACT_GROUPINGS
    # A distance scatters by the noise of both its ends.
    noise_factor = float(np.sqrt(2.0))
    tested = "length"

    artefact: Artefact
    noise: Noise = LEARNT
    seating: Seating | None = None
    label: str = "default"

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """How the tip sits off the sockets' axes, where that is open; the artefact's stretch."""
        return (*self._shift, *stretch_parameters(self.artefact.name, self.artefact.stretch))

    @property
    def _shift(self) -> tuple[Parameter, ...]:
        shifted = self.seating is not None and self.seating.clearance
        return self.seating.parameters(self.label)[:2] if self.seating and shifted else ()

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The distances."""
        poses, artefact = self.poses, self.artefact
        names = poses.samples.labels["landmark"]
        certified = self._certified
        pairs = landmark_pairs(poses.samples)
        if not len(pairs):
            raise self.refuse(
                f"{len(poses)} samples without two different landmarks in any set",
                "at least two different landmarks with the same placement and repeat",
                hint="check the columns placement and repeat",
            )
        first, second = pairs.T
        _check_apart(poses, first, second)
        difference = certified[first] - certified[second]
        length = np.linalg.norm(difference, axis=1)
        along = (difference / length[:, None])[:, None, None, :]
        by_mark = np.concatenate([-along, along], axis=2)
        touched = Certified.of(artefact, names, pairs, by_mark)
        data = length[:, None]
        residual = _distance
        if artefact.stretch is not None:
            data, residual = difference, _distance_stretched
        if self._shift:
            axes = seat_axes(artefact, names)
            data = np.hstack([difference, flat(axes[first] - axes[second])])
        own_columns = np.tile(np.arange(len(self.own_parameters)), (len(pairs), 1))
        sigma = np.hypot(*touched.sigma[touched.marks].T)
        labels = _pair_labels(names, pairs)
        block = Block.per_sample(
            "distance", "m", 1, residual, own_columns, data, self.noise, labels
        )
        return (replace(block, samples=pairs, known_sigma=sigma, certified=touched),)

    def check_enough(self) -> None:
        """An artefact in mm, as the arm touched it."""
        check_artefact_unit(self, self._certified, self._numbered)

    @cached_property
    def _certified(self) -> FloatArray:
        """(n, 3) positions of the touched landmarks in the artefact, m."""
        return certified_positions(self.poses, self.artefact)

    @cached_property
    def _numbered(self) -> IntArray:
        """(n,) number of the set of each sample."""
        return grouped(self._sets(self.poses))[1]

    @property
    def notes(self) -> tuple[str, ...]:
        """That not all pairs are looked at."""
        possible = _possible_pairs(np.bincount(self._numbered))
        if possible <= MOST_PAIRS:
            return ()
        return (
            f"{len(self.poses):,} touches make up to {possible:,} pairs within their placements. "
            f"Only {len(self.blocks[0]):,} of them are used, each touch with some of the others. "
            "This hardly changes the result, and ± includes it.",
        )

    @cached_property
    def _equations(self) -> int:
        """Distances between m points of one set fix their shape: 3 m - 6 numbers, not m²/2."""
        rests, first = self.poses.rests, self.blocks[0].samples[:, 0]
        ends = rests[self.blocks[0].samples]
        number, many = self._numbered, int(rests.max()) + 1
        # Within a set, each point and each pair of them counts once.
        both = np.unique((number[first, None] * many + ends).reshape(-1))
        pairs = np.unique((number[first] * many + ends[:, 0]) * many + ends[:, 1])
        points, distances = np.bincount(both // many), np.bincount(pairs // many**2)
        shape = np.maximum(3 * points - 6, points - 1)
        return int(np.minimum(distances, shape)[points > 0].sum())

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """Every set's landmarks where they fit best to what was touched."""
        landmarks = poses.samples.labels["landmark"]
        sits = seated_at(self.own_parameters, values)
        artefact = self.artefact.stretched(stretch_factors(self.own_parameters, values))
        marks = seated(artefact, landmarks, np.eye(3), np.zeros(3), *sits).place
        _, position = poses.at(values)
        names, which = grouped(self._sets(poses))
        R, p = registered(marks, position, which, len(names))
        return Observed(np.einsum("nij,nj->ni", R[which], marks) + p[which])

    @staticmethod
    def _sets(poses: PoseSource) -> NDArray[np.str_]:
        """(n,) what tells apart the rows between which distances are formed."""
        return joined(poses.samples.labels, ARTEFACT_GROUPINGS["set"])

    @property
    def touched(self) -> Artefact:
        """The artefact whose landmarks are touched."""
        return self.artefact

    def single_touches(self) -> TouchedLandmark:
        """Touches of the artefact, registered set by set: which is what distances are blind to."""
        samples = self.poses.samples
        labels = {**samples.labels, "placement": self._sets(self.poses)}
        poses = self.poses.with_samples(replace(samples, labels=labels))
        return TouchedLandmark(poses, positions_only(self.artefact))

    def errors_of_touches(self, displacement: FloatArray, samples: IntArray) -> FloatArray:
        """What moves the ends of a distance along it, to first order."""
        ends = self.artefact.position_of(self.poses.samples.labels["landmark"])[samples]
        difference = ends[:, 0] - ends[:, 1]
        along = difference / np.linalg.norm(difference, axis=1)[:, None]
        # A touch takes part in many distances: a sparse product gathers nothing.
        columns = (3 * samples[:, :, None] + np.arange(3)).reshape(-1)
        signed = np.stack([along, -along], axis=1).reshape(-1)
        pointer = 6 * np.arange(len(samples) + 1)
        flattened = displacement.reshape(len(displacement), -1)
        by_touch = csr_array((signed, columns, pointer), (len(samples), flattened.shape[1]))
        return np.asarray((by_touch @ flattened.T).T[:, :, None])

    @property
    def subject(self) -> str:
        """The artefact, whose sockets the seating is about."""
        return f"artefact '{self.artefact.name}'"

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """On the sockets' axes, where distances know of sockets at all."""
        del rotation, position
        return np.zeros(len(self.own_parameters))


def _check_apart(poses: PoseSource, first: IntArray, second: IntArray) -> None:
    """Refuse one posture for two landmarks: the gradient of a distance of zero does not exist."""
    q = poses.samples.q
    same = np.flatnonzero(np.all(q[first] == q[second], axis=1)) if q.shape[1] else first[:0]
    if len(same):
        row, other = int(first[same[0]]), int(second[same[0]])
        names, origin = poses.samples.labels["landmark"], poses.samples.origin
        raise SamplesError(
            f"the same readings for landmarks {names[row]} and {names[other]} "
            f"({origin[row]}, {origin[other]})",
            "different readings for different landmarks",
            where=PairwiseDistance.kind,
            hint="record one of them again",
        )


def landmark_pairs(samples: Samples) -> IntArray:
    """(n, 2) rows of the same placement and repeat, and different landmarks.

    Not of rows that stand elsewhere in the files to the last digit: k copies of every row would
    make k² of every distance. A row that was taken twice, as in a bootstrap, counts twice.

    Where there are more than `MOST_PAIRS`, each row of a large set is paired with as many others
    of it, drawn at random but the same every time.
    """
    columns = ("landmark", "placement", "repeat")
    landmark, placement, repeat = (grouped(samples.labels[name])[1] for name in columns)
    sets = placement * (repeat.max(initial=0) + 1) + repeat
    original = _original(np.column_stack([sets, landmark, samples.q]), samples.origin)
    thinned = _possible_pairs(np.bincount(sets[original])) > MOST_PAIRS
    sorted_rows = np.flatnonzero(original)
    sorted_rows = sorted_rows[np.argsort(sets[sorted_rows], kind="stable")]
    found_pairs = [np.zeros((0, 2), dtype=np.intp)]
    if thinned:
        partners = max(1, MOST_PAIRS // len(sets))
        large = np.bincount(sets[sorted_rows])[sets[sorted_rows]] - 1 > 2 * partners
        of_large, sorted_rows = sorted_rows[large], sorted_rows[~large]
        found_pairs.append(of_large[_some_pairs(sets[of_large], landmark[of_large], partners)])
    found_pairs.append(sorted_rows[_pairs_within(sets[sorted_rows])])
    pairs = np.concatenate(found_pairs).astype(np.intp)
    different = landmark[pairs[:, 0]] != landmark[pairs[:, 1]]
    return np.asarray(pairs[different])


def _pairs_within(sets: IntArray) -> IntArray:
    """(n, 2) all pairs of places with the same number; equal numbers stand together."""
    places = np.arange(len(sets))
    last = np.searchsorted(sets, sets, side="right") - 1
    partners = last - places
    first = np.repeat(places, partners)
    begins = np.cumsum(partners) - partners
    second = first + 1 + np.arange(len(first)) - np.repeat(begins, partners)
    return np.column_stack([first, second])


def _pair_labels(names: NDArray[np.str_], pairs: IntArray) -> list[str]:
    """The landmarks of each pair of samples; a text is made once, however many pairs have it."""
    marks, number = np.unique(names, return_inverse=True)
    kinds, which = np.unique(number[pairs] @ [len(marks), 1], return_inverse=True)
    ends = marks.tolist()
    texts = [f"{ends[k // len(ends)]}-{ends[k % len(ends)]}" for k in kinds.tolist()]
    return [texts[k] for k in which.tolist()]


def _original(numbers: FloatArray, origin: Sequence[str]) -> BoolArray:
    """(n,) rows of which none before, from elsewhere, has the same numbers."""
    ordered = np.sort(numbers[:, -1])
    if not np.any(ordered[1:] == ordered[:-1]):
        return np.ones(len(numbers), dtype=np.bool_)
    _, first, original = np.unique(numbers, axis=0, return_index=True, return_inverse=True)
    places = np.array(origin)
    return np.asarray(places == places[first[original.reshape(-1)]])


def _possible_pairs(sizes: IntArray) -> int:
    """How many pairs sets of these sizes make at most."""
    return int(np.sum(sizes * (sizes - 1) // 2))


def _some_pairs(sets: IntArray, landmark: IntArray, partners: int) -> IntArray:
    """(n, 2) different pairs of rows of one set, each with so many of other landmarks, or fewer.

    Rows stand set by set; all sets are looked at together.
    """
    order = np.lexsort((landmark, sets))
    # In this order the rows of a landmark stand together, and those of all others of the set behind
    # them, or at its beginning.
    of_set, of_mark = sets[order], sets[order] * (landmark.max(initial=0) + 1) + landmark[order]
    begin, end = (np.searchsorted(of_set, of_set, side) for side in ("left", "right"))
    first, behind = (np.searchsorted(of_mark, of_mark, side) for side in ("left", "right"))
    partner_rank = (end - begin) - (behind - first)
    drawn = np.random.default_rng(0).random((len(order), partners))
    chosen = (behind - begin)[:, None] + np.floor(drawn * partner_rank[:, None]).astype(np.intp)
    second = order[begin[:, None] + chosen % (end - begin)[:, None]]
    low, high = np.minimum(order[:, None], second), np.maximum(order[:, None], second)
    return np.column_stack(np.divmod(np.unique(low * len(order) + high), max(len(order), 1)))
