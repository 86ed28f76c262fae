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
    thinned = term.over_poses(term.poses)
    (note,) = thinned.notes
    assert f"up to {every} pairs" in note
    assert f"{len(thinned.blocks[0])} of them" in note
    assert len(thinned.blocks[0]) <= every // 2


def test_displaced_touches_change_the_distances_between_them_to_first_order() -> None:
    (term,) = problem_of("pairwise_distance", SIGMA).terms
    displacement = 1e-6 * np.random.default_rng(0).standard_normal((3, len(term.poses), 3))
    pairs = term.blocks[0].samples
    first, second = np.moveaxis(
        term.artefact.position_of(term.poses.samples.labels["landmark"])[pairs], 1, 0
    )
    moved = (first - second) + displacement[:, pairs[:, 0]] - displacement[:, pairs[:, 1]]
    longer = np.linalg.norm(moved, axis=2) - np.linalg.norm(first - second, axis=1)
    found = term.errors_of_touches(displacement, pairs)
    assert found.shape == (3, len(pairs), 1)
    np.testing.assert_allclose(found[..., 0], longer, rtol=0, atol=1e-9)
