"""What a change in time is called: the camera or the board that its rows alone look at."""

from __future__ import annotations

import numpy as np
from simulated import arm_named, camera_scene, dh_parameters, tracked_scene

from suta_calib.solver.problem import Problem
from suta_calib.trust.hypotheses.base_moved import BaseMoved
from suta_calib.trust.hypotheses.tip_moved import TipMoved
from suta_calib.trust.in_time import TipShift

SHIFT = TipShift("", np.zeros((0, 6)), np.zeros(6))


def test_a_camera_that_was_moved_is_named_not_the_base() -> None:
    """Beside rows of another term that found the base where it was."""
    arm = arm_named("suta")
    tracked = tracked_scene(arm, {}).exact()
    camera = camera_scene(arm, {}, setup="eye-to-hand").exact()
    problem, first = Problem([tracked, camera], dh_parameters(arm)), len(tracked.poses)
    within, everything = (1, first + 10, first + 20), (0, 10, first + 20)
    base, tip = BaseMoved(), TipMoved()
    assert base.subject(problem, within) == "camera"
    assert tip.subject(problem, within) == "board"
    assert base.subject(problem, everything) == tip.subject(problem, everything) == ""
    alone = Problem([camera], dh_parameters(arm))
    assert base.subject(alone, (0, 10, 20)) == ""
    size, covariance = np.array([5e-3, 0, 0, 0, 0, 0]), 1e-8 * np.eye(6)
    rows, p = ("front.csv:32", ""), 1e-9
    change = base.change(SHIFT, size, covariance, rows, p, what="camera front")
    assert "The camera front was moved by 5.00" in change.sentence
    assert "The base, or what it measures, was moved" in (
        base.change(SHIFT, size, covariance, rows, p).sentence
    )
