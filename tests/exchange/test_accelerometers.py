"""Logs of phones and IMUs: every layout, the rests of an arm, and all that may be wrong."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_job import answer, refused
from foreign import imported
from phone_logs import (
    BEGIN,
    MOTION,
    REST,
    directions,
    log,
    middles,
    phyphox,
    postures,
    sensor_logger,
)
from ros_recordings import JOINTS, POSTURES, motion, write_imu_recording

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError
from suta_calib.exchange import ImportedRows
from suta_calib.exchange.reader import recognised
from suta_calib.measurements import read_csv_table
from suta_calib.units import from_deg

UP = directions()
TIME, FELT = log(UP)


def felt_in(rows: ImportedRows) -> FloatArray:
    return np.stack([rows.columns[name] for name in ("ax", "ay", "az")], axis=1)


def check(rows: ImportedRows, up: FloatArray, within: float = 0.1) -> None:
    """The directions of up, (k, 3), within some degrees."""
    felt = felt_in(rows)
    felt = felt / np.linalg.norm(felt, axis=1)[:, None]
    assert felt.shape == up.shape
    assert np.linalg.norm(felt - up, axis=1).max() < from_deg(within)


def table(path: Path, names: str, time: FloatArray, felt: FloatArray) -> Path:
    rows = [",".join(map(repr, row)) for row in np.column_stack([time, felt]).tolist()]
    path.write_text("\n".join([names, *rows]) + "\n")
    return path


LAYOUTS: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "Sensor Logger": ("sensor-logger", lambda path: sensor_logger(path, TIME, FELT)),
    "phyphox, commas": ("phyphox", lambda path: phyphox(path, TIME, FELT)),
    "phyphox, tabs": ("phyphox", lambda path: phyphox(path, TIME, FELT, "\t")),
    "phyphox, semicolons": ("phyphox", lambda path: phyphox(path, TIME, FELT, ";")),
    "phyphox, decimal commas": ("phyphox", lambda path: phyphox(path, TIME, FELT, ";", ",")),
    "phyphox in German": (
        "phyphox",
        lambda path: phyphox(path, TIME, FELT, ";", ",", "Beschleunigung"),
    ),
    "a table": ("accelerometer", lambda path: table(path, "time,ax,ay,az", TIME, FELT)),
    "a table in g and ms": (
        "accelerometer",
        lambda path: table(path, "time [ms],accX (g),accY (g),accZ (g)", TIME * 1e3, FELT / 9.81),
    ),
    "an IMU's messages": (
        "accelerometer",
        lambda path: table(
            path,
            "stamp,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z",
            TIME + BEGIN,
            FELT,
        ),
    ),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout(layout: str, tmp_path: Path) -> None:
    form, write = LAYOUTS[layout]
    path = write(tmp_path / "log.csv")
    assert recognised(path).name == form
    whole = imported(path)
    assert list(whole.columns) == ["time", "ax", "ay", "az"]
    assert len(whole) == len(TIME)
    assert np.diff(whole.columns["time"]) == pytest.approx(0.01, abs=1e-5)
    file, q = postures(tmp_path / "postures.csv", len(UP))
    rows = imported(path, postures=str(file))
    check(rows, UP)
    assert np.stack([rows.columns[name] for name in JOINTS], axis=1) == pytest.approx(q)
    # Noise of 0.02 m/s² on each axis, of which two count.
    assert rows.columns["std_deg"] == pytest.approx(np.rad2deg(0.02 / 9.81), rel=0.3)
    assert rows.assessment.level == "good"


@pytest.mark.parametrize(
    "names",
    [
        "time,a_x,a_y,a_z,a_qx,a_qy,a_qz,a_qw",
        "time,x,y,z",
        "time,joint_1,ax,ay,az",
        "ax,ay,az,landmark",
        "time,max,may,maz",
    ],
)
def test_tables_of_other_things_are_not_taken_for_an_accelerometers(
    names: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{names}\n" + ",".join("1" * len(names.split(","))) + "\n")
    assert recognised(path).name == "table"


def test_a_table_without_names(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "# bench", TIME, FELT)
    rows = imported(path, "accelerometer", columns="1=time,2=ax,3=ay,4=az")
    assert felt_in(rows) == pytest.approx(FELT)
    with pytest.raises(InputError, match=r"--columns 1=time,2=ax"):
        imported(path, "accelerometer")


def test_the_sign_is_that_of_the_phone(tmp_path: Path) -> None:
    """An iPhone's log points down, unless the app was told to standardise."""
    for metadata, sign in (("android,false", 1), ("ios,true", 1), ("ios,false", -1), ("", 1)):
        folder = tmp_path / f"{metadata or 'none'}"
        folder.mkdir()
        rows = imported(sensor_logger(folder / "Gravity.csv", TIME, FELT, metadata))
        assert felt_in(rows) == pytest.approx(sign * FELT)
        assert any("Metadata.csv" in remark for remark in rows.remarks)
    path = phyphox(tmp_path / "Raw Data.csv", TIME, FELT)
    assert felt_in(imported(path)) == pytest.approx(FELT, abs=1e-6)
    assert felt_in(imported(path, downwards=True)) == pytest.approx(-FELT, abs=1e-6)
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "device.csv").write_text('"deviceManufacturer","Apple"\n')
    assert felt_in(imported(path)) == pytest.approx(-FELT, abs=1e-6)


def test_rests_by_time(tmp_path: Path) -> None:
    """A posture in whose time the phone moved, or was off, is left out and told."""
    path = sensor_logger(tmp_path / "log.csv", TIME, FELT)
    at = BEGIN + middles(UP)
    at[2] += 0.5 * (REST + MOTION)
    file, q = postures(tmp_path / "postures.csv", len(UP), at)
    rows = imported(path, postures=str(file))
    kept = np.delete(np.arange(len(UP)), 2)
    check(rows, UP[kept], 0.2)
    assert rows.columns["joint_1"] == pytest.approx(q[kept, 0])
    assert (rows.dropped, rows.assessment.level) == (1, "care")
    assert "1 of 6 postures were left out (row 3)" in rows.notes[-1]
    late, _ = postures(tmp_path / "late.csv", 5, (BEGIN + middles(UP) + 1.5)[:5])
    with pytest.raises(InputError, match=r"of 5 postures of late.csv.*do both clocks agree"):
        imported(path, postures=str(late))


@pytest.mark.parametrize("shift", [0.0, 1.5, 3.0, -1.7e9])
def test_a_clock_of_their_own_does_not_mix_up_rests(shift: float, tmp_path: Path) -> None:
    """As many rests as postures, at the same intervals: in order, whatever the clocks say."""
    path = sensor_logger(tmp_path / "log.csv", TIME, FELT)
    file, _ = postures(tmp_path / "postures.csv", len(UP), BEGIN + middles(UP) + shift)
    rows = imported(path, postures=str(file))
    check(rows, UP)
    assert "in order" in rows.remarks[0]
    other, _ = postures(tmp_path / "other.csv", len(UP), 1e3 + middles(UP) ** 1.5)
    with pytest.raises(InputError, match="at other intervals than its times tell"):
        imported(path, postures=str(other))


def test_a_recording_of_the_joints(tmp_path: Path) -> None:
    """Rests are those of the joints; with another clock they are matched in order."""
    t, q = motion()
    names = ",".join(["time", *JOINTS])
    up = directions(len(POSTURES), 4)
    time, felt = log(up)
    path = sensor_logger(tmp_path / "log.csv", time, felt)
    # The arm of the recording rests for 2 s and moves for 0.6 s: clocks of their own.
    rows = imported(path, postures=str(table(tmp_path / "joints.csv", names, t, q)))
    check(rows, up)
    assert np.stack([rows.columns[n] for n in JOINTS], axis=1) == pytest.approx(POSTURES, abs=1e-6)


def test_counts_that_differ_are_told_with_the_times(tmp_path: Path) -> None:
    path = sensor_logger(tmp_path / "log.csv", TIME, FELT)
    file, _ = postures(tmp_path / "postures.csv", 5)
    says = r"6 rests in the log, 0\.\d, 3\.\d, 6\.\d.* s after its beginning; expected 5, as many"
    with pytest.raises(InputError, match=says):
        imported(path, postures=str(file))
    gap = sensor_logger(tmp_path / "gap.csv", *_without(slice(620, 980)))
    with pytest.raises(InputError, match=r"a gap of 3\.6\d* s, 6\.\d s after its beginning"):
        imported(gap, postures=str(postures(tmp_path / "all.csv", 6)[0]))
    twice = np.vstack([UP[:3], UP[2:]])
    disturbed = sensor_logger(tmp_path / "disturbed.csv", *log(twice))
    six, _ = postures(tmp_path / "six.csv", 6)
    with pytest.raises(InputError, match=r"between 6\.\d s and 9\.\d s: was the phone touched"):
        imported(disturbed, postures=str(six))


def test_a_posture_that_lacks_a_number_is_no_row_to_leave_out(tmp_path: Path) -> None:
    """Every rest after it would go with the posture of another."""
    path = sensor_logger(tmp_path / "log.csv", TIME, FELT)
    file, _ = postures(tmp_path / "postures.csv", len(UP))
    lines = file.read_text().splitlines()
    lines[3] = ",".join(["nan", *lines[3].split(",")[1:]])
    file.write_text("\n".join(lines) + "\n")
    says = r"postures\.csv: found 1 row with a missing number; expected every joint's reading"
    with pytest.raises(InputError, match=says):
        imported(path, postures=str(file))


def _without(rows: slice) -> tuple[FloatArray, FloatArray]:
    kept = np.ones(len(TIME), dtype=bool)
    kept[rows] = False
    return TIME[kept], FELT[kept]


def _harder(felt: FloatArray, begin: float, end: float, factor: float) -> FloatArray:
    rows = (begin <= TIME) & (end > TIME)
    return np.where(rows[:, None], factor * felt, felt)


def test_what_may_be_wrong_is_told(tmp_path: Path) -> None:
    file, _ = postures(tmp_path / "postures.csv", len(UP))
    # A gap within a motion, and each row twice.
    for time, felt, says in (
        (*_without(slice(210, 290)), r"1 gap of up to 0\.8\d* s"),
        (np.repeat(TIME, 2), np.repeat(FELT, 2, axis=0), "repeat the time of the row before"),
        (TIME, _harder(FELT, 3.0, 5.0, 1.2), "1 of 6 rests felt other than gravity .the first, 3"),
        (TIME, 0.5 * FELT, "gravity in no usual unit"),
    ):
        rows = imported(sensor_logger(tmp_path / "log.csv", time, felt), postures=str(file))
        assert rows.assessment.level == "care"
        assert any(re.search(says, note) for note in rows.notes), rows.notes


def test_rows_without_a_number_are_counted(tmp_path: Path) -> None:
    felt = FELT.copy()
    felt[[50, 400, 401], [0, 1, 2]] = np.nan
    path = sensor_logger(tmp_path / "log.csv", TIME, felt)
    file, _ = postures(tmp_path / "postures.csv", len(UP))
    rows = imported(path, postures=str(file))
    check(rows, UP)
    assert f"3 of {len(TIME)} rows of the log have a missing number" in " ".join(rows.remarks)
    alone = imported(table(tmp_path / "samples.csv", "joint_1,ax,ay,az", TIME[:80] / 20, felt[:80]))
    assert (len(alone), alone.dropped) == (79, 1)


def test_accelerations_called_x_y_z(tmp_path: Path) -> None:
    """Any table may have these: only whoever names the format says that they are accelerations."""
    path = table(tmp_path / "log.csv", "time,x,y,z", TIME, FELT)
    file, _ = postures(tmp_path / "postures.csv", len(UP))
    assert "give --format accelerometer" in " ".join(imported(path).remarks)
    with pytest.raises(InputError, match=r"no --postures; expected a file of a format that has it"):
        imported(path, postures=str(file))
    check(imported(path, "accelerometer", postures=str(file)), UP)


REFUSED: dict[str, tuple[Callable[[Path], Path], str]] = {
    "gravity taken out": (
        lambda path: sensor_logger(path, TIME, 0.001 * FELT),
        "take TotalAcceleration.csv (Android) or Gravity.csv",
    ),
    "linear acceleration of phyphox": (
        lambda path: phyphox(path, TIME, 0.001 * FELT, name="Linear Acceleration"),
        'record the experiment "Acceleration (with g)"',
    ),
    "numbers that are no accelerations": (
        lambda path: sensor_logger(path, TIME, np.where(TIME[:, None] == 0.03, 1e200, FELT)),
        "log.csv:5: found 1e+200; expected an acceleration",
    ),
    "g and m/s² mixed": (
        lambda path: sensor_logger(path, TIME, _harder(FELT, 6.0, 9.0, 1 / 9.81)),
        "multiply those in g by 9.80665",
    ),
    "g and m/s² in turn": (
        lambda path: sensor_logger(
            path, TIME, FELT / np.where(TIME % 0.02 < 0.005, 9.81, 1)[:, None]
        ),
        "multiply those in g by 9.80665",
    ),
    "an empty file": (lambda path: (path.write_text(""), path)[1], "found an empty file"),
    "a clock that was set back": (
        lambda path: sensor_logger(path, np.where(TIME > 8.0, TIME - 3.0, TIME), FELT),
        "runs backwards",
    ),
    "a clock that stands": (
        lambda path: sensor_logger(path, 0.0 * TIME, FELT),
        "one time in all rows",
    ),
    "ms without a unit": (
        lambda path: table(path, "time,ax,ay,az", TIME * 1e3, FELT),
        "rows 10 s apart",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_refused(what: str, tmp_path: Path) -> None:
    write, says = REFUSED[what]
    out = tmp_path / "out.csv"
    assert says in refused("import", write(tmp_path / "log.csv"), "--out", out)
    assert not out.exists()


def test_postures_in_degrees(tmp_path: Path) -> None:
    """Their names say it; numbers that look like degrees and do not say so are refused."""
    path = sensor_logger(tmp_path / "log.csv", TIME, FELT)
    file = tmp_path / "postures.csv"
    rows = "\n".join(f"{10 * k},{5 * k}" for k in range(len(UP)))
    file.write_text(f"lift [deg],flex_deg\n{rows}\n")
    found = imported(path, postures=str(file))
    assert found.columns["lift"] == pytest.approx(np.deg2rad(10 * np.arange(len(UP))))
    assert found.columns["flex"] == pytest.approx(np.deg2rad(5 * np.arange(len(UP))))
    file.write_text(f"lift,flex\n{rows}\n")
    found = imported(path, postures=str(file), unit="deg")
    assert found.columns["lift"] == pytest.approx(np.deg2rad(10 * np.arange(len(UP))))
    with pytest.raises(InputError, match=r"--unit: found a unit of joint readings"):
        imported(path, unit="deg")
    with pytest.raises(InputError, match=r"postures.csv.*look like degrees"):
        imported(path, postures=str(file))


def test_an_arm_that_never_rests_and_a_duration_without_postures(tmp_path: Path) -> None:
    swing = 9.81 * np.stack([np.sin(TIME), 0.0 * TIME, np.cos(TIME)], axis=1)
    path = sensor_logger(tmp_path / "log.csv", TIME, swing)
    file, _ = postures(tmp_path / "postures.csv", 6)
    with pytest.raises(InputError, match="no rest of 1 s"):
        imported(path, postures=str(file))
    with pytest.raises(InputError, match="with it --postures"):
        imported(path, seconds="2")


def test_an_imu_of_a_recording_of_ros(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    path = write_imu_recording(tmp_path / "run", joints=True)
    rows = imported(path, imu_topic="/imu")
    t, q = motion()
    up = np.stack([np.sin(POSTURES[:, 0]), 0 * POSTURES[:, 0], np.cos(POSTURES[:, 0])], axis=1)
    check(rows, up)
    assert [*rows.columns] == [*JOINTS, "ax", "ay", "az", "std_deg", "time"]
    alone = write_imu_recording(tmp_path / "alone", joints=False)
    assert [*imported(alone).columns] == ["time", "ax", "ay", "az"]
    table_of_joints = table(tmp_path / "joints.csv", ",".join(["time", *JOINTS]), t + 100.0, q)
    check(imported(alone, postures=str(table_of_joints)), up)
    with pytest.raises(InputError, match=r"--imu-topic"):
        imported(path, imu_topic="/other")


def test_a_log_becomes_the_zeros_of_an_arm(tmp_path: Path, repository: Path) -> None:
    """The example's hand, felt as a log of Sensor Logger and imported, gives the same zeros."""
    job = tmp_path / "phone"
    shutil.copytree(repository / "examples" / "phone_on_arm", job)
    samples = job / "simulated" / "hand" / "samples.csv"
    told = read_csv_table(samples)
    names = [name for name in told.columns if name not in ("ax", "ay", "az")]
    q = np.column_stack([told.numbers(name) for name in names])
    up = np.column_stack([told.numbers(name) for name in ("ax", "ay", "az")])
    up /= np.linalg.norm(up, axis=1)[:, None]
    path = sensor_logger(tmp_path / "Gravity.csv", *log(-up), "ios,false")
    listed = tmp_path / "postures.csv"
    listed.write_text(
        "\n".join([",".join(names), *(",".join(map(repr, row)) for row in q.tolist())]) + "\n"
    )
    found = answer("import", path, "--postures", listed, "--out", samples)
    assert found["rows"] == len(q)
    result = answer("calibrate", job / "calibration.yaml")
    truth = yaml.safe_load((job / "simulated" / "truth.yaml").read_text())["parameters"]
    for name, true in truth.items():
        estimate = result["parameters"][name]
        off = np.rad2deg(estimate["value"]) - true["value_deg"]
        assert abs(off) < 3.0 * np.rad2deg(estimate["std"]), name
