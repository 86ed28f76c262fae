"""Scatter of the tip and the joints, pooled over points that were each touched a few times."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import arm_named, random_readings
from studies import of_size

from suta_calib.analysis.repeatability import RepeatedTouches, joints_rms, repeated_touches
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import wrap
from suta_calib.measurements import Samples

ARM = arm_named("suta")
SIGMA = np.array([1.0, 0.5, 2.0, 1.0, 0.2, 3.0]) * 1e-3


def touched(repeats: int = 3, points: int = 40, seed: int = 0, readings: int = 1) -> Samples:
    """Points that are touched again; joints scatter, each by as much as `SIGMA` says, rad."""
    rng = np.random.default_rng(seed)
    point = np.repeat(np.arange(points), repeats)
    q = random_readings(ARM, np.random.default_rng(9), points)[point]
    # Some points lie where angles begin anew.
    q[:, 0] = np.where(point % 2, np.pi, q[:, 0])
    q = wrap(q + SIGMA * rng.standard_normal(q.shape))
    labels = {"placement": [f"P{k % 4}" for k in point], "landmark": [f"L{k // 4}" for k in point]}
    rows = np.repeat(np.arange(len(q)), readings)
    return Samples.from_arrays(ARM.joints, q, labels=labels).take(rows)


@pytest.mark.parametrize("seeds", of_size(40, 100))
def test_intervals_hold_the_scatter_that_was_put_in(seeds: int) -> None:
    held = np.zeros(6)
    for seed in range(seeds):
        found = repeated_touches(ARM, touched(seed=seed))
        assert (found.touches, len(found.points)) == (120, 40)
        for k, each in enumerate(found.joints):
            held[k] += SIGMA[k] in each.std.interval(0.95)
            assert each.peak_to_peak <= each.largest
    # Of all, 95 %, within four standard deviations of a binomial; joints are independent.
    count = seeds * len(held)
    assert abs(held.sum() / count - 0.95) < 4 * np.sqrt(0.95 * 0.05 / count)


def test_peak_to_peak_is_of_a_point_and_says_which() -> None:
    samples = touched(repeats=2)
    q = samples.q.copy()
    q[12] = q[13] + [0, 0, 0.02, 0, 0, 0]
    found = repeated_touches(ARM, Samples.from_arrays(ARM.joints, q, labels=samples.labels))
    joint = found.joints[2]
    assert joint.largest == pytest.approx(0.02)
    assert joint.largest_at == "P2/L1"
    pairs = np.abs(wrap(np.diff(q.reshape(-1, 2, 6), axis=1)))[:, 0, 2]
    assert joint.peak_to_peak == pytest.approx(pairs.mean())


def test_the_tip_scatters_by_what_the_joints_make_of_it() -> None:
    samples = touched(repeats=4, points=60)
    found = repeated_touches(ARM, samples)
    _, position = ARM.forward(samples.q)
    visits = position.reshape(60, 4, 3)
    by_hand = np.sum((visits - visits.mean(axis=1, keepdims=True)) ** 2) / (60 * 3)
    assert found.rms.value == pytest.approx(np.sqrt(by_hand))
    overall = joints_rms(found.joints)
    assert overall == pytest.approx(np.sqrt(np.mean([j.std.value**2 for j in found.joints])))


def test_what_is_read_again_at_one_rest_counts_once() -> None:
    once, often = (repeated_touches(ARM, touched(readings=n)) for n in (1, 5))
    assert often.rms == once.rms
    assert often.touches == once.touches


def test_a_touch_that_slipped_is_named_and_the_others_told_without_it() -> None:
    samples = touched()
    q = samples.q.copy()
    q[7, 1] += 0.05
    found = repeated_touches(ARM, Samples.from_arrays(ARM.joints, q, labels=samples.labels))
    clean = repeated_touches(ARM, samples)
    assert found.elsewhere == ("row 7",)
    assert found.rms.value > 1.5 * clean.rms.value
    assert found.rms_of_others.value == pytest.approx(clean.rms.value, rel=0.1)
    (note,) = found.assessment.notes
    assert "row 7" in note
    assert f"{1e3 * found.rms_of_others.value:.3f} mm" in note
    assert clean.assessment.level == "good"


@pytest.mark.parametrize("repeats", [1, 3])
def test_too_few_points_are_refused(repeats: int) -> None:
    samples = touched(repeats, points=2)
    with pytest.raises(SamplesError, match="points touched more than once; expected at least 3"):
        repeated_touches(ARM, samples)


def test_points_that_were_touched_once_take_no_part() -> None:
    one, again = touched(repeats=1, points=4, seed=5), touched(points=10)
    other = {"placement": ["Q"] * 4, "landmark": list("abcd")}
    more = Samples.from_arrays(ARM.joints, one.q, labels=other)
    both = repeated_touches(ARM, Samples.concatenate([again, more]))
    alone: RepeatedTouches = repeated_touches(ARM, again)
    assert (both.rms, both.points) == (alone.rms, alone.points)
