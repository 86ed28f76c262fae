"""Length measurement errors: distances between landmarks against their calibrated lengths."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.terms import Term


@dataclass(frozen=True, eq=False)
class LengthErrors:
    """Measured minus calibrated length of every pair of landmarks of one placement and repeat.

    Attributes:
        label: (n,) the pair, such as ``O-M1``.
        placement, repeat: (n,) labels.
        length: (n,) calibrated, m.
        error: (n,) measured minus calibrated, m.
        calibration_std: (n,) standard uncertainty of the calibrated length, m.
    """

    label: tuple[str, ...]
    placement: tuple[str, ...]
    repeat: tuple[str, ...]
    length: FloatArray
    error: FloatArray
    calibration_std: FloatArray

    @classmethod
    def of(cls, term: Term) -> LengthErrors:
        """Over the poses of distances between landmarks, the arm held as it is."""
        block = term.blocks[0]
        _, position = term.poses.at({})
        first, second = block.samples.T
        measured = np.linalg.norm(position[first] - position[second], axis=1)
        labels, length = term.poses.samples.labels, block.data[:, 0]
        return cls(
            block.labels,
            tuple(labels["placement"][first].tolist()),
            tuple(labels["repeat"][first].tolist()),
            length,
            measured - length,
            block.known_sigma,
        )

    @classmethod
    def joined(cls, parts: Sequence[LengthErrors]) -> LengthErrors:
        """Those of several artefacts, one after the other."""
        return cls(
            tuple(each for part in parts for each in part.label),
            tuple(each for part in parts for each in part.placement),
            tuple(each for part in parts for each in part.repeat),
            np.concatenate([part.length for part in parts]),
            np.concatenate([part.error for part in parts]),
            np.concatenate([part.calibration_std for part in parts]),
        )

    def __len__(self) -> int:
        return len(self.error)

    @property
    def repeat_range(self) -> float | None:
        """Largest range of a length's errors over the repeats of one placement, m."""
        groups: dict[tuple[str, str], list[float]] = {}
        pairs = zip(self.placement, self.label, self.error.tolist(), strict=True)
        for placement, label, error in pairs:
            names = "-".join(sorted(label.split("-")))
            groups.setdefault((placement, names), []).append(error)
        ranges = [max(errors) - min(errors) for errors in groups.values() if len(errors) > 1]
        return max(ranges, default=None)

    def by_placement(self) -> Iterator[tuple[str, IntArray]]:
        """Rows of each placement."""
        placement = np.array(self.placement)
        for name in dict.fromkeys(self.placement):
            yield name, np.flatnonzero(placement == name)
