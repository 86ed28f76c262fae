"""Honest data of every kind, and what a new job frees: nothing is said but what is true."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from clean_jobs import SORTS, as_init_frees, judged, measured, with_priors
from simulated import arm_named

from suta_calib import Problem, SolverOptions, solve
from suta_calib.assessment import Assessment
from suta_calib.measurements import Chessboard
from suta_calib.terms import KINDS
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.rich_data import Sort


def knows_lengths(kind: str) -> bool:
    """Whether something that a kind uses has a scale, which is then named once."""
    return kind not in ("fixed_point", "line", "plane", "gravity")


def is_good(found: Assessment, kind: str) -> bool:
    """Good, and nothing said but what is true of what knows all lengths, and of a camera's tip."""
    others = [note for note in found.notes if "carries the scale" not in note]
    if len(found.notes) - len(others) != knows_lengths(kind):
        return False
    if kind not in ("hand_eye", "camera_view", "points", "plane_view", "profile"):
        return (found.level, others) == ("good", [])
    (note,) = others
    return found.level == "good" and "No ± includes an error there" in note


@pytest.mark.parametrize(("kind", "oriented"), SORTS)
def test_what_init_frees_is_good(kind: str, oriented: bool) -> None:
    arm = arm_named("suta")
    found = judged(arm, as_init_frees(arm), kind, oriented, seed=1)
    if kind in ("fixed_point", "line", "plane"):
        # None of them knows a length, so that one length of the arm stays open: its scale.
        (note,) = found.notes
        assert "joint_3.y could not be determined" in note
        assert "tracked_point" in note
    elif kind == "gravity":
        # No length shows in it, and nothing past the last joint.
        lengths, past_it = found.notes
        assert "could not be determined" in lengths
        assert "cannot determine joint_6.rz, joint_6.y, tip.x" in past_it
        assert found.level == "care"
    else:
        assert is_good(found, kind)


def test_a_board_that_nobody_measured_is_a_reason_for_care() -> None:
    """Half a percent of it is far more at the tip than the validation errors show."""
    arm = arm_named("suta")
    unknown = with_priors(arm)
    pair = measured(arm, unknown, Sort(KINDS["camera_view"], False), seed=1)
    boards: list[Any] = [replace(term, board=Chessboard(7, 5, 0.03)) for term in pair]
    solution = solve(Problem(boards[:1], unknown), SolverOptions(confirm=False))
    found = assess_calibration(CalibrationExamination.of(solution, boards[1:]))
    assert found.level == "care"
    (note,) = [note for note in found.notes if "carries the scale" in note]
    assert "Measure the board with a steel ruler over as many squares as it has" in note


@pytest.mark.parametrize(("kind", "oriented"), SORTS)
def test_what_priors_hold_is_good(kind: str, oriented: bool) -> None:
    arm = arm_named("suta")
    found = judged(arm, with_priors(arm), kind, oriented, seed=2)
    assert found.level == "good"
    named = ["carries the scale" in note for note in found.notes]
    assert named == [True] * knows_lengths(kind)


@pytest.mark.parametrize(
    ("kind", "oriented"), [("tracked_point", False), ("landmark", True), ("hand_eye", True)]
)
def test_another_arm_is_good_too(kind: str, oriented: bool) -> None:
    arm = arm_named("ur5")
    assert is_good(judged(arm, as_init_frees(arm), kind, oriented, seed=2), kind)


@pytest.mark.parametrize(("kind", "seed"), [("line", 7), ("range", 10), ("landmark", 16)])
def test_encoder_noise_that_grows_with_the_reach_is_no_contradiction(kind: str, seed: int) -> None:
    """The rows held out lie farther away than those that were fitted."""
    arm = arm_named("suta")
    found = judged(arm, as_init_frees(arm), kind, oriented=False, seed=seed)
    assert not [note for note in found.notes if "validation errors" in note]


def test_an_arm_that_is_by_chance_a_little_long_is_good() -> None:
    """Its lengths came out 0.38 ± 0.12 % longer, as they are."""
    arm = arm_named("suta")
    assert is_good(judged(arm, as_init_frees(arm), "tracked_point", False, seed=9), "tracked_point")


def test_held_out_errors_of_a_fit_with_priors_are_predicted() -> None:
    """A prior takes no equation's place when the scatter of the residuals is estimated."""
    arm = arm_named("suta")
    found = judged(arm, with_priors(arm), "range", oriented=False, seed=14)
    assert not [note for note in found.notes if "validation errors" in note]
