"""Closed-form starts: of an instrument with targets anywhere on the link, and of anchors."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import arm_named, dh_parameters, perturbed, random_readings

from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Samples
from suta_calib.terms import ArmPoses, MeasuredRange
from suta_calib.terms.range import anchor_of
from suta_calib.terms.target_start import instrument_and_targets


@pytest.mark.parametrize("seed", range(6))
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
        (1e3, 10, "is it another unit"),
        (1e-3, 10, "is it another unit"),
        (1.0, 3, "anchor A ranged 3 times"),
    ],
)
def test_distances_that_tell_nothing_are_refused(factor: float, rows: int, message: str) -> None:
    arm = arm_named("suta")
    q = random_readings(arm, np.random.default_rng(2), rows)
    length = factor * np.linalg.norm(arm.forward(q)[1] - [0.2, 0.1, -0.5], axis=1)
    samples = Samples.from_arrays(
        arm.joints, q, labels={"anchor": ["A"] * rows}, lengths={"length": length}
    )
    with pytest.raises(SamplesError, match=message):
        MeasuredRange(ArmPoses(arm, samples)).check_enough()
