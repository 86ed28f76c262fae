"""What every kind of observation has in common.

A term says what its samples must satisfy. Its author writes three things: the residual of one row
as a function of one or more tool poses, the term's own unknowns and the row's data; a closed-form
start for those unknowns; and which columns a samples file must have. Jacobians, robust weights,
uncertainty and reports follow from these.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import ArtefactError, SamplesError
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.measurements import Artefact, SampleColumns
from suta_calib.model.parameters import PLACEMENT, POSITION, ROTATION, Parameter
from suta_calib.terms.poses import PoseSource
from suta_calib.terms.seating import Seating
from suta_calib.units import Unit

if TYPE_CHECKING:
    from suta_calib.terms.certified import Certified
    from suta_calib.terms.resimulation import Resimulation

# An external frame can be anywhere: these only say when a pose counts as not determined at all.
PLAUSIBLE_POSITION: Final = 0.5
PLAUSIBLE_ROTATION: Final = 1.0


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid transform in CasADi symbols: rotation (3, 3) and position (3), m."""

    R: Symbol
    p: Symbol

    def inverse_act(self, point: Symbol) -> Symbol:
        """Coordinates, in this frame, of a point given in the outer one."""
        return self.R.T @ (point - self.p)


def pose_of(own: Symbol) -> Pose:
    """A pose from six own unknowns: x y z (m) and the rotation vector rx ry rz (rad)."""
    return Pose(symbolic_rotation(own[3:6]), own[0:3])


Residual = Callable[[Sequence[Pose], Symbol, Symbol], Symbol]


@dataclass(frozen=True)
class Noise:
    """How a block's residuals scatter, and how much of a large one is believed.

    Attributes:
        sigma: standard deviation of one component, m or rad; None to learn it from the data.
        huber: residual norm, m or rad, beyond which the cost grows linearly; inf for plain least
            squares.
    """

    sigma: float | None = None
    huber: float = math.inf


@dataclass(frozen=True, eq=False)
class Block:
    """Residuals of one unit and dimension, one row an observation.

    Attributes:
        name: ``distance``, ``position`` or ``rotation``.
        unit: m or rad.
        size: numbers in one residual, d.
        residual: the residual of one row in CasADi symbols.
        samples: (n, k) which k samples' poses each row looks at.
        own: (n, m) which of the term's own parameters each row looks at, in the residual's order.
        data: (n, c) what was measured or certified.
        noise: scatter and robustness.
        known_sigma: (n,) standard deviation per row that is known beforehand, added in quadrature.
        labels: (n,) what a person calls the row.
        certified: the artefact's part in the residuals, where there is an artefact.
    """

    name: str
    unit: Unit
    size: int
    residual: Residual
    samples: IntArray
    own: IntArray
    data: FloatArray
    noise: Noise
    known_sigma: FloatArray
    labels: tuple[str, ...] = field(repr=False)
    certified: Certified | None = None

    def __len__(self) -> int:
        return len(self.samples)


@dataclass(frozen=True)
class Setup:
    """What a row of a job file can say beside its samples; every kind takes what it needs.

    Attributes:
        artefact: certified landmarks, or None.
        noise, angular_noise: scatter and robustness of lengths and of angles.
        label: tells several instruments, or sockets, of one kind apart.
        seating: what the artefact's sockets leave open, or None.
    """

    artefact: Artefact | None = None
    noise: Noise = field(default_factory=Noise)
    angular_noise: Noise = field(default_factory=Noise)
    label: str = "default"
    seating: Seating | None = None

    def certified(self, kind: str) -> Artefact:
        """The artefact, or the error that it is missing."""
        if self.artefact is None:
            raise ArtefactError("no artefact", f"an artefact for {kind}", where=kind)
        return self.artefact


class Term(ABC):
    """One set of observations of one kind.

    Args:
        poses: where the tool poses come from.
        noise: scatter and robustness of lengths.
        angular_noise: the same for orientations, where the kind has them.

    Attributes:
        own: the term's own unknowns.
        blocks: its residuals.
    """

    kind: ClassVar[str]
    columns: ClassVar[SampleColumns]

    own: tuple[Parameter, ...]
    blocks: tuple[Block, ...]

    def __init__(
        self, poses: PoseSource, noise: Noise = Noise(), angular_noise: Noise = Noise()
    ) -> None:
        self.poses = poses
        self.noise = noise
        self.angular_noise = angular_noise

    @classmethod
    @abstractmethod
    def over(cls, poses: PoseSource, setup: Setup) -> Term:
        """Build the term from what a row of a job file can say, taking what this kind needs."""

    @abstractmethod
    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Closed-form values of `own` for given tool poses (n, 3, 3), (n, 3): the solver's start.

        Must be finite for any poses, also where the data leave some of them undetermined.
        """

    @abstractmethod
    def over_poses(self, poses: PoseSource) -> Self:
        """The same kind of term, with the same noise, artefact and label, over other poses."""

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
        del values, noise, again
        raise SamplesError(
            f"the kind {self.kind}", "one that can be simulated again", where="observations"
        )

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

        Repeats share whatever the model gets wrong about their posture, so they count as one
        witness. The k-th touch of a landmark in one repeat pairs with the k-th in another.
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

    def equations(self) -> int:
        """How many independent numbers the samples give at most."""
        return sum(len(block) * block.size for block in self.blocks)

    def check_enough(self) -> None:  # noqa: B027 (nothing to check is a fine answer)
        """Refuse sets too small to be fitted; a held-out set may be as small as it likes.

        Raises:
            SamplesError: too few samples, and how many are needed.
        """


def pose_parameters(label: str) -> tuple[Parameter, ...]:
    """The six unknowns of an external frame, ``label.x … label.rz``."""
    return tuple(
        Parameter(label, key, "rad", plausible=PLAUSIBLE_ROTATION)
        if key in ROTATION
        else Parameter(label, key, "m", plausible=PLAUSIBLE_POSITION)
        for key in PLACEMENT
    )


def point_parameters(label: str) -> tuple[Parameter, ...]:
    """The three unknowns of a point, ``label.x|y|z``."""
    return tuple(Parameter(label, key, "m", plausible=PLAUSIBLE_POSITION) for key in POSITION)


def pose_values(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """A pose as the six numbers of `pose_parameters`."""
    return np.concatenate([position, vector_from_rotation(rotation)])


def grouped(labels: NDArray[Any]) -> tuple[list[str], IntArray]:
    """Distinct labels in order of first appearance, and which of them each row has."""
    names, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return [str(names[i]) for i in order], rank[inverse].astype(np.intp)


def no_own(rows: int) -> IntArray:
    """Row indices of a block whose residual has no unknowns of its own."""
    return np.zeros((rows, 0), dtype=np.intp)


def norm(vector: Symbol) -> Symbol:
    """Euclidean norm of a CasADi vector."""
    return ca.sqrt(ca.dot(vector, vector))
