"""A plug is turned in its socket until it stops, at every landmark the same way; Enter at the last.

Whatever joints make it, the tip turns about the socket's axis.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from acquisition_scenes import SECONDS, Scene
from device_stand_in import Script

from suta_calib.acquisition.guided import ENTER
from suta_calib.acquisition.run import Run, last_motion
from suta_calib.acquisition.stops import Complete, StopFinder
from suta_calib.acquisition.touch_sequence import read_row, touched
from suta_calib.arrays import FloatArray
from suta_calib.errors import ArtefactError
from suta_calib.geometry.numbers import rotation_from_vector, vector_from_rotation
from suta_calib.measurements import read_artefact
from suta_calib.model.arm import ArmModel

NAMES = ("O", "M1", "M2")


def plan_with(job: Path, arm: ArmModel, twist: str | None, *, seated: bool = False):
    row = read_row(job, None, ["pairwise_distance"])
    row = replace(row, artefact=replace(row.artefact, twist=twist), seated=seated)
    return touched(arm, row, "P1", "1", NAMES)


def turned(arm: ArmModel, posture: FloatArray, degrees: float) -> FloatArray:
    """A posture with the plug in the same place, turned counter-clockwise as seen from above."""
    q = posture.copy()
    R, p = arm.forward(posture)
    wanted = rotation_from_vector([0.0, 0.0, np.radians(degrees)]) @ R
    names = [f"{joint}.offset" for joint in arm.joints]
    for _ in range(20):
        R, p_now = arm.forward(q)
        error = np.concatenate([p - p_now, vector_from_rotation(wanted @ R.T)])
        step = 1e-6
        columns = []
        for k in range(len(names)):
            other = q.copy()
            other[k] += step
            R_other, p_other = arm.forward(other)
            columns.append(np.r_[p_other - p_now, vector_from_rotation(R_other @ R.T)] / step)
        q = q + np.linalg.solve(np.array(columns).T, error)
    return q


def seat(arm: ArmModel, postures: dict[str, FloatArray], *degrees: float) -> Script:
    """Seats the plug at each landmark, and then turns it by so much counter-clockwise, degrees."""
    script = Script(postures[NAMES[0]] + 0.3).rest(0.5)
    for name, by in zip(NAMES, degrees, strict=False):
        script.move(turned(arm, postures[name], -by), 0.6).rest(0.2)
        script.move(postures[name], 0.5).rest(1.0)
    return script


@pytest.mark.parametrize("twist", ["ccw", "cw"])
def test_a_plug_turned_the_other_way_is_named(scene: Scene, twist: str) -> None:
    plan = plan_with(scene.job, scene.arm, twist)
    right = 2.0 if twist == "ccw" else -2.0
    script = seat(scene.arm, scene.postures, right, -right, right)
    attempt = scene.attempt(plan, script.readings()[350:])
    assert attempt.landmarks == [*NAMES]
    way, other = ("counter-clockwise", "clockwise")[:: 1 if twist == "ccw" else -1]
    assert [*attempt.run.notes] == ["M1"]
    expected = f"the plug was not turned {way} before the arm came to rest (it turned "
    assert attempt.run.notes["M1"].startswith(expected)
    assert f" deg {other}): turn the plug {way} until it stops" in attempt.run.notes["M1"]
    assert any(f"turn the plug {way} until it stops" in line for line in attempt.said)
    assert any(f"  look: {expected}" in line for line in attempt.said)


def test_where_nothing_is_said_of_a_twist_nothing_is_asked(scene: Scene) -> None:
    plan = plan_with(scene.job, scene.arm, None)
    script = seat(scene.arm, scene.postures, 2.0, -2.0, 2.0)
    attempt = scene.attempt(plan, script.readings()[350:])
    assert not attempt.run.notes
    assert not any("turn" in line for line in attempt.said)


def test_a_plug_that_was_not_turned_at_all_is_named(scene: Scene) -> None:
    """Only lowered into the socket, as it stands."""
    plan = plan_with(scene.job, scene.arm, None, seated=True)
    run = Run(plan, scene.file(plan), lambda _: None)
    script = Script(scene["O"]).rest(4.0).move(scene["O"] + 1e-3, 0.6).rest(1.0)
    finder = StopFinder(scene.arm.joints, SECONDS)
    events = [event for event in finder.feed(script.readings()) if isinstance(event, Complete)]
    first, last = events[0], replace(events[0].average, way=np.array([scene["O"]] * 9))
    run.confirm(last)
    assert "it did not turn" in run.notes["O"]
    # Nothing was seen of how the arm came to its first rest: nothing is said of its plug.
    run.confirm(first.average)
    assert "turn" not in run.notes["M1"]


@pytest.mark.parametrize(
    ("to_go", "found"),
    [
        ([5, 3, 1, 0, 0], 5),
        ([-9, -5, 2, 1, 0, 0], 2),
        ([9, 5, -2, -1, 0, 0], -2),
        ([0.2, -0.2, 0.1, 0], 0),
        ([7, 0.2, -0.2, 0], 7),
        ([], 0),
    ],
)
def test_the_last_motion_is_without_what_came_before(to_go: list[float], found: float) -> None:
    assert last_motion(np.array(to_go, dtype=float), 0.25) == found


def test_enter_at_the_posture_of_the_landmark_before_is_flagged(scene: Scene) -> None:
    it = scene.guidance(plan_with(scene.job, scene.arm, None), "O")
    it.script.rest(2.0)
    it.guided.press(ENTER)
    it.arm_does()
    assert not any("same posture" in line for line in it.said)
    it.guided.press(ENTER)
    # The arm is still on O, and somebody presses Enter.
    it.guided.press(ENTER)
    it.script.rest(2.0)
    it.arm_does()
    flagged = [line for line in it.said if "same posture as O" in line]
    assert flagged == [
        "  look: the same posture as O: check whether the arm moved to this landmark"
    ]
    it.guided.press(ENTER)
    assert it.run.notes["M1"].startswith(
        "the same posture as O: check whether the arm moved to this landmark"
    )


def test_a_twist_is_a_key_of_the_artefact(tmp_path: Path) -> None:
    path = tmp_path / "artefact.yaml"
    marks = "landmarks: {A: {position_mm: [0, 0, 0]}, B: {position_mm: [9, 0, 0]}}\n"
    path.write_text(f"twist: cw\n{marks}")
    assert read_artefact(path).twist == "cw"
    path.write_text(f"twist: left\n{marks}")
    with pytest.raises(ArtefactError, match=r"artefact.yaml:1: twist: found 'left'.*ccw, cw"):
        read_artefact(path)
