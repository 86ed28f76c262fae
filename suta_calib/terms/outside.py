"""What stands outside the arm and is found with it: cameras, instruments, artefacts, points.

A term's own unknowns are numbers; most of them make up a pose or a point that somebody came for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.model.parameters import PLACEMENT, POSITION

# Rotation (3, 3), None for what has no orientation, and position (3,), m.
OutsidePose = tuple[FloatArray | None, FloatArray]


@dataclass(frozen=True)
class OutsideFrame:
    """A frame, or a point, that some unknowns of a term are the pose of.

    Attributes:
        owner: of the unknowns, e.g. ``placement[P1]``.
        what: in a word: ``artefact``.
        within: in whose frame its pose is: ``base``.
        keys: of the unknowns that the pose depends on.
    """

    owner: str
    what: str
    within: str
    keys: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Of these unknowns."""
        return tuple(f"{self.owner}.{key}" for key in self.keys)

    def pose(self, values: Mapping[str, float]) -> OutsidePose:
        """``T_within_what`` for values of the unknowns by name, SI."""
        numbers = np.array([values[name] for name in self.names])
        turned = self.keys == PLACEMENT
        return rotation_from_vector(numbers[3:]) if turned else None, numbers[:3]


def frames_of(
    owners: Mapping[str, set[str]], words: Mapping[str, tuple[str, str]]
) -> list[OutsideFrame]:
    """Those owners whose unknowns are a pose, or a point, and for which there are words.

    Args:
        owners: keys of the unknowns, by owner.
        words: what it is and in whose frame, by what stands before the owner's label in brackets.
    """
    found = []
    for owner, keys in owners.items():
        for whole in (PLACEMENT, POSITION):
            named = words.get(owner.partition("[")[0])
            if named is not None and set(whole) <= keys:
                found.append(OutsideFrame(owner, *named, whole))
                break
    return found
