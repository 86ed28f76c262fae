"""The faults of one arm of two are named as that arm's, and sound data of both are silent."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from suta_calib import (
    Problem,
    Robot,
    Selection,
    Solution,
    SolverOptions,
    Term,
    TrackedPoint,
    calibrate,
    robots,
    solve,
)
from suta_calib.registry import shipped
from suta_calib.terms import ArmPoses
from suta_calib.trust import Hypothesis, Pattern, Reinterpretation, Rule, examine, known_hypotheses
from suta_calib.trust.changes import changes
from suta_calib.trust.contradictions import contradictions
from suta_calib.trust.rereading import explaining_reading
from tests.support.clean_jobs import MIXED, judged_chains
from tests.support.simulated import ROBOTS
from tests.support.studies import first_of
from tests.support.torso_robot import built
from tests.support.two_armed import (
    ROBOT,
    both_hands,
    both_tips,
    examined,
    fitted,
    spoilt,
    tip_errors,
)

# What an instrument that sees both hands cannot have, what is refused in words before anything is
# solved, what no residual shows (a target's place on a free tip, of which a test of its own is
# below), and what one arm's data cannot have by themselves (the geometry that both share).
OTHER_DATA = {
    "exchanged targets",
    "given pose",
    "landmark names",
    "mirrored artefact",
    "mirrored survey",
    "misread observations",
    "misread tilt sensor",
    "stretched body",
    "unit of a length",
    "unit of positions",
    "unit of the joints",
    "unknown mount",
    "wrong labels",
}
FAULTS = {
    name: h
    for name, h in shipped(known_hypotheses()).items()
    if h.needs_arm and issubclass(TrackedPoint, h.applies_to) and name not in OTHER_DATA
}
REREAD = {name: h for name, h in FAULTS.items() if isinstance(h, Reinterpretation)}
PATTERNS = {name: h for name, h in FAULTS.items() if isinstance(h, Pattern)}
EXAMINED = {name: h for name, h in FAULTS.items() if name not in REREAD and name not in PATTERNS}
# What explains data as well: a gain is the travel of an encoder.
ALIKE = {"encoder travel": "joint error"}
QUICK = {"sign of a joint", "rows reversed"}
WHOLE_ROBOT = Path(__file__).parents[2] / "examples" / "whole_robot" / "robot.urdf"
ARMS = [*enumerate(ROBOT.chains)]


def names_arm(sentence: str, side: str) -> bool:
    """Whether it names a joint, a file or the chain of this arm, and none of the other's."""
    named = set(re.findall(r"\b(left|right)(?:_\d|\.csv|\b(?!-))", sentence))
    return named == {side}


@pytest.mark.parametrize(("arm", "side"), ARMS)
@pytest.mark.parametrize("hypothesis", EXAMINED.values(), ids=EXAMINED)
def test_a_fault_of_one_arm_is_sized_and_named_as_its_own(
    hypothesis: Hypothesis, arm: int, side: str
) -> None:
    fault, terms = spoilt(hypothesis, arm)
    first, *_ = examine(examined(terms))
    assert first.hypothesis.name in (hypothesis.name, ALIKE.get(hypothesis.name)), first.sentence
    known = np.isfinite(fault.size) & (first.evidence.std > 0)
    off = np.abs(np.abs(first.evidence.size) - np.abs(fault.size))[known]
    assert np.all(off < 3.5 * first.evidence.std[known]), first.sentence
    # A base is that of both.
    if not hypothesis.name.startswith("base creep"):
        assert names_arm(first.sentence, side), first.sentence


@pytest.mark.parametrize(
    ("hypothesis", "arm", "side"),
    [
        pytest.param(
            h, k, side, marks=() if n in QUICK and k else pytest.mark.slow, id=f"{n}-{side}"
        )
        for n, h in REREAD.items()
        for k, side in ARMS
    ],
)
def test_one_arm_that_is_misread_is_read_right(
    hypothesis: Reinterpretation, arm: int, side: str
) -> None:
    _, terms = spoilt(hypothesis, arm)
    reading = explaining_reading(fitted(terms))
    assert reading is not None
    assert reading.hypothesis is hypothesis, reading.description
    assert Rule().far_better * reading.after < reading.before
    if hypothesis.name != "rows of a file late":
        assert names_arm(reading.description, side), reading.description


@pytest.mark.parametrize(("arm", "side"), ARMS)
@pytest.mark.parametrize("hypothesis", PATTERNS.values(), ids=PATTERNS)
def test_a_pattern_in_one_arms_data_is_found(hypothesis: Pattern, arm: int, side: str) -> None:
    fault, terms = spoilt(hypothesis, arm)
    (sentence,) = hypothesis.matches(fitted(terms))
    assert fault.effect in sentence
    if hypothesis.name != "rounded":
        assert names_arm(sentence, side), sentence


def test_a_joint_of_another_chain_is_no_dead_joint() -> None:
    """The columns of the other arm's joints hold zeros, which are no readings."""
    solution = fitted(both_hands(2)[0])
    for hypothesis in PATTERNS.values():
        assert not [*hypothesis.matches(solution)]


def on_tips(solution: Solution) -> list[str]:
    """What is said against the place of a tip."""
    return [c.sentence for c in contradictions(solution, ()) if c.sentence.startswith("The tip ")]


@pytest.mark.parametrize(("arm", "side"), ARMS)
def test_a_target_beside_a_free_tip_is_named(arm: int, side: str) -> None:
    _, terms = spoilt(known_hypotheses()["unknown mount"], arm)
    (sentence,) = on_tips(fitted(terms))
    assert f"The tip {side}_hand ended 2" in sentence
    assert "give its name in a column target" in sentence


def of_left_arm(terms: list[Term]) -> Term:
    """The term of the left arm, over this arm alone."""
    arm, poses = ROBOT.chains["left"], terms[0].poses
    q = poses.samples.q[:, [ROBOT.joints.index(joint) for joint in arm.joints]]
    return replace(
        terms[0],
        poses=ArmPoses(arm, replace(poses.samples, joints=arm.joints, q=q)),
    )


@pytest.mark.parametrize(
    ("of_tip", "said"),
    [
        ([], 1),
        # Who says of the tip alone that it may be far off knows it.
        ([Selection(("left_hand.*",), bound_m=0.05, bound_rad=0.09)], 0),
        ([Selection(("left_hand.*",), prior_m=0.03, prior_rad=0.09)], 0),
    ],
    ids=["nothing", "bound", "prior"],
)
def test_a_target_beside_the_tip_of_a_lone_arm_is_named_where_the_tip_is_like_the_rest(
    of_tip: list[Selection], said: int
) -> None:
    term = of_left_arm(spoilt(known_hypotheses()["unknown mount"], 0)[1])
    arm = Selection(("geometric",), bound_m=0.03, bound_rad=0.09)
    unknown = ROBOT.chains["left"].select(arm, *of_tip, Selection(("*.offset",), bound_rad=0.2))
    options = SolverOptions(starts=1, confirm=False, max_iterations=30)
    assert len(on_tips(solve(Problem([term], unknown), options))) == said


@pytest.mark.parametrize("seed", first_of([3, 4]))
def test_sound_data_of_two_arms_are_silent(seed: int) -> None:
    answer = examined(both_hands(seed)[0])
    assert not examine(answer)
    assert not changes(answer)
    assert not on_tips(answer.solution)


def ratios_of_tip_errors(seeds: range) -> np.ndarray:
    """(seeds, hands) tip errors over what is stated, of both hands in one frame."""
    robot = Robot.from_urdf(WHOLE_ROBOT, {side: (f"{side}_hand", None) for side in ROBOT.chains})
    ratios = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        truth = built(robot, rng)
        fitted_terms, held = both_tips(robot, truth, 80, rng), both_tips(robot, truth, 30, rng)
        result = calibrate(robot, fitted_terms, validation=held, free=["geometric", "*.offset"])
        assert result.assessment.level == "good"
        errors = tip_errors(robot, result.solution, truth, rng)
        ratios.append([error / stated for error, stated in errors.values()])
    return np.array(ratios)


def test_both_hands_are_where_they_are_stated_to_be() -> None:
    ratios = ratios_of_tip_errors(range(5))
    assert np.all((ratios > 0.5) & (ratios < 1.6))
    assert np.all(np.abs(np.sqrt(np.mean(ratios**2, axis=0)) - 1.0) < 0.25)


@pytest.mark.slow
def test_both_hands_are_where_they_are_stated_to_be_on_average() -> None:
    ratios = ratios_of_tip_errors(range(40))
    assert np.all(np.abs(np.sqrt(np.mean(ratios**2, axis=0)) - 1.0) < 0.1)


@pytest.mark.skipif(not ROBOTS.is_dir(), reason="example-robot-data is not installed")
def test_both_grippers_of_a_humanoid_are_found_to_the_noise() -> None:
    """`benchmarks/pairs_of_tips.py` does it for every pair of tips of thirteen robots."""
    tips = {side: (f"wrist_{side}_ft_tool_link", None) for side in ROBOT.chains}
    robot, rng = Robot.from_urdf(robots.path("talos_full_v2"), tips), np.random.default_rng(0)
    truth = built(robot, rng)
    terms, held = both_tips(robot, truth, 80, rng), both_tips(robot, truth, 40, rng)
    result = calibrate(robot, terms, validation=held, free=["geometric", "*.offset"])
    assert result.assessment.level == "good"
    assert all(0.75 < errors.ratio < 1.33 for errors in result.examined.held_out)


@pytest.mark.parametrize("mixed", ["tracked and points", "head camera and both"])
def test_a_sound_job_of_several_kinds_is_good(mixed: str) -> None:
    verdict = judged_chains(MIXED[mixed], 0)
    assert verdict.level == "good", verdict.notes


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("mixed", MIXED)
def test_forty_sound_jobs_of_several_kinds_are_good(mixed: str, seed: int) -> None:
    verdict = judged_chains(MIXED[mixed], seed)
    assert verdict.level == "good", verdict.notes
