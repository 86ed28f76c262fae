"""Which of two arms is better on held-out data: said only where chance does not explain it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies import first_of
from terms_cases import SIGMA, scene

from suta_calib.analysis.comparison import ArmComparison, compare_arms
from suta_calib.trust.accuracy import term_accuracies


@pytest.mark.parametrize(
    ("factor", "level", "said"),
    [
        (1 / 3, "good", ""),
        (1.0, "care", "do not show a difference"),
        (3.0, "care", "worse than the job's URDF"),
    ],
)
@pytest.mark.parametrize("seed", first_of(range(4)))
def test_better_and_worse_are_more_than_chance(
    factor: float, level: str, said: str, seed: int
) -> None:
    """Two arms whose errors are equally large: one is always a little worse, by chance."""
    s = scene("tracked_point")
    term = s.term(s.samples(SIGMA)[0])
    before, after = np.random.default_rng(seed).normal(scale=1e-4, size=(2, len(term.poses), 3))
    found = ArmComparison(term_accuracies([term], [before], [factor * after])).assessment
    assert found.level == level
    assert said in " ".join(found.notes)
    assert "RMS" in found.sentence


def test_what_the_estimates_are_unsure_of_counts_against_significance() -> None:
    s = scene("tracked_point")
    term = s.term(s.samples(SIGMA)[0])
    before, after = np.random.default_rng(0).normal(scale=1e-4, size=(2, len(term.poses), 3))
    terms = term_accuracies([term], [before], [0.5 * after])
    found, unsure = ArmComparison(terms), ArmComparison(terms, 1e-9, 2e-9)
    gain = found.gain
    assert gain.significance == pytest.approx(gain.mean / gain.std)
    assert unsure.gain.significance == pytest.approx(gain.mean / np.hypot(gain.std, 2e-9))
    assert f"({gain.significance:.1f} standard errors apart)" in found.assessment.sentence


def test_held_out_rows_at_fitted_postures_are_told_of() -> None:
    """Copies with other last digits too: an arm knows the errors that it was fitted to."""
    s = scene("tracked_point")
    samples = s.samples(SIGMA)[0]
    arm = s.term(samples).poses.arm
    fitted, other = np.arange(len(samples)) % 2 == 0, np.arange(len(samples)) % 4 == 1
    for jitter in (0.0, 1e-6):
        shaken = replace(samples, q=samples.q + jitter)
        own = compare_arms([s.term(samples.take(fitted))], [s.term(shaken.take(fitted))], arm)
        assert own.rows_in_fit == fitted.sum()
        assert (
            f"{own.rows_in_fit} of {own.rows_in_fit} validation rows have the same postures"
            in own.assessment.notes[-1]
        )
        apart = compare_arms([s.term(samples.take(fitted))], [s.term(shaken.take(other))], arm)
        assert apart.rows_in_fit == 0
        assert not any("have the same postures" in note for note in apart.assessment.notes)
