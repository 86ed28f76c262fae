"""A hypothesis: the inclinometer reads too much, or too little, by one factor."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from suta_calib import Term
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData
from suta_calib_tilt.inclinometer import Inclinometer

STEP = 1e-6


class InclinometerGain(AddedVariable):
    """Roll and pitch are both larger by one factor than they were read."""

    name: ClassVar[str] = "inclinometer gain"
    about: ClassVar[str] = "An inclinometer reads too much or too little by one factor."
    applies_to: ClassVar[tuple[type[Term], ...]] = (Inclinometer,)
    # A gain may drift after a calibration: `check` calls it "inclinometer gain".
    checked_as: ClassVar[str] = "inclinometer"

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One factor for all inclinometers."""
        larger = [_scaled(term, 1.0 + STEP) for term in answer.problem.terms]
        yield Effect("gain", answer.by_terms(larger, STEP), np.array([0.01]))

    def sentence(self, evidence: Evidence) -> str:
        """By how much."""
        gain, std = 100 * evidence.size[0], 100 * evidence.std[0]
        return (
            f"The inclinometer seems to read {gain:.3f} ± {std:.3f} % too little. Check its "
            "sensitivity against a sine bar."
        )

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """Readings that are 1 % too small."""
        return SpoiltData(_scaled(data, 1.0 / 1.01), np.array([0.01]))


def _scaled(term: Term, factor: float) -> Term:
    if not isinstance(term, Inclinometer):
        return term
    samples = term.poses.samples
    numbers = {name: factor * value for name, value in samples.numbers.items()}
    return term.over_poses(term.poses.with_samples(replace(samples, numbers=numbers)))
