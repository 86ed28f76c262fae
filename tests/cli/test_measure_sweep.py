"""``suta-calib measure --continuous``: an arm that is swept by hand, live and from a recording."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture, cli, refused
from device_stand_in import Script
from hand_sweeps import SEAT, hand_motion, hand_readings, suta
from measuring_bench import Bench

from suta_calib.device.reading import Reading
from suta_calib.emulation import EmulatedArm
from suta_calib.geometry.numbers import wrap
from suta_calib.measurements import Samples
from suta_calib.terms import FixedPoint, TouchedPlane

SWEEP = ("--point", "F1", "--continuous")


def recorded(path: Path, readings: Sequence[Reading], header: str = "") -> Path:
    """A CSV of a recording."""
    lines = [header or ",".join(("time", *suta().joints))]
    lines += [",".join(map(repr, (r.time, *r.angles.tolist()))) for r in readings]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def replayed(bench: Bench, file: Path, *more: object) -> list[str]:
    return [str(each) for each in ("measure", bench.job, "--recording", file, *more)]


def swept(bench: Bench, name: str = "fixed_point/F1_1.csv") -> Samples:
    return bench.samples(name, FixedPoint.columns)


def test_a_sweep_is_recorded_thinned_and_tested(bench: Bench, capsys: Capture) -> None:
    pytest.importorskip("pyarrow")
    motion = hand_motion(1, "lift=4:0.6@3", seconds=9.0)
    emulation = bench.emulation(motion, "disconnect=0.4@6")
    with EmulatedArm(emulation, patient=True) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        assert cli(*bench.command(*SWEEP, "--json", seconds=7.5)) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    sweep = found["sweep"]
    (lift,) = sweep["lift_offs"]
    assert lift["distance_mm"] == pytest.approx(4.0, rel=0.2)
    assert 0.5 < lift["end_s"] - lift["begin_s"] < 1.2
    assert sweep["slips"] == []
    assert sweep["left_out"] > 0
    assert sweep["scatter_mm"] < 3 * 1e3 * SEAT
    assert "lift-off from" in err
    assert "connected again" in err
    assert f"only {sweep['strokes']} strokes" in err
    samples = swept(bench)
    assert len(samples) == found["samples"] == sweep["postures"]
    assert len(set(samples.labels["stroke"])) == sweep["strokes"]
    # Nothing of the lift-off is left, and each row is a posture the arm was in.
    moment, true = emulator.trajectory.motion_time, emulator.trajectory.q
    for q in samples.q:
        nearest = np.abs(wrap(true - q)).max(axis=1)
        assert nearest.min() < 3e-3
        assert not 3.1 < moment[nearest.argmin()] < 3.6
    # The whole stream is beside it, and gives the same samples again.
    raw = bench.folder / "fixed_point/F1_1.parquet"
    assert cli(*replayed(bench, raw, *SWEEP, "--repeat", "2")) == 0
    again = swept(bench, "fixed_point/F1_2.csv")
    assert len(again) == pytest.approx(len(samples), rel=0.1)
    assert "lift-off from" in capsys.readouterr().out


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_broken_off_nothing_is_lost(bench: Bench, capsys: Capture, how: signal.Signals) -> None:
    pytest.importorskip("pyarrow")
    with EmulatedArm(bench.emulation(hand_motion(1)), patient=True) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        command = [sys.executable, "-m", "suta_calib", *bench.command(*SWEEP, seconds=60)]
        pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        process = subprocess.Popen(command, text=True, **pipe)  # type: ignore[call-overload]
        file, part = (bench.folder / f"fixed_point/F1_1.{n}" for n in ("csv", "parquet.part"))
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (file.exists() and len(swept(bench)) > 60):
            time.sleep(0.1)
        process.send_signal(how)
        said, _ = process.communicate(timeout=60)
    rows = len(swept(bench))
    assert rows > 40
    if how is signal.SIGINT:
        assert process.returncode == 130
        assert "the tip scatters by" in said
        raw = part.with_suffix("")
        assert raw.exists()
    else:
        raw = part
    assert cli(*replayed(bench, raw, *SWEEP, "--repeat", "2")) == 0
    # A second of the stream may not have been written.
    assert len(swept(bench, "fixed_point/F1_2.csv")) > 0.6 * rows
    assert "the tip scatters by" in capsys.readouterr().out


def test_a_plate_from_a_table_with_nonsense(bench: Bench, capsys: Capture) -> None:
    text = bench.job.read_text(encoding="utf-8")
    bench.job.write_text(f"{text}  - {{kind: plane, samples: 'plane/*.csv'}}\n", encoding="utf-8")
    readings = hand_readings(hand_motion(5, "slip=2@11", size=0.12), rate=200.0)
    file = recorded(bench.folder / "plate.csv", [*readings[:900], readings[899], *readings[1000:]])
    lines = file.read_text(encoding="utf-8").splitlines()
    lines[300] = lines[300].replace(lines[300].split(",")[2], "nan")
    lines[400] = lines[400].replace(lines[400].split(",")[3], "?")
    lines[500] = lines[500].replace(lines[500].split(",")[1], "1e9")
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert cli(*replayed(bench, file, "--plane", "T1", "--continuous")) == 0
    out = capsys.readouterr().out
    assert "slip at 11.1" in out
    assert "rows from then on are of T1_slip1" in out
    assert "3 readings were no numbers" in out
    assert "1 readings came twice" in out
    samples = bench.samples("plane/T1_1.csv", TouchedPlane.columns)
    assert set(samples.labels["plane"]) == {"T1", "T1_slip1"}
    # What `calibrate` makes of it.
    bench.job.write_text(
        text.split("observations:")[0]
        + "observations:\n  - {kind: plane, samples: 'plane/*.csv'}\n",
        encoding="utf-8",
    )
    assert cli("calibrate", str(bench.job), "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["metrics"]["calibration"]["after"]["rms_mm"] < 0.3


def test_rests_too_are_found_in_a_recording(bench: Bench) -> None:
    script = Script(bench.postures["O"]).rest(1.0).move(bench.postures["M1"]).rest(1.0)
    file = recorded(bench.folder / "rests.csv", script.readings())
    more = ("--placement", "P1", "--sequence", "O,M1", "--seconds", 0.5)
    assert cli(*replayed(bench, file, *more)) == 0
    assert bench.samples().labels["landmark"].tolist() == ["O", "M1"]


def test_an_arm_that_stands_still_is_said_to(bench: Bench, capsys: Capture) -> None:
    file = recorded(bench.folder / "still.csv", Script(bench.postures["O"]).rest(2.0).readings())
    assert cli(*replayed(bench, file, *SWEEP)) == 0
    out = capsys.readouterr().out
    assert "1 postures in 1 strokes" in out
    assert "lift-off and slip were not tested: found 1 postures" in out


@pytest.mark.parametrize(
    ("more", "header", "said"),
    [
        (("--device", "device.yaml"), "", "found both; expected one of --device"),
        (("--raw", "raw.parquet"), "", "found --raw with --recording"),
        ((), "when,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6", "a column time"),
        ((), "time,joint_1,joint_2,joint_3,joint_4,joint_5,elbow", "joint_6"),
    ],
)
def test_bad_recordings_are_one_line(
    bench: Bench, more: Sequence[str], header: str, said: str
) -> None:
    readings = hand_readings(hand_motion(1), rate=20.0)
    file = recorded(bench.folder / "a.csv", readings, header)
    assert said in refused(*replayed(bench, file, *SWEEP, *more))


def test_degrees_and_no_source_are_refused(bench: Bench) -> None:
    readings = hand_readings(hand_motion(1), rate=20.0)
    for each in readings:
        each.angles[:] = np.degrees(each.angles)
    file = recorded(bench.folder / "degrees.csv", readings)
    assert "if they are degrees" in refused(*replayed(bench, file, *SWEEP))
    assert "found neither" in refused("measure", str(bench.job), *SWEEP)
