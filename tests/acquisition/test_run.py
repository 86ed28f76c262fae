"""From stops to samples: plans, files, landmarks, and who decides what a stop was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from acquisition_scenes import Attempt, Scene
from device_stand_in import POSTURE, Script

from suta_calib.acquisition.averaging import Average
from suta_calib.acquisition.continuous import Continuous
from suta_calib.acquisition.guided import ENTER
from suta_calib.acquisition.pictures import NothingSeenError
from suta_calib.acquisition.run import Run, SamplesFile
from suta_calib.acquisition.seating_check import Visit
from suta_calib.acquisition.touch_sequence import repeated
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import wrap
from suta_calib.measurements import read_samples
from suta_calib.terms import FixedPoint, PairwiseDistance
from suta_calib.terms.poses import joint_ranges


# ── Unattended ─────────────────────────────────────────────────────────────────────────────────
def test_each_rest_after_a_motion_is_the_next_landmark(scene: Scene) -> None:
    path = scene.folder / "new" / "P1_1.csv"
    attempt = scene.attempt("O,M1,M2,L1", scene.visit("O,M1,M2,L1"), name="new/P1_1.csv")
    assert attempt.done
    assert attempt.landmarks == ["O", "M1", "M2", "L1"]
    scene.check(attempt)
    samples = read_samples([path], joint_ranges(scene.arm), PairwiseDistance.columns)
    assert samples.labels["placement"].tolist() == ["P1"] * 4
    assert samples.labels["repeat"].tolist() == ["1"] * 4
    assert "distances, measured - certified: to O" in "\n".join(attempt.said)
    assert not attempt.run.notes


def test_a_bump_is_no_motion_and_a_wobble_on_one_landmark_counts_once(scene: Scene) -> None:
    script = scene.visit("O")
    bump = scene["O"] + np.radians([0, 0, 0, 0.1, 0, 0])
    script.move(bump, 0.1).move(scene["O"], 0.1).rest(1.0)
    # Turned by hand about the seated tip: far, and back on the same landmark.
    script.move(scene["O"] + np.radians([0, 0, 0, 5, 0, 0]), 0.4).move(scene["O"], 0.4)
    script.rest(1.0).move(scene["M1"]).rest(1.0)
    attempt = scene.attempt("O,M1", script)
    assert attempt.landmarks == ["O", "M1"]
    scene.check(attempt)
    assert any("still on O" in line for line in attempt.said)


def test_sampling_ends_with_its_time_however_many_readings_come_at_once(scene: Scene) -> None:
    plan = scene.plan("O")
    readings = Script(scene["O"]).move(scene["M1"], 3.0).readings()
    counts = []
    for name, piece in (("one.csv", 1), ("all.csv", len(readings))):
        taker = Continuous(plan, scene.file(plan, name), lambda _: None, 1.0, 0.1)
        for k in range(0, len(readings), piece):
            if not taker.done:
                taker.feed(readings[k : k + piece])
        counts.append(taker.count)
    assert counts[0] == counts[1]
    assert 5 <= counts[0] <= 11


@pytest.mark.parametrize("late", [False, True])
def test_a_pause_is_the_devices_and_not_of_who_reads_it(scene: Scene, late: bool) -> None:
    """A busy computer reads both sides of a pause at once, or late what came without any."""
    readings = scene.visit("O,M1").readings()
    paused = [r if r.time < 0.8 else replace(r, time=r.time + 0.6) for r in readings]
    if late:
        paused = [replace(r, arrival=10.0) for r in paused]
        readings = [r if r.time < 0.8 else replace(r, arrival=r.time + 0.6) for r in readings]
    for name, given, pauses in (("a", paused, [0.6]), ("b", readings, [])):
        attempt = scene.attempt("O,M1", given, name=name)
        assert attempt.events.stalls == pytest.approx(pauses, abs=0.01)


def test_one_landmark_twice_in_the_sequence_is_touched_twice(scene: Scene) -> None:
    script = scene.visit("O").move(scene["M1"], 0.4).move(scene["O"], 0.4).rest(1.0)
    script.move(scene["M1"]).rest(1.0)
    attempt = scene.attempt("O,O,M1", script)
    assert attempt.landmarks == ["O", "O", "M1"]
    scene.check(attempt)


def test_a_window_disturbed_on_the_landmark_is_recorded_again(scene: Scene) -> None:
    script = scene.visit("O").move(scene["M1"]).rest(0.45)
    away = scene["M1"] + np.radians([3, 0, 0, 0, 0, 0])
    script.move(away, 0.3).move(scene["M1"], 0.3).rest(1.0).move(scene["M2"]).rest(1.0)
    attempt = scene.attempt("O,M1,M2", script)
    assert attempt.landmarks == ["O", "M1", "M2"]
    scene.check(attempt)
    assert any("rejected: moved after" in line and "joint_1" in line for line in attempt.said)


def test_a_rest_cut_short_by_moving_on_keeps_the_sequence(scene: Scene) -> None:
    script = scene.visit("O").move(scene["M1"]).rest(0.5)
    script.move(scene["M2"]).rest(1.0)
    attempt = scene.attempt("O,M1,M2", script)
    assert attempt.landmarks == ["O", "M1", "M2"]
    scene.check(attempt)
    assert any("shortened" in line for line in attempt.said)


def test_a_landmark_missed_in_a_pause_of_the_stream_is_told_and_left_out(scene: Scene) -> None:
    names = "O,M1,M2,L1,S1,S2"
    readings = scene.visit(names).readings()
    # From the end of the rest on M2 to the beginning of that on S1.
    kept = [r for r in readings if not 4.1 < r.time < 6.5]
    attempt = scene.attempt(names, kept)
    assert attempt.landmarks == ["O", "M1", "M2", "S1", "S2"]
    scene.check(attempt)
    assert attempt.run.skipped == ["L1"]
    assert any("missed L1: the distances show that this is S1" in line for line in attempt.said)
    assert attempt.run.missing == ("L1",)


def test_a_plug_in_the_wrong_place_stands_out(scene: Scene) -> None:
    attempt = scene.attempt("O,M1,M2", scene.visit("O,S4,M2"))
    assert attempt.landmarks == ["O", "M1", "M2"]
    assert list(attempt.run.notes) == ["M1"]
    assert any("these distances do not fit" in line for line in attempt.said)


def test_without_readings_patience_ends_it(scene: Scene) -> None:
    attempt = scene.attempt("O,M1", [])
    assert not attempt.done
    assert attempt.run.missing == ("O", "M1")
    assert not (scene.folder / "a.csv").exists()


@pytest.mark.parametrize("begin", ["M2", "L1"])
def test_a_resumed_run_goes_on_where_the_arm_is(scene: Scene, begin: str) -> None:
    names = "O,M1,M2,L1,S1"
    scene.attempt(names, scene.visit("O,M1,M2"))
    again = scene.attempt(names, scene.visit(names[names.index(begin) :]), resume=True)
    assert again.done
    assert again.landmarks == names.split(",")
    scene.check(again)


def test_a_fixed_point_is_touched_in_many_postures(scene: Scene) -> None:
    script = Script(POSTURE).rest(1.0)
    for k in (1, 2):
        script.move(POSTURE + 0.1 * k, 0.4).rest(1.0)
    attempt = scene.attempt(repeated(scene.arm, FixedPoint, "F1", "1", 3), script)
    assert attempt.done
    assert [labels["point"] for labels, _ in attempt.run.file.rows] == ["F1"] * 3


def test_a_rest_whose_picture_shows_nothing_is_no_sample(scene: Scene) -> None:
    """The next rest is of the same station; the arm must move before it."""
    script = Script(POSTURE).rest(1.0)
    for k in (1, 2):
        script.move(POSTURE + 0.1 * k, 0.4).rest(1.0)
    seen = iter(["000.png", "", "001.png"])

    def see() -> dict[str, str]:
        if not (image := next(seen)):
            raise NothingSeenError("no chessboard")
        return {"image": image}

    plan = repeated(scene.arm, None, None, "1", 2)
    file = SamplesFile(scene.folder / "a.csv", plan.arm.joints, ("image",), plan.key)
    attempt = Attempt(plan, file, script.readings(), see)
    assert attempt.done
    assert [labels["image"] for labels, _ in file.rows] == ["000.png", "001.png"]
    np.testing.assert_allclose(wrap(file.rows[1][1] - POSTURE), 0.2, atol=1e-5)
    line = next(line for line in attempt.said if "no sample" in line)
    assert line.endswith("no sample: the picture shows no chessboard; move the arm on")


# ── Guided ─────────────────────────────────────────────────────────────────────────────────────
def test_a_user_keeps_redoes_skips_and_goes_back(scene: Scene) -> None:
    it = scene.guidance("O,M1,M2,L1", "M2")
    it.script.rest(1.0)
    it.arm_does()
    assert it.rows() == []  # it rests, but nobody said that this is O
    it.script.move(scene["O"]).rest(0.3)
    it.arm_does()
    it.guided.press(ENTER)
    it.script.rest(0.8)
    it.arm_does()
    assert it.rows() == []  # recorded, not confirmed
    it.guided.press("r")
    it.script.rest(0.8)
    it.arm_does()
    it.guided.press(ENTER)
    assert it.rows() == ["O"]
    it.script.move(scene["M1"]).rest(1.0)  # by moving there, without a key
    it.arm_does()
    it.guided.press(ENTER)
    it.guided.press("s")
    assert it.rows() == ["O", "M1"]
    it.script.move(scene["S1"]).rest(1.0)
    it.arm_does()
    it.guided.press(ENTER)
    assert it.rows() == ["O", "M1", "L1"]
    assert it.guided.done
    assert it.run.missing == ("M2",)


def test_going_back_replaces_the_sample_only_when_there_is_another(scene: Scene) -> None:
    it = scene.guidance("O,M1", "M2")
    it.guided.press(ENTER)
    it.script.rest(1.0)
    it.arm_does()
    it.guided.press(ENTER)
    first = it.run.file.rows[0][1]
    it.guided.press("b")
    it.script.move(scene["O"]).rest(0.3)
    it.arm_does()
    assert np.array_equal(it.run.file.rows[0][1], first)
    it.script.rest(1.0)
    it.arm_does()
    it.guided.press(ENTER)
    assert it.rows() == ["O"]
    assert np.abs(it.run.file.rows[0][1] - scene["O"]).max() < 1e-5
    it.guided.press("q")
    assert it.guided.done


def average_of(angles: FloatArray) -> Average:
    none = np.zeros(len(angles))
    return Average(angles, std=none, count=100, left_out=none, seconds=0.5)


def test_a_touch_is_compared_with_every_earlier_one_of_its_place(scene: Scene) -> None:
    plan, off = scene.plan("O,M1"), np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0])
    # The landmarks in two repeats before; O was not well seated in the second one.
    visits = {
        name: [Visit("repeat 1", scene[name]), Visit("repeat 2", scene[name] + wrong)]
        for name, wrong in (("O", off), ("M1", 0.0 * off))
    }
    run = Run(plan, scene.file(plan), lambda _: None, visits=visits)
    run.confirm(average_of(scene["O"]))
    assert "mm from where it was in repeat 2: seat it again" in run.notes["O"]
    run.confirm(average_of(scene["M1"] + 1e-4))
    assert list(run.notes) == ["O"]


def test_a_rest_on_a_point_is_compared_with_those_before(scene: Scene) -> None:
    plan = repeated(scene.arm, FixedPoint, "F1", "1", 5)
    run = Run(plan, scene.file(plan), lambda _: None)
    off = np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0])
    for angles in (scene["O"], scene["O"] + off, scene["O"], scene["O"] - off):
        run.confirm(average_of(angles))
    # The second was wrong, and is no measure for the third.
    assert list(run.notes) == ["F1, rest 2", "F1, rest 4"]
    assert "where it was in rest 1" in run.notes["F1, rest 4"]


def test_a_resumed_run_knows_what_does_not_fit(scene: Scene) -> None:
    names = "O,M1,M2,M3,M4,M5"
    plan = scene.plan(names)
    run = Run(plan, scene.file(plan), lambda _: None)
    off = np.array([0.0, 0.06, 0.0, 0.0, 0.0, 0.0])
    for name in names.split(","):
        run.confirm(average_of(scene[name] + (off if name == "M4" else 0.0)))
    assert list(run.notes) == ["M4"]
    again = Run(plan, scene.file(plan, resume=True), lambda _: None)
    assert again.notes == run.notes
