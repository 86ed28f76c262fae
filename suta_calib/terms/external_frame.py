"""Things outside the arm that are estimated with it: cameras, instruments, artefacts, points.

A term's own unknowns are numbers; most of them make up a pose or a point that somebody came for:
``x, y, z`` and a rotation vector ``rx, ry, rz``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector, vector_from_rotation
from suta_calib.model.parameters import PLACEMENT, POSITION, ROTATION, Parameter

# An external frame can be anywhere: these only say when a pose counts as not determined at all.
PLAUSIBLE_POSITION: Final = 0.5

# Rotation (3, 3), None for what has no orientation, and position (3,), m.
OutsidePose = tuple[FloatArray | None, FloatArray]


@dataclass(frozen=True)
class ExternalFrame:
    """A frame, or a point, that some unknowns of a term are the pose of.

    Attributes:
        owner: of the unknowns, e.g. ``placement[P1]``.
        what: in a word: ``artefact``.
        within: in whose frame its pose is: ``base``.
        keys: of the unknowns that the pose depends on.
        given: keys of the job, relative to which the pose is meant: nothing measured checks them.
    """

    owner: str
    what: str
    within: str
    keys: tuple[str, ...]
    given: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of these unknowns."""
        return tuple(f"{self.owner}.{key}" for key in self.keys)

    def pose(self, values: Mapping[str, float]) -> OutsidePose:
        """``T_within_what`` for values of the unknowns by name, SI."""
        if self.keys == PLACEMENT:
            return pose_named(values, self.owner)
        return None, point_named(values, self.owner)


def frames_of(
    owners: Mapping[str, set[str]], words: Mapping[str, tuple[str, str]]
) -> list[ExternalFrame]:
    """Those owners whose unknowns are a pose, or a point, and for which there are words.

    Args:
        owners: keys of the unknowns, by owner.
        words: what it is and in whose frame, by what stands before the owner's label in brackets.
    """
    frames = []
    for owner, keys in owners.items():
        for every_key in (PLACEMENT, POSITION):
            named = words.get(owner.partition("[")[0])
            if named is not None and set(every_key) <= keys:
                frames.append(ExternalFrame(owner, *named, every_key))
                break
    return frames


def labelled(owner: str, label: str) -> str:
    """An owner of unknowns, with the label that tells it from others where there are several."""
    return owner if label == "default" else f"{owner}[{label}]"


def pose_parameters(label: str) -> tuple[Parameter, ...]:
    """The six unknowns of an external frame, ``label.x … label.rz``."""
    turn = (Parameter(label, key, "rad", plausible=1.0) for key in ROTATION)
    return (*point_parameters(label), *turn)


def point_parameters(label: str) -> tuple[Parameter, ...]:
    """The three unknowns of a point, ``label.x|y|z``."""
    return tuple(Parameter(label, key, "m", plausible=PLAUSIBLE_POSITION) for key in POSITION)


def pose_values(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """Poses (..., 3, 3) and (..., 3) as the six numbers (..., 6) of `pose_parameters` each."""
    return np.concatenate([position, vector_from_rotation(rotation)], axis=-1)


def pose_named(values: Mapping[str, float], label: str) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and position (3,), m, of the unknowns ``label.x … label.rz``."""
    six = np.array([values[f"{label}.{key}"] for key in PLACEMENT])
    return rotation_from_vector(six[3:]), six[:3]


def point_named(values: Mapping[str, float], label: str) -> FloatArray:
    """Position (3,), m, of the unknowns ``label.x|y|z``."""
    return np.array([values[f"{label}.{key}"] for key in POSITION])
