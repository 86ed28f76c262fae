"""Touches of one placement pair off with one another: too many pairs are thinned."""

from __future__ import annotations

import numpy as np
import pytest
from terms_cases import SIGMA, problem_of

from suta_calib.measurements import Samples
from suta_calib.terms import pairwise_distance
from suta_calib.terms.pairwise_distance import landmark_pairs


def touches(*landmarks: str) -> Samples:
    """Touches of these landmarks in one placement."""
    n = len(landmarks)
    labels = {"placement": ["P1"] * n, "repeat": ["1"] * n, "landmark": list(landmarks)}
    return Samples.from_arrays(["q"], np.arange(n)[:, None], labels=labels)


def test_each_touch_keeps_some_partners_of_other_landmarks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pairwise_distance, "MOST_PAIRS", 2000)
    samples = touches(*(["A"] * 300 + ["B"] * 95 + ["C"] * 5))
    pairs = landmark_pairs(samples)
    assert 1000 < len(pairs) <= 2000
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    names = samples.labels["landmark"]
    assert (names[pairs[:, 0]] != names[pairs[:, 1]]).all()
    assert np.bincount(pairs.reshape(-1), minlength=400).min() >= 2
    np.testing.assert_array_equal(pairs, landmark_pairs(samples))
    assert not len(landmark_pairs(touches(*["A"] * 400)))


def test_a_few_pairs_are_all_looked_at_and_many_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    (term,) = problem_of("pairwise_distance", SIGMA).terms
    assert not term.notes
    every = len(term.blocks[0])
    monkeypatch.setattr(pairwise_distance, "MOST_PAIRS", every // 2)
    thinned = term.take(np.arange(len(term.poses)))
    (note,) = thinned.notes
    assert f"up to {every} pairs" in note
    assert f"{len(thinned.blocks[0])} of them" in note
    assert len(thinned.blocks[0]) <= every // 2
