"""Joints that remember where they came from, ripple of gears, and cables, against known truth.

On random trees `test_trees` holds what they do, and its derivatives, against Pinocchio.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import arm_named, tracked_scene

from suta_calib.arrays import FloatArray
from suta_calib.geometry.travel import TURNS, travel_of
from suta_calib.measurements import SampleColumns, read_samples, write_samples
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import Noise, Term
from suta_calib.terms.poses import joint_ranges
from suta_calib.tracking.tracker import NO_TOOL, TipKinematics, followed
from suta_calib.tracking.uncertainty import CalibrationUncertainty
from suta_calib.trust.cross_validation import folds_of
from suta_calib.trust.explanation import Explanation, explain

ARM = arm_named("suta")
LAGS = {"joint_3.backlash": 8e-3, "joint_5.hysteresis": 0.02, "joint_5.hysteresis_decay": 0.08}


def motion(n: int = 400, seed: int = 0, joints: int = 6) -> tuple[FloatArray, FloatArray]:
    """Readings (n, joints) of joints that swing slowly, each in its own time; times (n,), s."""
    rng, time = np.random.default_rng(seed), 0.1 * np.arange(n)
    turns = 2 * np.pi * rng.uniform(0.04, 0.12, joints) * time[:, None]
    swing = np.sin(turns + rng.uniform(0, 6, joints)) + 0.3 * np.sin(2.7 * turns)
    return np.array(rng.uniform(0.3, 0.6, joints) * swing), np.array(time)


def recorded(truth: dict[str, float], seed: int = 0, n: int = 400) -> Term:
    """A tip seen to 0.1 mm while the arm moves."""
    q, time = motion(n, seed)
    scene = tracked_scene(ARM, {}, n)
    samples = replace(scene.exact().poses.samples, q=q, time=time, travel=travel_of(q, time))
    position = ARM.forward(q, truth, samples.conditions)[1]
    noise = np.random.default_rng(seed).normal(0, 1e-4, position.shape)
    seen = replace(samples, position=position + noise)
    return scene.term(seen, Noise(1e-4))


def play(readings: FloatArray, width: float) -> FloatArray:
    """What a joint with play does: it follows only once the gap is crossed."""
    now, found = readings[0], []
    for reading in readings:
        now = min(max(now, reading - width / 2), reading + width / 2)
        found.append(now)
    return np.array(found)


@pytest.mark.parametrize("width", [1e-3, 0.05, 0.3, 2.0])
def test_travel_is_all_that_play_remembers(width: float) -> None:
    """Against the operator itself, of a joint that swings in ever other ways."""
    q, time = motion(800, 3, joints=2)
    travel = travel_of(q, time)
    for k, readings in enumerate(q.T):
        own = travel[:, k]
        limit = width * np.array([0.5] + [1.0] * (TURNS - 1))
        lag = np.sum(np.sign(own) * np.minimum(np.abs(own), limit), axis=1)
        wrong = np.abs(readings - lag - play(readings, width))
        # Motion below the encoder's flicker is none, and only so many travel are kept.
        assert np.quantile(wrong, 0.98) < 1e-3
        assert wrong.max() < 0.04


def test_a_loop_that_is_closed_is_forgotten() -> None:
    q = np.array([0.0, 1.0, 0.5, 0.8, 0.4, 0.9, 1.2, 0.0, -2.0])[:, None]
    travel = travel_of(q, np.arange(9.0))[:, 0]
    expected: list[list[float]] = [
        [0, 0, 0], [1, 0, 0], [1, -0.5, 0], [1, -0.5, 0.3], [1, -0.6, 0], [1, -0.6, 0.5],
        [1.2, 0, 0], [1.2, -1.2, 0], [-2, 0, 0],
    ]  # fmt: skip
    np.testing.assert_allclose(travel[:, :3], expected, atol=0.02)


def test_each_recording_begins_anew() -> None:
    q, time = motion(60)
    twice = travel_of(np.vstack([q, q]), np.concatenate([time, time]))
    np.testing.assert_array_equal(twice[:60], twice[60:])
    assert not twice[60].any()


def test_an_encoder_that_flickers_turns_no_joint() -> None:
    q = 0.3 + np.random.default_rng(0).normal(0, 1e-5, (200, 1))
    assert np.abs(travel_of(q, np.arange(200.0))).max() < 5e-5


def test_times_are_read_back_and_each_file_is_a_recording(tmp_path: Path) -> None:
    samples = recorded(LAGS, n=40).poses.samples
    for name in ("a.csv", "b.csv"):
        write_samples(tmp_path / name, samples)
    columns, ranges = SampleColumns(position=True), joint_ranges(ARM)
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    again = read_samples(files, ranges, columns)
    assert again.time is not None
    assert again.travel is not None
    assert samples.travel is not None
    np.testing.assert_array_equal(again.time[40:], samples.time)
    np.testing.assert_allclose(again.travel[40:], samples.travel, atol=1e-9)
    # A row keeps its past, whatever rows are left.
    np.testing.assert_array_equal(again.take([50, 7]).travel, again.travel[[50, 7]])
    text = (tmp_path / "b.csv").read_text()
    (tmp_path / "b.csv").write_text(text.replace("time", "clock"))
    assert read_samples(files, ranges, columns).travel is None


def test_play_and_hysteresis_of_a_recording_err_as_they_say() -> None:
    """Over eight sets of noise, in units of the standard deviations (chi-squared, 24, 0.1 %)."""
    unknown = ARM.select("joint_*.offset", "joint_3.backlash", "joint_5.hysteresis*")
    pulls = []
    for seed in range(8):
        solution = solve(Problem([recorded(LAGS, seed)], unknown), SolverOptions(starts=1))
        for name, value in LAGS.items():
            estimate = solution.estimates[name]
            assert estimate.state == "identified"
            pulls.append((estimate.value - value) / (estimate.std or 0.0))
    assert 7.4 < np.sum(np.square(pulls)) < 51.2


def test_a_joint_that_slides_lags_too() -> None:
    arm = arm_named("tiago")
    slides = arm.joints[0]
    assert arm.units[slides] == "m"
    unknown = arm.select(f"{slides}.backlash", f"{slides}.hysteresis*")
    assert [p.unit for p in unknown.values()] == ["m", "m", "m"]
    q, time = motion(50, joints=len(arm.joints))
    q[:, 0] = 0.1 + 0.05 * q[:, 0]
    travel = {"travel": travel_of(q, time).reshape(50, -1)}
    shift = arm.forward(q, {f"{slides}.backlash": 1e-3}, travel)[1] - arm.forward(q)[1]
    assert np.abs(np.linalg.norm(shift, axis=1)).max() == pytest.approx(5e-4, rel=0.01)


RIPPLE = {"joint_2.ripple_c": 1e-3, "joint_2.ripple_s": -5e-4, "joint_4.cable_s[joint_3]": 4e-3}


def test_ripple_and_cables_err_as_they_say() -> None:
    """Over eight sets of noise, in units of the standard deviations (chi-squared, 24, 0.1 %)."""
    arm = ARM.at({"joint_2.gear_ratio": 50.0})
    unknown = arm.select("joint_*.offset", *RIPPLE)
    pulls = []
    for seed in range(8):
        scene = tracked_scene(arm, RIPPLE, 80)
        noise = np.random.default_rng(seed).normal(0, 1e-4, scene.position.shape)
        seen = replace(scene.exact().poses.samples, position=scene.position + noise)
        solution = solve(Problem([scene.term(seen, Noise(1e-4))], unknown), SolverOptions(starts=1))
        for name, value in RIPPLE.items():
            estimate = solution.estimates[name]
            assert estimate.state == "identified"
            pulls.append((estimate.value - value) / (estimate.std or 0.0))
    assert 7.4 < np.sum(np.square(pulls)) < 51.2


def held(term: Term, *names: str) -> dict[str, Explanation]:
    """What is said of parameters that these samples do not tell."""
    arm = term.poses.arm  # type: ignore[attr-defined]
    problem = Problem([term], arm.select("joint_*.offset", *names))
    solution = solve(problem, SolverOptions(starts=1))
    return {e.fixed: e for e in explain(problem, solution.x, solution.identification)}


def test_ripple_of_a_gear_that_nobody_states_is_explained() -> None:
    term = tracked_scene(ARM, {}, 60).exact(Noise(1e-4))
    told = held(term, "joint_2.ripple_c")["joint_2.ripple_c"]
    assert "the ratio of the joint's gear is not stated" in told.sentence
    assert "gear_ratios: {joint_2: 100}" in told.remedy


def test_ripple_that_readings_alias_is_explained() -> None:
    """At every tenth of a turn the ripple of a gear of 50 is the same: it is an offset."""
    scene = tracked_scene(ARM.at({"joint_2.gear_ratio": 50.0}), {}, 60)
    scene.q[:, 1] = np.radians(36.0) * np.random.default_rng(0).integers(-3, 4, 60)
    scene.position[:] = ARM.forward(scene.q)[1]
    told = held(scene.exact(Noise(1e-4)), "joint_2.ripple_c")["joint_2.ripple_c"]
    assert "has the same effect as joint_2.offset" in told.sentence
    assert "no multiple of a ripple apart" in told.remedy


def test_hysteresis_without_a_recording_is_explained() -> None:
    term = tracked_scene(ARM, {}, 60).exact(Noise(1e-4))
    told = held(term, "joint_3.hysteresis")["joint_3.hysteresis"]
    assert "how the joint moved" in told.sentence
    assert "with the column time" in told.remedy


def test_hysteresis_of_a_joint_that_never_turns_back_is_explained() -> None:
    term = recorded({}, n=80)
    samples = term.poses.samples
    q = samples.q.copy()
    q[:, 2] = np.linspace(-0.5, 0.5, 80)
    # It has moved before the recording begins to tell.
    travel = travel_of(np.vstack([q[:1] - 0.5, q]), np.arange(81.0))[1:]
    assert np.isclose(travel[:, 2, 1:], 0.0).all()
    position = ARM.forward(q)[1]
    seen = replace(samples, q=q, travel=travel, position=position)
    told = held(term.over_poses(term.poses.with_samples(seen)), "joint_3.backlash")
    assert "joint_3 hardly turns back in these recordings" in told["joint_3.backlash"].sentence
    assert "turn back several times" in told["joint_3.backlash"].remedy


def test_a_recording_is_left_out_in_stretches() -> None:
    folds = folds_of([recorded({}, n=100)])
    assert len(folds) == 10
    for k, fold in enumerate(folds):
        np.testing.assert_array_equal(np.flatnonzero(fold.samples[0]), np.arange(10) + 10 * k)


def test_a_joint_is_followed_as_it_is_tracked() -> None:
    q, time = motion(150)
    names = tuple(LAGS)
    known = CalibrationUncertainty(
        Path("result.json"), names, np.eye(3) * 1e-12, {**LAGS}, "covariance", (), {**LAGS}
    )
    tip = TipKinematics(ARM, NO_TOOL, known)
    expected = ARM.forward(q, LAGS, {"travel": travel_of(q, time).reshape(150, -1)})[1]
    found = np.array([tip(row)[1] for row in q])
    # A recording's own noise is not known beforehand.
    assert np.linalg.norm(found - expected, axis=1).max() < 1e-4
    assert np.linalg.norm(found - ARM.forward(q)[1], axis=1).max() > 2e-3
    assert "joint_3, joint_5: the joint lags" in followed(ARM.offered, LAGS)
    assert followed(ARM.offered, {"joint_3.backlash": 0.0}) == ""
