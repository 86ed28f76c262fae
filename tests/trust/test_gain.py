"""Better or worse than nominal: by more than chance, and than the estimates are unsure of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from simulated import (
    Scene,
    Spread,
    arm_named,
    dh_parameters,
    hand_eye_scene,
    perturbed,
    read_again,
    tracked_scene,
)

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment
from suta_calib.model.parameters import Selection
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.trust.accuracy import Gain
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination

NOISE = Spread(position=1e-4, rotation=1e-3)
Seen = Callable[[FloatArray], FloatArray]


def judged(
    scene: Scene, fitted: int, seed: int, noise: Spread = NOISE, spoilt: float = 0.0, again: int = 1
) -> tuple[Gain, Assessment]:
    """The first samples of a scene fitted, the others held out."""
    samples = scene.samples(noise, seed)[0]
    observed, held_out = samples.take(slice(fitted)), samples.take(slice(fitted, None))
    if spoilt:  # what was fitted was seen through an instrument whose scale is off
        assert observed.position is not None
        middle = observed.position.mean(axis=0)
        position = middle + (1.0 + spoilt) * (observed.position - middle)
        observed = replace(observed, position=position)
    if again > 1:
        held_out = read_again(held_out, again, seed)
    solution = solve(Problem([scene.term(observed)], dh_parameters(scene.arm)))
    examined = CalibrationExamination.of(solution, [scene.term(held_out)])
    assert examined.accuracy.gain is not None
    return examined.accuracy.gain, assess_calibration(examined)


def drawn() -> dict[str, float]:
    return {p.name: p.nominal for p in dh_parameters(arm_named("suta")).values()}


def moved() -> dict[str, float]:
    return perturbed(dh_parameters(arm_named("suta")), seed=5, length=1e-3, angle=5e-3)


@pytest.mark.parametrize(("make", "rows"), [(tracked_scene, 55), (hand_eye_scene, 60)])
def test_an_arm_that_is_right_is_not_called_worse_for_honest_noise(
    make: Callable[..., Scene], rows: int
) -> None:
    found = [judged(make(arm_named("suta"), drawn(), rows), 40, seed) for seed in range(4)]
    assert sum(gain.after > gain.before for gain, _ in found) >= 2
    for gain, assessment in found:
        assert not gain.worse
        assert not gain.better
        assert assessment.usable
        assert "is not clearly better than" in " ".join(assessment.notes)


def test_nor_where_so_many_rows_are_held_out_that_each_micrometre_shows() -> None:
    """What they show is what the estimates are unsure of."""
    scene = tracked_scene(arm_named("suta"), drawn(), 440)
    found = [judged(scene, 40, seed) for seed in range(4)]
    for gain, assessment in found:
        assert -gain.mean > 3 * gain.std
        assert not gain.worse
        assert assessment.usable
    # Each draw is a sum of a dozen squares, a half of which it scatters by.
    share = np.mean([-gain.mean / gain.unsure for gain, _ in found])
    assert 0.5 < share < 1.5


def test_nor_without_any_error_and_noise() -> None:
    gain, assessment = judged(tracked_scene(arm_named("suta"), drawn(), 55), 40, 0, Spread())
    assert not gain.worse
    assert not gain.better
    assert assessment.usable


def test_an_arm_that_was_wrong_is_better() -> None:
    gain, assessment = judged(tracked_scene(arm_named("suta"), moved(), 55), 40, seed=0)
    assert gain.better
    assert not gain.worse
    assert "not clearly better" not in " ".join(assessment.notes)


def test_an_arm_that_was_right_and_is_spoilt_is_worse() -> None:
    scene = tracked_scene(arm_named("suta"), drawn(), 55)
    gain, assessment = judged(scene, 40, seed=0, spoilt=0.003)
    assert gain.worse
    assert not assessment.usable
    assert any("worse than the nominal arm" in note for note in assessment.notes)


def test_rows_read_at_one_rest_say_once_which_arm_is_better() -> None:
    scene = tracked_scene(arm_named("suta"), drawn(), 55)
    once, often = (judged(scene, 40, seed=0, again=times)[0] for times in (1, 20))
    assert (once.clusters, often.clusters) == (15, 15)
    assert often.mean == pytest.approx(once.mean, rel=0.01)
    assert often.std == pytest.approx(once.std, rel=0.01)


@pytest.mark.parametrize(("rows", "enough"), [(5, False), (40, True)])
def test_priors_are_no_equations(rows: int, enough: bool) -> None:
    """Five rows, which priors let a fit follow, tell nothing of the noise."""
    arm = arm_named("suta")
    twist, turn = np.radians([0.2, 0.75])
    bent = Selection(("geometric",), prior_m=1e-3, prior_rad=float(twist))
    unknown = arm.select(bent, Selection(("joint_*.offset",), prior_rad=float(turn)))
    scene = tracked_scene(arm, perturbed(unknown, seed=3, length=1e-3, angle=float(turn)), 80)
    samples = scene.samples(NOISE)[0]
    fitted, held_out = (scene.term(samples.take(r)) for r in (slice(rows), slice(50, None)))
    examined = CalibrationExamination.of(solve(Problem([fitted], unknown)), [held_out])
    accuracy = examined.accuracy
    far = accuracy.validation[0].after.rms > 10 * accuracy.calibration[0].after.rms
    assert far != enough
    notes = assess_calibration(examined).notes
    assert any("equations for" in note for note in notes) != enough


def test_a_single_cluster_tells_nothing() -> None:
    one = Gain(before=1e-4, after=1.4e-4, mean=-1e-8, std=0.0, clusters=1)
    assert not one.worse
    assert not Gain(before=1e-3, after=1e-4, mean=1e-6, std=0.0, clusters=1).better


def test_one_row_that_is_far_off_does_not_hide_which_arm_is_better() -> None:
    """15 lengths: 0.06 mm with one arm, 0.4 mm with the other, and 3.3 mm at one posture."""
    small = np.full(15, 6e-5)
    large = np.append(np.full(14, 4e-4), 3.3e-3)
    for before, after in ((large, small), (small, large)):
        difference = before**2 - after**2
        rms = (float(np.sqrt(np.mean(each**2))) for each in (before, after))
        std = float(difference.std(ddof=1) / np.sqrt(15))
        gain = Gain(*rms, float(difference.mean()), std, clusters=15)
        assert abs(gain.mean) < 2 * gain.std
        assert gain.better == (after is small)
        assert gain.worse == (after is large)


def test_how_often_chance_says_better_or_worse() -> None:
    """Two arms that are equally good: one in a hundred each way."""
    rng, found = np.random.default_rng(0), []
    for _ in range(4000):
        values = rng.standard_normal(12)
        mean, std = float(values.mean()), float(values.std(ddof=1) / np.sqrt(12))
        after = float(np.sqrt(16.0 - mean))
        gain = Gain(4.0, after, mean, std, clusters=12)
        found.append((gain.better, gain.worse))
    better, worse = np.mean(found, axis=0)
    # Binomial: 0.16 % off.
    assert better == pytest.approx(0.01, abs=0.005)
    assert worse == pytest.approx(0.01, abs=0.005)
