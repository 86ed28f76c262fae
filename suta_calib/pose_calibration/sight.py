"""Which eye saw which target in every row, and what people call them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib.arrays import BoolArray, IntArray
from suta_calib.errors import SamplesError
from suta_calib.pose_calibration.robot_noise import EYE, TARGET
from suta_calib.pose_calibration.undetermined import Role
from suta_calib.terms.block import grouped
from suta_calib.terms.external_frame import labelled
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND, EyeSetup
from suta_calib.terms.many_eyes_start import SeenTogether

# What the only eye, or the only target, is called where nothing names it.
ONLY: Final = "default"
# What X and Z are another by, where it is moved.
MAY_MOVE: Final[dict[EyeSetup, dict[str, str]]] = {
    EYE_IN_HAND: {
        EYE: "the camera on the hand (or the hand's tool frame)",
        TARGET: "the target (or the base)",
    },
    EYE_TO_HAND: {
        EYE: "the camera (or the base)",
        TARGET: "the target on the hand (or the hand's tool frame)",
    },
}


@dataclass(frozen=True, eq=False)
class Sight:
    """Which eye saw which target in every row.

    Attributes:
        together: by numbers.
        eyes, targets: their names.
    """

    together: SeenTogether
    eyes: tuple[str, ...]
    targets: tuple[str, ...]

    @classmethod
    def of_one(cls, count: int) -> Sight:
        """One eye and one target, which nothing names."""
        none = np.zeros(count, dtype=np.intp)
        return cls(SeenTogether(none, none, 1, 1), (ONLY,), (ONLY,))

    @classmethod
    def of(cls, count: int, eye: ArrayLike | None, target: ArrayLike | None) -> Sight:
        """By a label of every row; without labels there is one.

        Raises:
            SamplesError: another number of labels than rows, or an empty label.
        """
        groups = []
        for role, given in (("eye", eye), ("target", target)):
            labels = np.full(count, ONLY) if given is None else np.asarray(given).astype(np.str_)
            if labels.shape != (count,):
                expected = f"one for each of the {count} rows"
                raise SamplesError(f"labels of shape {labels.shape}", expected, where=role)
            for row in np.flatnonzero(labels == ""):
                raise SamplesError("an empty label", "a label", where=f"{role}[{row}]")
            groups.append(grouped(labels))
        (eyes, of_eye), (targets, of_target) = groups
        together = SeenTogether(of_eye, of_target, len(eyes), len(targets))
        return cls(together, tuple(eyes), tuple(targets))

    def of_rows(self, rows: IntArray) -> Sight:
        """What some of the rows look at, which others may do without."""
        eye, target = self.together.eye[rows], self.together.target[rows]
        return Sight.of(len(rows), np.array(self.eyes)[eye], np.array(self.targets)[target])

    @property
    def sides(self) -> tuple[tuple[Role, tuple[str, ...], IntArray], ...]:
        """Eyes, then targets: what they are, their names, and which of them every row looks at."""
        return ("eye", self.eyes, self.together.eye), ("target", self.targets, self.together.target)

    @property
    def one(self) -> bool:
        """Whether there are one eye and one target, which nothing names."""
        return self.eyes == self.targets == (ONLY,)

    @property
    def labels(self) -> Mapping[str, NDArray[np.str_]]:
        """Of every row, as the samples of a term have them; none where nothing is named."""
        if self.one:
            return {}
        return {
            "eye": np.array(self.eyes)[self.together.eye],
            "target": np.array(self.targets)[self.together.target],
        }

    def owners(self) -> tuple[list[str], list[str]]:
        """Of the unknowns of all eyes, and of all targets."""
        return [labelled(EYE, n) for n in self.eyes], [labelled(TARGET, n) for n in self.targets]

    def called(self, setup: EyeSetup) -> dict[str, str]:
        """Words for what an unknown belongs to, by its owner."""
        if self.one:
            return MAY_MOVE[setup]
        words: dict[str, str] = {}
        for (role, names, _), owners in zip(self.sides, self.owners(), strict=True):
            for name, owner in zip(names, owners, strict=True):
                alone = name == ONLY
                words[owner] = MAY_MOVE[setup][owner] if alone else f"{role} {name}"
        return words

    @property
    def seen_by(self) -> dict[str, IntArray]:
        """Rows that look at each, by its owner; none where all of them do."""
        if self.one:
            return {}
        return {
            owner: np.flatnonzero(which == k)
            for (_, _, which), owners in zip(self.sides, self.owners(), strict=True)
            for k, owner in enumerate(owners)
        }

    @property
    def parts(self) -> list[BoolArray]:
        """(n,) rows of each part of the graph of eyes and targets."""
        of_eyes, _ = self.together.parts
        part = of_eyes[self.together.eye]
        return [part == k for k in np.unique(part)]
