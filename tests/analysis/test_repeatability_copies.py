"""Rows that were written down again: each visit counts once, and it is said."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import arm_named
from visits import visits

from suta_calib.analysis.repeatability import Repeatability, repeatability
from suta_calib.analysis.repeatability.suspicions import first_written
from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.measurements import Samples


def run(q: FloatArray, **labels: list[str]) -> Repeatability:
    arm = arm_named("suta")
    return repeatability(arm, Samples.from_arrays(arm.joints, q, labels=labels))


@pytest.mark.parametrize("jitter", [0.0, 1e-7, 5e-7])
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("n", "times"), [(15, 2), (10, 3), (30, 2), (120, 2)])
def test_visits_that_are_appended_again_count_once(
    n: int, times: int, seed: int, jitter: float
) -> None:
    sound = visits(n, 3e-4, seed, tilt=5e-3)
    random = np.random.default_rng(seed)
    again = [sound.q + jitter * random.standard_normal(sound.q.shape) for _ in range(times - 1)]
    found, once = run(np.vstack([sound.q, *again])), run(sound.q)
    assert found.position.count == n
    assert found.copies == n * (times - 1)
    assert found.position.rms.interval() == once.position.rms.interval()
    assert found.assessment.level == "care"
    says = f"{n * (times - 1)} of {n * times} rows read what another does"
    assert any(says in note for note in found.assessment.notes)
    assert once.copies == 0


def test_a_copy_across_the_turn_and_among_others_is_found() -> None:
    q = visits(40, 3e-4, tilt=5e-3).q
    rows = [0, 1, 2, 3, 3, *range(4, 40), 7]
    again = q[rows]
    again[-1, 4] += 2 * np.pi
    found = run(again)
    assert found.copies == 2
    assert found.position.count == 40


def test_a_copy_under_another_label_is_no_visit_either() -> None:
    q = visits(30, 3e-4, tilt=5e-3).q
    with pytest.raises(SamplesError, match=r"2 visits with protocol 'b' \(20 rows"):
        run(np.vstack([q, q[:20], q[:2] + 1e-3]), protocol=["a"] * 30 + ["b"] * 22)


def test_rows_that_are_all_one_visit_are_refused() -> None:
    with pytest.raises(SamplesError, match=r"1 visits \(29 rows read what another does"):
        run(np.repeat(visits(1, 0.0).q, 30, axis=0))


@pytest.mark.parametrize("bits", [12, 14, 17, 22])
def test_encoders_are_given_no_copies(bits: int) -> None:
    """Where all are coarse, an arm reads the same when it comes back."""
    step = 2 * np.pi / 2**bits
    for seed in range(20):
        q = visits(60, 1e-4, seed).q
        found = run(step * np.round(q / step))
        assert found.copies == 0


def test_an_exact_robot_in_several_postures_is_given_no_copies() -> None:
    for n in (8, 15, 30, 120):
        for seed in range(40):
            random = np.random.default_rng(seed)
            posture = np.repeat(random.uniform(-2.0, 2.0, (5, 6)), -(-n // 5), axis=0)[:n]
            q = posture + 1e-5 * random.standard_normal((n, 6))
            step = 2 * np.pi / 2**22
            for readings in (q, step * np.round(q / step)):
                assert first_written(readings, ["rad"] * 6).all()


def test_what_is_left_is_told_by_its_own_rows() -> None:
    sound = visits(40, 3e-4, tilt=5e-3)
    found = repeatability(arm_named("suta"), sound.take([*range(20), *range(20), *range(20, 40)]))
    assert found.samples.origin == sound.origin
