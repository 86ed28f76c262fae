"""Causes are sought in part of many rows, and found there; all else is in proportion to them."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from judging import assessed
from simulated import Scene, Spread, arm_named, camera_scene, perturbed, tracked_scene

from suta_calib import CalibrationJob, Noise, Problem, Samples, Selection, SolverOptions, solve
from suta_calib.measurements import Camera
from suta_calib.solver.solution import Solution
from suta_calib.terms import ArmPoses, TrackedPoint
from suta_calib.trust import subsampled as thinning
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.contradicted_priors import contradicted_beliefs
from suta_calib.trust.subsampled import thinned

NOISE = Spread(position=1e-4)
ARM = arm_named("suta")
DISTANCES = Path(__file__).parents[2] / "data" / "suta" / "calibration.yaml"
UNKNOWN = ARM.select(Selection(("*.offset",), bound_rad=0.26))
TRUTH = perturbed(UNKNOWN, 3, angle=5e-3)


def scene(rows: int) -> Scene:
    return tracked_scene(ARM, TRUTH, rows)


def solved(samples: Samples) -> Solution:
    term = TrackedPoint(ArmPoses(ARM, samples), Noise(None, 1e-3))
    return solve(Problem([term], UNKNOWN), SolverOptions())


def test_few_rows_are_all_looked_at() -> None:
    solution = solved(scene(200).samples(NOISE)[0])
    assert thinned(solution) is solution


def test_of_many_rows_some_are_in_order_with_all_unknowns(monkeypatch: pytest.MonkeyPatch) -> None:
    """A target that was seen twice at the end stays an unknown."""
    samples = scene(1000).samples(NOISE)[0]
    labels = {"target": np.array(["A"] * 998 + ["B"] * 2)}
    solution = solved(replace(samples, labels=labels))
    monkeypatch.setattr(thinning, "MOST_SAMPLES", 300)
    fewer = thinned(solution)
    assert fewer.problem.names == solution.problem.names
    kept = fewer.problem.terms[0].poses.samples
    assert 250 <= len(kept) <= 302
    assert set(kept.labels["target"]) == {"A", "B"}
    lines = [int(origin.split()[-1]) for origin in kept.origin]
    assert lines == sorted(lines)
    assert fewer.values == solution.values


def test_of_many_distances_those_of_whole_placements_are_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job = CalibrationJob.load(DISTANCES)
    solution = solve(Problem(job.observations, job.parameters), SolverOptions())
    monkeypatch.setattr(thinning, "MOST_SAMPLES", 100)
    fewer = thinned(solution)
    (before,), (after,) = solution.problem.terms, fewer.problem.terms
    places = [term.poses.samples.labels["placement"] for term in (before, after)]
    kept = np.isin(places[0], places[1])
    assert len(before.poses) > 200
    assert 60 <= len(after.poses) <= 150
    np.testing.assert_array_equal(after.poses.samples.q, before.poses.samples.q[kept])
    both_kept = kept[before.blocks[0].samples].all(axis=1)
    assert len(after.blocks[0]) == both_kept.sum() > 300
    assert fewer.values == solution.values


def test_what_changed_is_found_in_part_of_the_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    samples = scene(1200).samples(NOISE)[0]
    q = samples.q.copy()
    q[600:, 2] += math.radians(0.2)
    solution = solved(replace(samples, q=q))
    monkeypatch.setattr(thinning, "MOST_SAMPLES", 400)
    (whole,), (part,) = (
        CalibrationExamination.of(solution).changes,
        CalibrationExamination.of(thinned(solution)).changes,
    )
    assert (part.kind, part.joint) == (whole.kind, whole.joint) == ("slip", ARM.joints[2])
    assert part.size == pytest.approx(whole.size, rel=0.1)


def test_memory_of_a_calibration_grows_with_the_rows_and_no_faster(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(thinning, "MOST_SAMPLES", 500)
    peaks = []
    for rows in (3_000, 6_000):
        samples = scene(rows).samples(NOISE)[0]
        tracemalloc.start()
        assert assessed(solved(samples)).usable
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2.3 * peaks[0]


def test_of_many_corners_some_are_looked_at_in_every_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They are the same of the board in all, and what they contradict, they still do."""
    arm = arm_named("ur5")
    unknown = arm.select(Selection(("*.offset",), bound_rad=0.1))
    truth = perturbed(unknown, 1, angle=5e-3)
    view = camera_scene(arm, truth, 20)
    wrong = view.settings["camera"].intrinsics + 40.0 * np.eye(9)[2]
    view = replace(view, settings={**view.settings, "camera": Camera(1280, 960, wrong)})
    solution = solve(Problem([view.exact()], unknown), SolverOptions())
    monkeypatch.setattr(thinning, "ENOUGH_CORNERS", 4)
    monkeypatch.setattr(thinning, "MOST_SAMPLES", 160)
    fewer = thinned(solution)
    before, after = (s.problem.terms[0].poses.samples.pixels for s in (solution, fewer))
    kept = np.isfinite(after).all(axis=2)
    assert (kept == kept[0]).all()
    assert kept[0].sum() == 160 // 20
    np.testing.assert_array_equal(after[kept], before[kept])
    assert fewer.problem.names == solution.problem.names
    (whole,), (part,) = (list(contradicted_beliefs(each)) for each in (solution, fewer))
    assert part.values == pytest.approx(whole.values, abs=3.0 * max(part.stds))
