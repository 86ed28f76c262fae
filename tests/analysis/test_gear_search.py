"""The ratio of a strain wave gear is found by its ripple, and none is named where there is none."""

from __future__ import annotations

import pytest
from simulated import Spread, arm_named, tracked_scene
from studies import of_size

from suta_calib.analysis.model_selection import choose_model
from suta_calib.analysis.model_selection.gear_search import found_ratios
from suta_calib.report.model_selection import model_selection_document
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, Term
from suta_calib.trust.calibration_examination import CalibrationExamination

ARM = arm_named("suta")
UNKNOWN = ARM.select("joint_*.offset", "joint_4.z")


def tracked(truth: dict[str, float], ratios: dict[str, float], seed: int = 1) -> Term:
    """What a tracker with 0.1 mm of noise sees of an arm with gears of which nobody knows."""
    built = ARM.at({f"{joint}.gear_ratio": ratio for joint, ratio in ratios.items()})
    scene = tracked_scene(built, truth, 120)
    seen = scene.term(scene.samples(Spread(position=1e-4), seed=seed)[0])
    assert isinstance(seen.poses, ArmPoses)
    return seen.over_poses(seen.poses.of_arm(ARM))


@pytest.mark.parametrize("ratio", [100, 81])
def test_a_ratio_that_nobody_told_is_found(ratio: int) -> None:
    """0.03° of ripple, 0.1 mm of noise: usual ratios, and others."""
    truth = {"joint_2.ripple_c": 4e-4, "joint_2.ripple_s": -3e-4}
    choice = choose_model([tracked(truth, {"joint_2": ratio})], UNKNOWN, families=False)
    assert choice.added == tuple(truth)
    (gear,) = choice.gears
    assert (gear.joint, gear.ratio) == ("joint_2", ratio)
    for name, true in truth.items():
        e = choice.solution.estimates[name]
        assert e.value == pytest.approx(true, abs=4 * (e.std or 0))
    document = model_selection_document(choice)
    assert document.json()["gear_ratios"] == {"joint_2": ratio}
    said = " ".join(choice.assessment.notes)
    assert f"arm: {{gear_ratios: {{joint_2: {ratio}}}}}" in said


def test_two_gears_are_found_together() -> None:
    truth = {"joint_2.ripple_c": 8e-4, "joint_3.ripple_s": 8e-4}
    answer = _answer(tracked(truth, {"joint_2": 50, "joint_3": 120}))
    found = found_ratios(answer)
    assert {(gear.joint, gear.ratio) for gear in found} == {("joint_2", 50), ("joint_3", 120)}


@pytest.mark.parametrize("seeds", of_size(8, 20))
def test_none_is_named_where_there_is_none(seeds: int) -> None:
    assert not [s for s in range(seeds) if found_ratios(_answer(tracked({}, {}, s)))]
    # Nor is another smooth error taken for one.
    assert not found_ratios(_answer(tracked({"joint_3.ecc_c1": 2e-3}, {})))


def _answer(term: Term) -> CalibrationExamination:
    return CalibrationExamination.of(solve(Problem([term], UNKNOWN)))


def test_a_ratio_that_is_stated_is_not_searched() -> None:
    built = ARM.at({"joint_2.gear_ratio": 50.0})
    scene = tracked_scene(built, {"joint_2.ripple_c": 8e-4}, 120)
    term = scene.term(scene.samples(Spread(position=1e-4), seed=1)[0])
    found = found_ratios(CalibrationExamination.of(solve(Problem([term], UNKNOWN))))
    assert "joint_2" not in {gear.joint for gear in found}
