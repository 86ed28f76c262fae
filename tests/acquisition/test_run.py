"""From stops to samples: plans, files, landmarks, and who decides what a stop was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from acquisition_scenes import SECONDS, Attempt, check_against, file_of, plan_of, visit
from device_stand_in import POSTURE, Script

from suta_calib.acquisition.guided import ENTER, Guided
from suta_calib.acquisition.run import Run
from suta_calib.acquisition.stops import StopFinder
from suta_calib.acquisition.touch_sequence import TouchSequence, repeated
from suta_calib.acquisition.unattended import Continuous
from suta_calib.arrays import FloatArray
from suta_calib.measurements import read_samples
from suta_calib.model.arm import ArmModel
from suta_calib.terms import FixedPoint, PairwiseDistance
from suta_calib.terms.poses import joint_ranges


# ── Unattended ─────────────────────────────────────────────────────────────────────────────────
def test_each_rest_after_a_motion_is_the_next_landmark(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    plan = plan_of(job, arm, "O,M1,M2,L1")
    path = tmp_path / "new" / "P1_1.csv"
    attempt = Attempt(plan, file_of(plan, path), visit(postures, "O,M1,M2,L1").readings())
    assert attempt.done
    assert attempt.landmarks == ["O", "M1", "M2", "L1"]
    check_against(attempt, postures)
    samples = read_samples([path], joint_ranges(arm), PairwiseDistance.columns)
    assert samples.labels["placement"].tolist() == ["P1"] * 4
    assert samples.labels["repeat"].tolist() == ["1"] * 4
    assert "distances, measured - certified: to O" in "\n".join(attempt.said)
    assert not attempt.run.notes


def test_a_bump_is_no_motion_and_a_wobble_on_one_landmark_counts_once(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    script = visit(postures, "O")
    bump = postures["O"] + np.radians([0, 0, 0, 0.1, 0, 0])
    script.move(bump, 0.1).move(postures["O"], 0.1).rest(1.0)
    # Turned by hand about the seated tip: far, and back on the same landmark.
    script.move(postures["O"] + np.radians([0, 0, 0, 5, 0, 0]), 0.4).move(postures["O"], 0.4)
    script.rest(1.0).move(postures["M1"]).rest(1.0)
    plan = plan_of(job, arm, "O,M1")
    attempt = Attempt(plan, file_of(plan, tmp_path / "a.csv"), script.readings())
    assert attempt.landmarks == ["O", "M1"]
    check_against(attempt, postures)
    assert any("still on O" in line for line in attempt.said)


def test_sampling_ends_with_its_time_however_many_readings_come_at_once(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    plan = plan_of(job, arm, "O")
    readings = Script(postures["O"]).move(postures["M1"], 3.0).readings()
    counts = []
    for name, piece in (("one.csv", 1), ("all.csv", len(readings))):
        taker = Continuous(plan, file_of(plan, tmp_path / name), lambda _: None, 1.0, 0.1)
        for k in range(0, len(readings), piece):
            if not taker.done:
                taker.feed(readings[k : k + piece])
        counts.append(taker.count)
    assert counts[0] == counts[1]
    assert 5 <= counts[0] <= 11


@pytest.mark.parametrize("late", [False, True])
def test_a_pause_is_the_devices_and_not_of_who_reads_it(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path, late: bool
) -> None:
    """A busy computer reads both sides of a pause at once, or late what came without any."""
    plan = plan_of(job, arm, "O,M1")
    readings = visit(postures, "O,M1").readings()
    paused = [r if r.time < 0.8 else replace(r, time=r.time + 0.6) for r in readings]
    if late:
        paused = [replace(r, arrival=10.0) for r in paused]
        readings = [r if r.time < 0.8 else replace(r, arrival=r.time + 0.6) for r in readings]
    for name, given, pauses in (("a", paused, [0.6]), ("b", readings, [])):
        attempt = Attempt(plan, file_of(plan, tmp_path / name), given)
        assert attempt.events.stalls == pytest.approx(pauses, abs=0.01)


def test_one_landmark_twice_in_the_sequence_is_touched_twice(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    plan = plan_of(job, arm, "O,O,M1")
    script = visit(postures, "O").move(postures["M1"], 0.4).move(postures["O"], 0.4).rest(1.0)
    script.move(postures["M1"]).rest(1.0)
    attempt = Attempt(plan, file_of(plan, tmp_path / "a.csv"), script.readings())
    assert attempt.landmarks == ["O", "O", "M1"]
    check_against(attempt, postures)


def test_a_window_disturbed_on_the_landmark_is_recorded_again(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    script = visit(postures, "O").move(postures["M1"]).rest(0.45)
    away = postures["M1"] + np.radians([3, 0, 0, 0, 0, 0])
    script.move(away, 0.3).move(postures["M1"], 0.3).rest(1.0).move(postures["M2"]).rest(1.0)
    plan = plan_of(job, arm, "O,M1,M2")
    attempt = Attempt(plan, file_of(plan, tmp_path / "a.csv"), script.readings())
    assert attempt.landmarks == ["O", "M1", "M2"]
    check_against(attempt, postures)
    assert any("rejected: moved after" in line and "joint_1" in line for line in attempt.said)


def test_a_rest_cut_short_by_moving_on_keeps_the_sequence(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    script = visit(postures, "O").move(postures["M1"]).rest(0.5)
    script.move(postures["M2"]).rest(1.0)
    plan = plan_of(job, arm, "O,M1,M2")
    attempt = Attempt(plan, file_of(plan, tmp_path / "a.csv"), script.readings())
    assert attempt.landmarks == ["O", "M1", "M2"]
    check_against(attempt, postures)
    assert any("cut short" in line for line in attempt.said)


def test_a_landmark_missed_in_a_pause_of_the_stream_is_told_and_left_out(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    names = "O,M1,M2,L1,S1,S2"
    readings = visit(postures, names).readings()
    # From the end of the rest on M2 to the beginning of that on S1.
    kept = [r for r in readings if not 4.1 < r.time < 6.5]
    plan = plan_of(job, arm, names)
    attempt = Attempt(plan, file_of(plan, tmp_path / "a.csv"), kept)
    assert attempt.landmarks == ["O", "M1", "M2", "S1", "S2"]
    check_against(attempt, postures)
    assert attempt.run.skipped == ["L1"]
    assert any("missed L1: by its distances this is S1" in line for line in attempt.said)
    assert attempt.run.missing == ("L1",)


def test_a_plug_in_the_wrong_place_stands_out(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    plan = plan_of(job, arm, "O,M1,M2")
    readings = visit(postures, "O,S4,M2").readings()
    attempt = Attempt(plan, file_of(plan, tmp_path / "a.csv"), readings)
    assert attempt.landmarks == ["O", "M1", "M2"]
    assert list(attempt.run.notes) == ["M1"]
    assert any("stand out" in line for line in attempt.said)


def test_without_readings_patience_ends_it(job: Path, arm: ArmModel, tmp_path: Path) -> None:
    plan = plan_of(job, arm, "O,M1")
    attempt = Attempt(plan, file_of(plan, tmp_path / "a.csv"), [])
    assert not attempt.done
    assert attempt.run.missing == ("O", "M1")
    assert not (tmp_path / "a.csv").exists()


@pytest.mark.parametrize("begin", ["M2", "L1"])
def test_a_resumed_run_goes_on_where_the_arm_is(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path, begin: str
) -> None:
    names, path = "O,M1,M2,L1,S1", tmp_path / "a.csv"
    plan = plan_of(job, arm, names)
    Attempt(plan, file_of(plan, path), visit(postures, "O,M1,M2").readings())
    again = Attempt(
        plan,
        file_of(plan, path, resume=True),
        visit(postures, names[names.index(begin) :]).readings(),
    )
    assert again.done
    assert again.landmarks == names.split(",")
    check_against(again, postures)


def test_a_fixed_point_is_touched_in_many_postures(arm: ArmModel, tmp_path: Path) -> None:
    plan = repeated(arm, FixedPoint, "F1", "1", 3)
    script = Script(POSTURE).rest(1.0)
    for k in (1, 2):
        script.move(POSTURE + 0.1 * k, 0.4).rest(1.0)
    attempt = Attempt(plan, file_of(plan, tmp_path / "F1.csv"), script.readings())
    assert attempt.done
    assert [labels["point"] for labels, _ in attempt.run.file.rows] == ["F1"] * 3


# ── Guided ─────────────────────────────────────────────────────────────────────────────────────
class Guidance:
    """A user who presses keys between pieces of the stream."""

    def __init__(self, plan: TouchSequence, path: Path, start: FloatArray) -> None:
        self.said: list[str] = []
        self.run = Run(plan, file_of(plan, path), self.said.append)
        self.finder = StopFinder(plan.arm.joints, SECONDS)
        self.guided = Guided(self.run, self.finder, SECONDS)
        self.script, self.fed = Script(start), 0

    def arm_does(self) -> None:
        """Feed what the script has grown by."""
        for event in self.finder.feed(self.script.readings()[self.fed :]):
            self.guided.handle(event)
        self.fed = len(self.script.angles)

    def rows(self) -> list[str]:
        return [labels["landmark"] for labels, _ in self.run.file.rows]


def test_a_user_keeps_redoes_skips_and_goes_back(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    it = Guidance(plan_of(job, arm, "O,M1,M2,L1"), tmp_path / "a.csv", postures["M2"])
    it.script.rest(1.0)
    it.arm_does()
    assert it.rows() == []  # it rests, but nobody said that this is O
    it.script.move(postures["O"]).rest(0.3)
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
    it.script.move(postures["M1"]).rest(1.0)  # by moving there, without a key
    it.arm_does()
    it.guided.press(ENTER)
    it.guided.press("s")
    assert it.rows() == ["O", "M1"]
    it.script.move(postures["S1"]).rest(1.0)
    it.arm_does()
    it.guided.press(ENTER)
    assert it.rows() == ["O", "M1", "L1"]
    assert it.guided.done
    assert it.run.missing == ("M2",)


def test_going_back_replaces_the_sample_only_when_there_is_another(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path
) -> None:
    it = Guidance(plan_of(job, arm, "O,M1"), tmp_path / "a.csv", postures["M2"])
    it.guided.press(ENTER)
    it.script.rest(1.0)
    it.arm_does()
    it.guided.press(ENTER)
    first = it.run.file.rows[0][1]
    it.guided.press("b")
    it.script.move(postures["O"]).rest(0.3)
    it.arm_does()
    assert np.array_equal(it.run.file.rows[0][1], first)
    it.script.rest(1.0)
    it.arm_does()
    it.guided.press(ENTER)
    assert it.rows() == ["O"]
    assert np.abs(it.run.file.rows[0][1] - postures["O"]).max() < 1e-5
    it.guided.press("q")
    assert it.guided.done
