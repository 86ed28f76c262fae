"""Directions that poses leave open, in words: an answer along them would be noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.model.parameters import PLACEMENT
from suta_calib.solver.identifiability import NOISE_INDUCED_SHARE
from suta_calib.solver.solution import Solution
from suta_calib.words import listed

# Motions about or along an axis, and about or along all of them.
TURN: Final = ("turn about", "turn about any axis")
SLIDE: Final = ("slide along", "be anywhere")
# What has a pose among several.
Role = Literal["eye", "camera", "target"]


class UndeterminedError(SamplesError):
    """Poses that leave ``directions`` of an unknown open, in words."""

    directions: tuple[str, ...] = ()


@dataclass(frozen=True)
class NotFound:
    """An eye, a camera or a target among several of which the data give no pose.

    Attributes:
        role: what it is.
        name: its label.
        rows: how many look at it.
        directions: in which its pose is open, in words.
        partners: names of those that it was seen with, if none of them was found either; without
            these and `directions` no row of it agrees with the others.
    """

    role: Role
    name: str
    rows: int
    directions: tuple[str, ...] = ()
    partners: tuple[str, ...] = ()

    @property
    def disagrees(self) -> bool:
        """Whether it is left out because no row of it agrees with the others."""
        return not (self.directions or self.partners)

    @property
    def sentence(self) -> str:
        """Why there is no pose, and what to do."""
        what = "Z" if self.role == "target" else "X"
        if self.directions:
            shared = ", or let it see a target that another eye sees too" * (self.role == "eye")
            return (
                f"{what} of {self.role} {self.name} could not be determined and is not given: it "
                f"may {' and '.join(self.directions)}. Turn the hand about at least two axes that "
                f"are not parallel while this {self.role} sees a target{shared}."
            )
        if self.partners:
            other = "eye" if self.role == "target" else "target"
            return (
                f"{what} of {self.role} {self.name} is not given: it was seen with {other} "
                f"{listed([*self.partners])} only, which could not be placed."
            )
        return (
            f"{what} of {self.role} {self.name} could not be determined and is not given: none of "
            f"its {self.rows} rows agrees with the others. Is the label right, and did "
            f"{self.role} {self.name} stay in its place? Measure again."
        )


def refuse_undetermined(
    solution: Solution,
    unknown: str,
    what: str,
    advice: str,
    slides: FloatArray | None = None,
    more: Sequence[FloatArray] = (),
) -> None:
    """Refuse a solution whose data leave directions of an unknown open, and name them.

    Args:
        solution: what was solved.
        unknown: prefix of the parameters, such as ``tip``.
        what: a reader calls it, with its frame, such as ``the tip in the tool``.
        advice: what to do.
        slides: (k, 3) directions to name instead of those found at the solution, which says nothing
            true where the start was as undetermined as the solution.
        more: displacements and turns (6,) that are undetermined beside what the solution holds.
    """
    if directions := undetermined_directions(solution, unknown, more, slides):
        problem = UndeterminedError(
            f"poses that do not determine {what}: it may {' and '.join(directions)}",
            "poses turned by tens of degrees about at least two different axes",
            hint=advice,
        )
        problem.directions = tuple(directions)
        raise problem


def undetermined_directions(
    solution: Solution,
    unknown: str,
    more: Sequence[FloatArray] = (),
    slides_instead: FloatArray | None = None,
) -> list[str]:
    """What may change unnoticed, each in words such as ``slide along (0.00, 0.00, 1.00)``."""
    keys = {f"{unknown}.{key}": k for k, key in enumerate(PLACEMENT)}
    weak = [np.asarray(vector) for vector in more]
    for combination in solution.identification.combinations:
        vector = np.zeros(6)
        for name, part in combination.direction.items():
            if name in keys:
                vector[keys[name]] = part
        if vector.any():
            weak.append(vector / np.linalg.norm(vector))
    if not weak:
        return []
    if slides_instead is not None:
        return _ways(SLIDE, slides_instead)
    slide, turn = np.split(np.array(weak).T, 2)
    turns, without_turn = _span(turn)
    slides, _ = _span(slide @ without_turn)
    return [*_ways(TURN, turns), *_ways(SLIDE, slides)]


def _ways(words: tuple[str, str], axes: Sequence[FloatArray] | FloatArray) -> list[str]:
    """Motions along or about some axes (k, 3), in words for each of them and for all three."""
    each, anyhow = words
    return [anyhow] if len(axes) == 3 else [f"{each} {_vector(v)}" for v in axes]


def axes_that_stand(rotation: FloatArray, noise: float) -> FloatArray:
    """Axes (k, 3) in the body that no orientation (n, 3, 3) turns; none if they turn about several.

    ``noise`` is of a component of their rotation vectors, rad.
    """
    mean = rotation.mean(axis=0)
    # Noise may be as small a part of what an axis turns by, as a variance, as of any direction.
    moved, axes = np.linalg.eigh(np.eye(3) - mean.T @ mean)
    return np.asarray(axes.T[moved < max(2.0 * noise**2 / NOISE_INDUCED_SHARE, 1e-12)])


def _span(columns: FloatArray) -> tuple[list[FloatArray], FloatArray]:
    """Orthonormal vectors that span what columns (3, k) do, and the (k, r) that give nothing."""
    u, s, v = np.linalg.svd(columns)
    # Part of a direction from which it is named.
    rank = int(np.sum(s > 0.02))
    return [np.asarray(u[:, k]) for k in range(rank)], np.asarray(v[rank:].T)


def _vector(vector: FloatArray) -> str:
    unit = vector / np.linalg.norm(vector)
    unit = unit * np.sign(unit[np.argmax(np.abs(unit))])
    return "(" + ", ".join(f"{0.0 if abs(v) < 5e-3 else v:.2f}" for v in unit) + ")"
