"""A job whose instrument has a clock of its own: its keys, other rows of its label, the answer."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import answer, refused, spoken
from moving_arm import STEP, MovingArm
from torso_robot import write_torso_job

from suta_calib import CalibrationJob, TimeOffset
from suta_calib.job.schema import read_job

JOB = """
arm: {urdf: URDF, tip: tip}
parameters:
  - {select: ["joint_[2-6].offset"]}
observations:
  - {kind: tracked_point, samples: fitted.csv, time_offset_ms: {bound: 100}}
validation:
  - {kind: tracked_point, samples: held.csv}
"""
CLOCK = "time_offset[default]"


def written(path: Path, moving: MovingArm, rows: slice, *, time: bool = True) -> None:
    """Some rows of a recording as a samples file."""
    columns = [moving.q, moving.seen()["position"]]
    names = [*moving.arm.joints, "x", "y", "z"]
    if time:
        columns, names = [moving.time[:, None], *columns], ["time", *names]
    numbers = np.hstack(columns)[rows]
    np.savetxt(path, numbers, "%.12g", ",", header=",".join(names), comments="")


@pytest.fixture
def job(tmp_path: Path, suta_urdf: Path) -> Path:
    moving = MovingArm(-0.02, rows=260, begin=0.0)
    written(tmp_path / "fitted.csv", moving, slice(0, 200))
    written(tmp_path / "held.csv", moving, slice(200, None))
    (tmp_path / "calibration.yaml").write_text(JOB.replace("URDF", str(suta_urdf)))
    return tmp_path / "calibration.yaml"


def changed(job: Path, *changes: tuple[str, str]) -> Path:
    text = job.read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    job.write_text(text)
    return job


def test_a_late_instrument_is_found_and_the_tip_is_as_with_a_true_clock(
    job: Path, tmp_path: Path
) -> None:
    late: dict[str, Any] = answer("calibrate", job)
    found = late["parameters"][CLOCK]
    assert found["unit"] == "s"
    assert abs(found["value"] + 0.02) < min(1e-3, 3.0 * found["std"])
    (clock,) = late["time_offsets"].values()
    assert (clock["rows"], clock["left_out"]) == (198, 2)
    assert clock["offset_ms"] == pytest.approx(1e3 * found["value"])
    # Without it the rows would be wrong by the way of the tip in 20 ms.
    assert 1.0 < clock["tip_mm"] < 20.0 > 100.0 * clock["tip_std_mm"]
    assert late["verdict"]["level"] == "good", late["verdict"]
    assert not any("moved" in note or "slip" in note for note in late["verdict"]["notes"])
    on_time = MovingArm(0.0, rows=260, begin=0.0)
    written(tmp_path / "fitted.csv", on_time, slice(0, 200))
    written(tmp_path / "held.csv", on_time, slice(200, None))
    changed(job, (", time_offset_ms: {bound: 100}", ""))
    right: dict[str, Any] = answer("calibrate", job)
    after = [result["metrics"]["validation"]["after"]["rms_mm"] for result in (late, right)]
    assert after[0] == pytest.approx(after[1], rel=0.1)


@pytest.mark.parametrize("time", [True, False])
def test_a_late_instrument_without_the_key_is_named_first(job: Path, *, time: bool) -> None:
    changed(job, (", time_offset_ms: {bound: 100}", ""))
    moving = MovingArm(-0.02, rows=260, begin=0.0)
    written(job.parent / "fitted.csv", moving, slice(0, 200), time=time)
    first, *others = CalibrationJob.load(job).run().assessment.notes
    found = re.search(r"after the observations, by ([\d.]+) ± ([\d.]+) (ms|of the time)", first)
    assert found is not None, first
    late, std = (float(found[k]) * (1.0 if time else 1e3 * STEP) for k in (1, 2))
    assert abs(late - 20.0) < 3.0 * std < 3.0
    assert re.search(r"the tip moves by [1-4]\.\d+ mm", first)
    assert "time_offset_ms: {bound: 100}" in first
    # What the file has is not asked for.
    assert ("a column time" in first) is not time
    guesses = ("right already", "was moved", "slip", "model lacks", "other conditions")
    assert not [note for note in others if any(guess in note for guess in guesses)]


def test_what_one_row_says_of_a_clock_holds_for_all_with_its_label(job: Path) -> None:
    spec = read_job(job)
    assert spec.observations[0].time_offset == TimeOffset(0.1)
    assert spec.validation[0].time_offset == TimeOffset(0.1)
    changed(job, ("held.csv}", "held.csv, label: other}"))
    assert read_job(job).validation[0].time_offset is None


def test_an_instrument_beside_a_robot_has_one_clock_for_all_chains(tmp_path: Path) -> None:
    job = write_torso_job(tmp_path, fitted=3, held_out=3)
    changed(job, ("left_fitted.csv}", "left_fitted.csv, time_offset_ms: {bound: 50}}"))
    spec = read_job(job)
    rows = (*spec.observations, *spec.validation)
    assert [row.time_offset for row in rows] == [TimeOffset(0.05)] * 4
    assert [row.time for row in rows] == [True, False, False, False]


@pytest.mark.filterwarnings("default:.*samples without a column time")
def test_held_out_rows_without_times_are_taken_as_they_are(job: Path) -> None:
    moving = MovingArm(-0.02, rows=260, begin=0.0)
    written(job.parent / "held.csv", moving, slice(200, None), time=False)
    code, _, said = spoken("calibrate", job)
    assert "calibration.yaml:8: samples without a column time, although the clock of" in said
    # The arm moved there.
    assert code == 1


def test_what_cannot_be_is_refused_with_its_line(job: Path) -> None:
    text = job.read_text()
    changed(job, ("{bound: 100}", "{bound: -5}"))
    assert "calibration.yaml:6: observations[0].time_offset_ms.bound" in refused("calibrate", job)
    job.write_text(text)
    changed(job, ("{bound: 100}", "{limit: 5}"))
    assert "time_offset_ms" in refused("calibrate", job)
    job.write_text(text)
    changed(job, ("held.csv}", "held.csv, time_offset_ms: {bound: 50}}"))
    assert "one clock per label" in refused("calibrate", job)
    job.write_text(text)
    changed(job, ("tracked_point, samples: fitted.csv", "fixed_point, samples: fitted.csv"))
    assert "a key that fixed_point does not use" in refused("calibrate", job)
    job.write_text(text)
    moving = MovingArm(-0.02, rows=260, begin=0.0)
    written(job.parent / "fitted.csv", moving, slice(0, 200), time=False)
    said = refused("calibrate", job)
    assert "fitted.csv:1: column 'time'" in said
    assert "expected a column time, in s, of a moving arm" in said


def test_kinds_that_share_a_label_are_told_of_their_clock(job: Path) -> None:
    gravity = "  - {kind: gravity, samples: felt.csv, time_offset_ms: {bound: 100}}\nvalidation:"
    changed(job, ("validation:", gravity))
    text = (job.parent / "fitted.csv").read_text().replace("x,y,z", "ax,ay,az", 1)
    (job.parent / "felt.csv").write_text(text)
    said = refused("calibrate", job)
    assert "time_offset[default] of tracked_point and of gravity" in said
    assert "give the row of one of the two another label: a label stands for one clock" in said


def test_a_time_offset_beyond_its_bound_is_told(job: Path) -> None:
    changed(job, ("{bound: 100}", "{bound: 5}"))
    _, out, _ = spoken("calibrate", job)
    said = " ".join(out.split())
    assert "time_offset[default] ended at the bound that the job gives. Give a larger one" in said
    assert not said.startswith("Good")
