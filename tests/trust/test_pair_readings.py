"""Pairs of poses that are read wrongly are refused, and what makes them agree is named."""

from __future__ import annotations

import numpy as np
import pytest
from sound_sets import PAIRS, answer_on_poses

from suta_calib.errors import SamplesError
from suta_calib.trust import known_hypotheses
from suta_calib.trust.misreadings import Misreading, Pairs

EVERY = known_hypotheses().items()
MISREAD = {n: h for n, h in EVERY if isinstance(h, Misreading) and h.reads_pairs}


@pytest.mark.parametrize("hypothesis", MISREAD.values(), ids=MISREAD)
def test_its_own_fault_is_refused_and_named(hypothesis: Misreading) -> None:
    spoilt = hypothesis.spoil(PAIRS.make(1), PAIRS.values, np.random.default_rng(1)).data
    with pytest.raises(SamplesError) as refusal:
        answer_on_poses(spoilt)
    readings = hypothesis.of_pairs(Pairs.of(spoilt))
    descriptions = [description.format(other="eye-to-hand") for description, _ in readings]
    assert any(description in str(refusal.value) for description in descriptions)


def test_sound_pairs_are_read_as_they_are() -> None:
    assert all(answer_on_poses(PAIRS.make(seed)).assessment.usable for seed in range(4))
