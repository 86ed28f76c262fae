"""What every kind of observation has in common.

A term says what its samples must satisfy. Its author writes the residual of one row as a function
of one or more tool poses, the term's own unknowns and the row's data; a closed-form start for those
unknowns; and what an ideal measurement would have been (`Term.observed`). Jacobians, robust
weights, uncertainty and reports follow from the first two, simulations from the last.

Everything else that somebody must know of a kind (what it needs, its columns and keys, how its
samples group, the words for it) is a class attribute: job files, `init`, simulations, searches for
outliers, plans, guided measuring and explanations ask the kind, and name none.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Final, Literal, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import ArtefactError, SamplesError
from suta_calib.geometry.numbers import rotation_from_vector, vector_from_rotation
from suta_calib.measurements import Artefact, SampleColumns, YamlSection
from suta_calib.model.parameters import PLACEMENT, POSITION, ROTATION, Parameter
from suta_calib.terms.block import LEARNT, Block, Noise, grouped
from suta_calib.terms.outside import OutsideFrame, frames_of
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.seating import Seating
from suta_calib.units import mm

# An external frame can be anywhere: these only say when a pose counts as not determined at all.
PLAUSIBLE_POSITION: Final = 0.5
PLAUSIBLE_ROTATION: Final = 1.0

# What tells where the arm is: its tip touches something, an instrument sees the tip, or a camera
# on the tip sees something.
Medium = Literal["touch", "instrument", "camera"]
# Motions that observations may leave open: of the whole arm in the base, of the tip along the tool,
# of all that is touched at one place.
Gap = Literal["base", "tool", "place"]


# Extents of what was seen or touched and of what the arm moved that differ by more are in different
# units: no geometry is so wrong.
OTHER_UNIT: Final = 20.0
# A tip that moves by less, m, lies on the axes that were turned about, if anything moved.
UNMOVED: Final = 1e-7


@dataclass(frozen=True)
class Setup:
    """What a row of a job file can say beside its samples; every kind takes what it needs.

    Attributes:
        artefact: certified landmarks, or None.
        noise, angular_noise: scatter and robustness of lengths and of angles.
        label: tells several instruments, or sockets, of one kind apart.
        seating: what the artefact's sockets leave open, or None.
        settings: what the kind's own keys say, as its `Term.read_settings` has read them.
    """

    artefact: Artefact | None = None
    noise: Noise = field(default_factory=Noise)
    angular_noise: Noise = field(default_factory=Noise)
    label: str = "default"
    seating: Seating | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    def certified(self, kind: str) -> Artefact:
        """The artefact, or the error that it is missing."""
        if self.artefact is None:
            raise ArtefactError("no artefact", f"an artefact for {kind}", where=kind)
        return self.artefact


@dataclass(frozen=True)
class TrueFrame:
    """A frame that a simulation of a kind may state, in place of the unknown that it is.

    Attributes:
        own: the unknowns, ``own.x … own.rz``.
        key: of the simulation's file: what it is, ``_in_``, and in whose frame.
        required: whether a simulation must state it; the frames coincide by default.
    """

    own: str
    key: str
    required: bool


@dataclass(frozen=True, eq=False)
class Observed:
    """What an ideal instrument would report, or where a tip that touches ideally would be.

    Attributes:
        position: (n, 3), m: of what is seen, in the instrument or the camera; of a tip that
            touches, in the base.
        rotation: (n, 3, 3) of the same, or None where the observation says nothing of it.
    """

    position: FloatArray
    rotation: FloatArray | None = None


class Resimulation(Protocol):
    """A measurement repeated in simulation: how an arm reaches its targets, and how that scatters.

    A term knows where its touches should have been, or what its instrument should have seen; the
    rest is the resimulation's: `analysis.study.trial` has one.
    """

    def touched(self, poses: PoseSource, target: FloatArray, sigma: float) -> PoseSource:
        """Poses near the given ones whose tip is at the targets (n, 3), m, plus noise.

        Args:
            poses: as they were measured.
            target: (n, 3) where the tip should have been, m, in the base frame.
            sigma: standard deviation of each coordinate, m.
        """

    def seen(self, poses: PoseSource, seen: Observed, noise: Sequence[float]) -> PoseSource:
        """The same poses with what an instrument sees in their samples, plus noise.

        Args:
            poses: as they were measured.
            seen: without noise.
            noise: standard deviation of a coordinate, m, and, where orientations are seen, of a
                component of their turn, rad.
        """

    def turned(self, rotation: FloatArray, sigma: float) -> FloatArray:
        """Rotations (n, 3, 3), each turned by noise of ``sigma`` rad about every axis."""


@dataclass(frozen=True, eq=False)
class Term(ABC):
    """One set of observations of one kind.

    Attributes:
        kind: its name in files.
        about: what was measured, for whoever starts a job: follows the kind's name and a colon.
        columns: what its samples hold beside the joints.
        medium: what tells where the arm is.
        needs_artefact: whether an artefact is touched.
        has_angles: whether it looks at orientations, so that their noise means something.
        keys: what else a row of a job may say, read by `read_settings`.
        place: label column of what stands somewhere unknown and is touched; empty where nothing is.
        place_unknown: name of the unknowns of one such place, before its label in brackets.
        place_turns: whether such a place has an orientation.
        groupings: what its samples can be grouped by: what one group is called, and the label
            columns whose values, joined by a slash, name it; none for every row by itself.
        noise_factor: standard deviation of a component of the first block, over that of one
            coordinate of one touch.
        simulation_keys: what else a set of a simulation may say, read by `read_settings`.
        frames: what a simulation may state of what sees or is seen.
        tested: what of an acceptance test after ISO 10360-12 its samples measure.
        leaves_open: by what is left open, why this kind alone cannot tell, and what to do then.
        tells: by what others leave open, how this kind tells it: an advice.
        poses: where the tool poses come from.
    """

    kind: ClassVar[str]
    about: ClassVar[str]
    columns: ClassVar[SampleColumns]
    medium: ClassVar[Medium] = "touch"
    needs_artefact: ClassVar[bool] = False
    has_angles: ClassVar[bool] = True
    keys: ClassVar[tuple[str, ...]] = ()
    place: ClassVar[str] = ""
    place_unknown: ClassVar[str] = ""
    place_turns: ClassVar[bool] = True
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"row": ()}
    noise_factor: ClassVar[float] = 1.0
    simulation_keys: ClassVar[tuple[str, ...]] = ()
    frames: ClassVar[tuple[TrueFrame, ...]] = ()
    tested: ClassVar[Literal["", "length", "articulation"]] = ""
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {}
    tells: ClassVar[Mapping[Gap, str]] = {}

    poses: PoseSource

    def __post_init__(self) -> None:
        # What cannot be used is refused where the term is made, not where it is first looked at.
        _ = self.blocks

    @property
    @abstractmethod
    def own(self) -> tuple[Parameter, ...]:
        """The term's own unknowns."""

    @property
    @abstractmethod
    def blocks(self) -> tuple[Block, ...]:
        """Its residuals: of lengths first, then of angles where there are any."""

    @cached_property
    def places(self) -> tuple[list[str], IntArray]:
        """Labels of the places that are touched, and which of them each sample has, (n,)."""
        return grouped(self.poses.samples.labels[self.place])

    @classmethod
    @abstractmethod
    def over(cls, poses: PoseSource, setup: Setup) -> Term:
        """Build the term from what a row of a job file can say, taking what this kind needs."""

    @classmethod
    def read_settings(cls, row: YamlSection) -> dict[str, Any]:
        """The values of the kind's own `keys` and `simulation_keys` in a row or a set, in SI.

        Raises:
            InputError: one cannot be used; names the line and the key.
        """
        del row
        return {}

    @classmethod
    def touches(
        cls,
        rotation: FloatArray,
        position: FloatArray,
        where: FloatArray,
        settings: Mapping[str, Any],
    ) -> FloatArray:
        """Where the tip touches a place, for kinds that touch one without an artefact.

        Args:
            rotation: (3, 3) of the place in the base.
            position: (3,) of the place in the base, m.
            where: (n, 2) numbers from 0 to 1 that say where on it.
            settings: as `read_settings` gives them.

        Returns:
            Positions (n, 3) of the tip in the base, m.
        """
        del rotation, settings
        return np.tile(position, (len(where), 1))

    @abstractmethod
    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Closed-form values of `own` for given tool poses (n, 3, 3), (n, 3): the solver's start.

        Must be finite for any poses, also where the data leave some of them undetermined.
        """

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """What an ideal measurement of these poses would be: the kind's forward model.

        Args:
            values: what is taken for the truth: of the arm and of `own`, m or rad.
            poses: with the labels that this kind needs; what was seen is not looked at. Of a tip
                that touches, they say how it comes.

        Raises:
            SamplesError: the kind has none.
        """
        del values, poses
        raise SamplesError(
            f"the kind {self.kind}", "one that can be simulated again", where="observations"
        )

    def over_poses(self, poses: PoseSource) -> Self:
        """The same kind of term, with the same noise, artefact and label, over other poses."""
        return replace(self, poses=poses)

    def take(self, rows: ArrayLike) -> Self:
        """The term over some of its samples, by number (repeats allowed) or by boolean mask.

        What a study, a bootstrap or leaving one out refits: compiled functions are shared, so that
        it costs little more than its rows.

        Raises:
            SamplesError: the kind cannot be built over these rows alone.
        """
        return self.over_poses(self.poses.take(rows))

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """The term over an arm's samples simulated anew, in nearly the same postures.

        Args:
            values: what is taken for the truth: of the arm and of `own`, m or rad.
            noise: of each block, m or rad per component of its residual.
            again: how the arm reaches what it touches, and how that scatters.

        Raises:
            SamplesError: the kind has no such simulation, or a target cannot be reached.
        """
        ideal = self.observed(values, self.poses)
        if self.medium != "touch":
            return self.over_poses(again.seen(self.poses, ideal, noise))
        sigma = noise[0] / self.noise_factor
        return self.over_poses(again.touched(self.poses, ideal.position, sigma))

    @property
    def settings(self) -> Mapping[str, Any]:
        """The values of the kind's own `keys` that this term was built with."""
        return {}

    @property
    def touched(self) -> Artefact | None:
        """The artefact whose landmarks are touched, if there is one."""
        return None

    def single_touches(self) -> Term:
        """A term whose first block has one residual for each sample, over the same samples."""
        return self

    def errors_of_touches(self, displacement: FloatArray, samples: IntArray) -> FloatArray:
        """Errors (k, n, d) of rows of the first block that random displacements of touches make.

        Args:
            displacement: (k, samples, 3) independent and alike in every direction, m. A residual
                of d components sees d of them, whichever frame it is written in.
            samples: (n, ·) which samples each row looks at.
        """
        return displacement[:, samples[:, 0], : self.blocks[0].size]

    @property
    def outside(self) -> tuple[OutsideFrame, ...]:
        """The poses and the points that the own unknowns are: of `frames`, and of `places`."""
        owners: dict[str, set[str]] = {}
        for p in self.own:
            owners.setdefault(p.owner, set()).add(p.key)
        words = {self.place_unknown: (self.place, "base")} if self.place_unknown else {}
        for frame in self.frames:
            what, _, within = frame.key.partition("_in_")
            words[frame.own] = (what, within)
        return tuple(frames_of(owners, words))

    @property
    def subject(self) -> str:
        """What the own unknowns are about; terms may share an unknown only if it is the same."""
        return self.kind

    def start_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """`start` by name, at the poses that belong to these parameter values."""
        if not self.own:
            return {}
        own = self.start(*self.poses.at(values))
        return {p.name: float(v) for p, v in zip(self.own, own, strict=True)}

    def repeats(self) -> IntArray:
        """(n,) one number for all samples that are repeats of the same touch, else their own.

        The k-th touch of a landmark in one repeat pairs with the k-th in another.
        """
        labels = self.poses.samples.labels
        if not {"placement", "repeat", "landmark"} <= set(labels):
            return np.arange(len(self.poses), dtype=np.intp)
        seen: Counter[tuple[str, str, str]] = Counter()
        touches = []
        for row in zip(labels["placement"], labels["landmark"], labels["repeat"], strict=True):
            touches.append((row[0], row[1], seen[row]))
            seen[row] += 1
        index = {touch: k for k, touch in enumerate(dict.fromkeys(touches))}
        return np.array([index[touch] for touch in touches], dtype=np.intp)

    @cached_property
    def witnesses(self) -> IntArray:
        """(n,) one number, from 0, for all samples that err together.

        They are at one posture, read without moving or met again, or repeat a touch: they share
        whatever the model gets wrong there. The sum of their errors counts, not their number.
        """
        at, touches = self.poses.postures, self.repeats()
        one = coo_array((np.ones(len(at)), (at, len(at) + touches)), (2 * len(at),) * 2)
        together = connected_components(one, directed=False)[1][at]
        return np.asarray(np.unique(together, return_inverse=True)[1], dtype=np.intp)

    @property
    def notes(self) -> tuple[str, ...]:
        """What must be known of how the samples are used, one sentence each."""
        return ()

    def equations(self) -> int:
        """How many independent numbers the samples give at most: a rest counts once."""
        rests = self.poses.rests
        return sum(
            len(np.unique(rests[block.samples], axis=0)) * block.size for block in self.blocks
        )

    def check_enough(self) -> None:  # noqa: B027 (nothing to check is a fine answer)
        """Refuse sets too small to be fitted; a held-out set may be as small as it likes.

        Raises:
            SamplesError: too few samples, and how many are needed.
        """


# What says the unit of what is seen.
SEEN_UNIT: Final = (
    "columns x, y, z are in m, and x_mm, y_mm, z_mm in mm: is it another unit, or another arm?"
)


@dataclass(frozen=True, eq=False)
class SeenTerm(Term):
    """What an instrument, or a camera, sees: positions and perhaps orientations.

    The own unknowns are the poses of its `frames`.

    Attributes:
        noise: scatter and robustness of a position, m per axis.
        angular_noise: the same for the orientation, rad per axis.
        label: tells several instruments of one kind apart.
    """

    noise: Noise = LEARNT
    angular_noise: Noise = LEARNT
    label: str = "default"

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> Self:
        """Build it from a row of a job file."""
        return cls(poses, setup.noise, setup.angular_noise, setup.label)

    @property
    def _frames(self) -> list[str]:
        suffix = "" if self.label == "default" else f"[{self.label}]"
        return [frame.own + suffix for frame in self.frames]

    @cached_property
    def own(self) -> tuple[Parameter, ...]:
        """The poses of its frames."""
        return tuple(p for frame in self._frames for p in pose_parameters(frame))


def check_unit(term: Term, what: str, size: float, moved: float, expected: str, hint: str) -> None:
    """Refuse lengths in another unit than the arm's, which no solver would make fit.

    Args:
        term: whose lengths they are.
        what: was seen or touched, in the plural.
        size: root mean square distance of these from their middle, m.
        moved: the same of the tip by the arm's nominal geometry, m.
        expected: what there should be.
        hint: which columns, or which key, say the unit.

    Raises:
        SamplesError: one is more than `OTHER_UNIT` times the other, or the tip does not move.
    """
    if moved < UNMOVED:
        raise SamplesError(
            f"a tip that the arm's readings move by {mm(moved):.2g} mm",
            "readings that differ, and a tip off the axes of the joints that turn",
            where=term.kind,
        )
    if not moved / OTHER_UNIT <= size <= moved * OTHER_UNIT:
        raise SamplesError(
            f"{what} {mm(size):.4g} mm about their middle, where the arm's readings move the tip "
            f"by {mm(moved):.4g} mm",
            expected,
            where=term.kind,
            hint=hint,
        )


def pose_parameters(label: str) -> tuple[Parameter, ...]:
    """The six unknowns of an external frame, ``label.x … label.rz``."""
    turn = (Parameter(label, key, "rad", plausible=PLAUSIBLE_ROTATION) for key in ROTATION)
    return (*point_parameters(label), *turn)


def point_parameters(label: str) -> tuple[Parameter, ...]:
    """The three unknowns of a point, ``label.x|y|z``."""
    return tuple(Parameter(label, key, "m", plausible=PLAUSIBLE_POSITION) for key in POSITION)


def pose_values(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """A pose as the six numbers of `pose_parameters`."""
    return np.concatenate([position, vector_from_rotation(rotation)])


def pose_named(values: Mapping[str, float], label: str) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and position (3,), m, of the unknowns ``label.x … label.rz``."""
    six = np.array([values[f"{label}.{key}"] for key in PLACEMENT])
    return rotation_from_vector(six[3:]), six[:3]


def point_named(values: Mapping[str, float], label: str) -> FloatArray:
    """Position (3,), m, of the unknowns ``label.x|y|z``."""
    return np.array([values[f"{label}.{key}"] for key in POSITION])
