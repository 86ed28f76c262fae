"""Distances between certified landmarks: needs no base pose, sees no rigid motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import register_points
from suta_calib.geometry.symbols import Symbol
from suta_calib.measurements import Artefact, SampleColumns
from suta_calib.terms.certified import certified_rows
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.resimulation import Resimulation
from suta_calib.terms.seating import Seating, flat, seat_axes, seated_at
from suta_calib.terms.term import Block, Noise, Pose, Setup, Term, grouped, no_own, norm

# A distance scatters by the noise of both its ends.
DISTANCE_NOISE_FACTOR: Final = float(np.sqrt(2.0))


def _residual(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    del own
    return norm(poses[0].p - poses[1].p) - data[0]


def _seated(poses: Sequence[Pose], own: Symbol, data: Symbol) -> Symbol:
    """The same where the tip sits off the landmarks' axes, by as much everywhere."""
    apart = data[0:3] + ca.reshape(data[3:9], 3, 2) @ own
    return norm(poses[0].p - poses[1].p) - norm(apart)


class PairwiseDistance(Term):
    """``|p_i - p_j| - |l_i - l_j|`` for every two different landmarks of one placement and repeat.

    Pairs share samples, so their errors are correlated: the uncertainty of the solution accounts
    for that. A distance has no sign, so a mirrored arm would fit as well; bounds exclude it.

    Args:
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

    kind: ClassVar[str] = "pairwise_distance"
    columns: ClassVar[SampleColumns] = SampleColumns(labels=("placement", "repeat", "landmark"))

    def __init__(
        self,
        poses: PoseSource,
        artefact: Artefact,
        noise: Noise = Noise(),
        seating: Seating | None = None,
        label: str = "default",
    ) -> None:
        super().__init__(poses, noise)
        self.artefact, self.seating, self.label = artefact, seating, label
        names = poses.samples.labels["landmark"]
        certified = check_landmarks(poses, artefact)
        pairs = _pairs(poses)
        if not len(pairs):
            raise SamplesError(
                f"{len(poses)} samples without two different landmarks in any set",
                "at least two different landmarks with the same placement and repeat",
                where=self.kind,
                hint="check the columns placement and repeat",
            )
        first, second = pairs.T
        _check_apart(poses, first, second)
        apart = certified[first] - certified[second]
        length = np.linalg.norm(apart, axis=1)
        along = (apart / length[:, None])[:, None, None, :]
        sigma = np.array([artefact.landmarks[str(name)].sigma for name in names])
        residual, data = _residual, length[:, None]
        self.own, own = (), no_own(len(pairs))
        if seating is not None and seating.clearance:
            self.own = seating.parameters(label)[:2]
            axes = seat_axes(artefact, names)
            residual, data = _seated, np.hstack([apart, flat(axes[first] - axes[second])])
            own = np.tile(np.arange(2), (len(pairs), 1))
        self.blocks = (
            Block(
                "distance",
                "m",
                1,
                residual,
                pairs,
                own,
                data,
                noise,
                np.hypot(sigma[first], sigma[second]),
                tuple(f"{names[i]}-{names[j]}" for i, j in pairs),
                certified_rows(artefact, names[pairs], np.concatenate([-along, along], axis=2)),
            ),
        )

    def equations(self) -> int:
        """Distances between m points of one set fix their shape: 3 m - 6 numbers, not m²/2."""
        pairs = self.blocks[0].samples
        sets, found = self._sets(), 0
        for name in np.unique(sets):
            mine = pairs[sets[pairs[:, 0]] == name]
            points = len(np.unique(mine))
            found += min(len(mine), max(3 * points - 6, points - 1))
        return found

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> PairwiseDistance:
        """Build it from a row of a job file."""
        certified = setup.certified(cls.kind)
        return cls(poses, certified, setup.noise, setup.seating, setup.label)

    def over_poses(self, poses: PoseSource) -> Self:
        """The same over other poses."""
        return type(self)(poses, self.artefact, self.noise, self.seating, self.label)

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """Every set's landmarks where they fit best to what was touched."""
        names = self.poses.samples.labels["landmark"]
        marks = self.artefact.position_of(names)
        if self.own:
            marks = marks + seat_axes(self.artefact, names) @ seated_at(self.own, values)[0]
        _, position = self.poses.at(values)
        target, sets = np.empty_like(position), self._sets()
        for name in np.unique(sets):
            rows = sets == name
            R, p = register_points(marks[rows], position[rows])
            target[rows] = marks[rows] @ R.T + p
        return self.over_poses(again.touched(self.poses, target, noise[0] / DISTANCE_NOISE_FACTOR))

    def _sets(self) -> NDArray[np.str_]:
        """(n,) what tells apart the rows between which distances are formed."""
        labels = self.poses.samples.labels
        return np.char.add(np.char.add(labels["placement"], "/"), labels["repeat"])

    @property
    def subject(self) -> str:
        """The artefact, whose sockets the seating is about."""
        return f"artefact '{self.artefact.name}'"

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """On the sockets' axes, where distances know of sockets at all."""
        del rotation, position
        return np.zeros(len(self.own))


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


def check_landmarks(poses: PoseSource, artefact: Artefact) -> FloatArray:
    """Certified position (n, 3) of the landmark each sample touched, m, in the artefact."""
    samples = poses.samples
    for row, name in enumerate(samples.labels["landmark"]):
        if str(name) not in artefact.landmarks:
            raise SamplesError(
                f"landmark '{name}'",
                f"one of {', '.join(artefact.landmarks)}",
                where=samples.origin[row],
                hint=f"add it to the artefact '{artefact.name}' or correct the samples",
            )
    return artefact.position_of(samples.labels["landmark"])


def _pairs(poses: PoseSource) -> IntArray:
    """(n, 2) rows of the same placement and repeat, and different landmarks."""
    labels = poses.samples.labels
    _, landmark = grouped(labels["landmark"])
    _, placement = grouped(labels["placement"])
    _, repeat = grouped(labels["repeat"])
    sets = placement * (repeat.max(initial=0) + 1) + repeat
    found = [np.zeros((0, 2), dtype=np.intp)]
    for group in np.unique(sets):
        rows = np.flatnonzero(sets == group)
        i, j = np.triu_indices(len(rows), k=1)
        different = landmark[rows[i]] != landmark[rows[j]]
        found.append(np.column_stack([rows[i], rows[j]])[different])
    return np.concatenate(found).astype(np.intp)
