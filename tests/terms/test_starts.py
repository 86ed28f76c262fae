"""Closed-form starts: of an instrument with targets anywhere on the link, and of anchors."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import arm_named, dh_parameters, perturbed, random_readings
from studies import first_of

from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import random_rotations, register_points, rotation_from_vector
from suta_calib.measurements import Artefact, Landmark, Samples
from suta_calib.terms import ArmPoses, MeasuredRange, TouchedLandmark
from suta_calib.terms.landmark import registered
from suta_calib.terms.range import anchor_of
from suta_calib.terms.target_start import instrument_and_targets


@pytest.mark.parametrize("seed", first_of(range(6)))
def test_targets_half_a_metre_off_are_found_with_the_nominal_arm(seed: int) -> None:
    """An arm centimetres off, two rows grossly wrong, and hardly any motion for every third."""
    arm, rng = arm_named("suta"), np.random.default_rng(seed)
    truth = perturbed(dh_parameters(arm), seed, 3e-3, 1e-2)
    q = random_readings(arm, rng, 25)
    q = q.mean(axis=0) + (0.3 if seed % 3 == 0 else 1.0) * (q - q.mean(axis=0))
    count = 1 + seed % 3
    target = np.arange(len(q)) % count
    sits = rng.uniform(-0.5, 0.5, (count, 3))
    turn, shift = rotation_from_vector(rng.uniform(-3, 3, 3)), rng.uniform(-3, 3, 3)
    R, p = arm.forward(q, truth)
    seen = (p + np.einsum("nij,nj->ni", R, sits[target])) @ turn.T + shift
    seen[:2] += 0.05
    found, _, targets = instrument_and_targets(arm.forward(q), seen, target)
    assert np.arccos((np.trace(found.T @ turn) - 1.0) / 2.0) < np.radians(4.0)
    assert np.abs(targets - sits).max() < 0.04


@pytest.mark.parametrize("known", [True, False])
def test_an_anchor_is_where_its_distances_meet(known: bool) -> None:
    rng, anchor = np.random.default_rng(0), np.array([0.3, -0.2, -0.4])
    away = rng.standard_normal((12, 3))
    lengths = rng.uniform(0.2, 0.6, 12) if known else np.full(12, 0.35)
    tips = anchor + lengths[:, None] * away / np.linalg.norm(away, axis=1)[:, None]
    found, mean = anchor_of(tips, lengths if known else None)
    np.testing.assert_allclose(found, anchor, atol=1e-9)
    assert mean == pytest.approx(lengths.mean())


def test_of_two_places_an_anchor_is_below_the_plane_of_the_tips() -> None:
    rng, anchor = np.random.default_rng(1), np.array([0.1, 0.2, -0.3])
    tips = np.column_stack([rng.uniform(-0.3, 0.3, (10, 2)), np.full(10, 0.1)])
    found, _ = anchor_of(tips, np.linalg.norm(tips - anchor, axis=1))
    np.testing.assert_allclose(found, anchor, atol=1e-6)


@pytest.mark.parametrize(
    ("factor", "rows", "message"),
    [
        (1e3, 10, "is the unit right"),
        (1e-3, 10, "is the unit right"),
        (1.0, 3, "anchor A ranged 3 times"),
    ],
)
def test_distances_that_tell_nothing_are_refused(factor: float, rows: int, message: str) -> None:
    arm = arm_named("suta")
    q = random_readings(arm, np.random.default_rng(2), rows)
    length = factor * np.linalg.norm(arm.forward(q)[1] - [0.2, 0.1, -0.5], axis=1)
    samples = Samples.from_arrays(
        arm.joints, q, labels={"anchor": ["A"] * rows}, numbers={"length": length}
    )
    with pytest.raises(SamplesError, match=message):
        MeasuredRange(ArmPoses(arm, samples)).check_enough()


def test_groups_are_registered_together_as_each_alone() -> None:
    rng = np.random.default_rng(0)
    group = rng.permutation(np.repeat(np.arange(40), rng.integers(3, 9, 40)))
    source = rng.normal(size=(len(group), 3))
    turns, shifts = random_rotations(rng, 40), rng.normal(size=(40, 3))
    target = np.einsum("nij,nj->ni", turns[group], source) + shifts[group]
    target += rng.normal(0.0, 0.2, target.shape)
    R, p = registered(source, target, group, 40)
    for k in range(40):
        alone = register_points(source[group == k], target[group == k])
        np.testing.assert_allclose(R[k], alone[0], atol=1e-12)
        np.testing.assert_allclose(p[k], alone[1], atol=1e-12)


def test_a_placement_of_one_landmark_is_refused_by_name() -> None:
    arm = arm_named("suta")
    q = random_readings(arm, np.random.default_rng(0), 5)
    labels = {"placement": [*"PPQQP"], "repeat": [*"11111"], "landmark": [*"ABBBA"]}
    poses = ArmPoses(arm, Samples.from_arrays(arm.joints, q, labels=labels))
    marks = {name: Landmark(name, np.array([0.1 * k, 0.0, 0.0])) for k, name in enumerate("AB")}
    term = TouchedLandmark(poses, Artefact("plate", marks))
    with pytest.raises(SamplesError, match="only landmark B at placement Q"):
        term.check_enough()
