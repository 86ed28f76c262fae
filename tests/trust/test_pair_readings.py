"""Pairs of poses that are read wrongly are refused, and what makes them agree is named."""

from __future__ import annotations

import numpy as np
import pytest
from sound_sets import PAIRS, answer_on_poses

from suta_calib.errors import SamplesError
from suta_calib.trust import known_hypotheses
from suta_calib.trust.pair_readings import MisreadPairs, Pairs

MISREAD = {n: h for n, h in known_hypotheses().items() if isinstance(h, MisreadPairs)}


@pytest.mark.parametrize("hypothesis", MISREAD.values(), ids=MISREAD)
def test_its_own_fault_is_refused_and_named(hypothesis: MisreadPairs) -> None:
    spoilt = hypothesis.spoil(PAIRS.make(1), PAIRS.values, np.random.default_rng(1)).data
    with pytest.raises(SamplesError) as refusal:
        answer_on_poses(spoilt)
    samples = spoilt.poses.samples
    readings = hypothesis.readings(Pairs(spoilt.poses.at({}), (samples.rotation, samples.position)))
    descriptions = [description.format(other="eye-to-hand") for description, _ in readings]
    assert any(description in str(refusal.value) for description in descriptions)


def test_sound_pairs_are_read_as_they_are() -> None:
    assert all(answer_on_poses(PAIRS.make(seed)).assessment.usable for seed in range(4))
