"""Points of one set that are all farther apart than the same ones of the other: a scale."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from suta_calib.terms.tracked_point import TrackedPoint
from suta_calib.trust.evidence import Effect, Evidence
from suta_calib.trust.examination import Examination
from suta_calib.trust.hypothesis import AddedVariable, Spoilt


class ScaledPoints(AddedVariable):
    """``seen = (1 + s) placed`` about the middle of the placed points.

    `pose_calibration.registration` says from which size on it is worth a word.
    """

    name: ClassVar[str] = "scale between two sets"
    about: ClassVar[str] = "The points of one set are farther apart than those of the other."
    applies_to: ClassVar[tuple[type[TrackedPoint], ...]] = (TrackedPoint,)
    needs_arm: ClassVar[bool] = False
    worth: ClassVar[float] = 0.0

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One number: the scale less one."""
        placed = answer.position - answer.position.mean(axis=0)
        velocity = np.zeros((len(placed), 6, 1))
        velocity[:, :3, 0] = placed
        yield Effect("scale", answer.by_motion(velocity))

    def sentence(self, evidence: Evidence) -> str:
        """The factor and its standard deviation."""
        size, std = float(evidence.size[0]), float(evidence.std[0])
        return (
            f"The points of the second set are {1.0 + size:.5f} ± {std:.1g} times as far apart "
            "as those of the first: check the scale and the units of both."
        )

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> Spoilt:
        """A second set that is 1 % larger or smaller."""
        del values
        term: TrackedPoint = data
        samples, size = term.poses.samples, float(rng.choice([-0.01, 0.01]))
        assert samples.position is not None
        larger = replace(samples, position=(1.0 + size) * samples.position)
        return Spoilt(term.over_poses(term.poses.with_samples(larger)), np.array([size]))
