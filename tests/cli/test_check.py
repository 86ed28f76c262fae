"""The command line says whether a calibration is still right, and remembers it."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture, answer, cli, refused, simulated, write_simulated_job

from suta_calib.check.growing import growing
from suta_calib.errors import SamplesError
from suta_calib.measurements import Samples, write_samples
from suta_calib.model.arm import ArmModel

pytestmark = pytest.mark.usefixtures("undrawn")
Text = Callable[[str], str]


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """A result, and new rows of some days beside it."""
    folder = tmp_path_factory.mktemp("check")
    job = write_simulated_job(folder, suta_urdf)
    assert cli("calibrate", job) == 0
    arm = ArmModel.from_urdf(folder / "arm.urdf", "tip")
    sound = simulated(arm, 10, seed=5)
    assert sound.position is not None
    for name, turned, shifted in (
        ("sound", 0.0, 0.0),
        ("slipped", math.radians(0.1), 0.0),
        ("moved", 0.0, 1e-3),
    ):
        q = sound.q.copy()
        q[:, 2] += turned
        rows = Samples.from_arrays(
            arm.joints, q, position=sound.position + np.array([shifted, 0, 0])
        )
        write_samples(folder / f"{name}.csv", rows)
    return folder


def test_sound_rows_are_answered_with_0_and_slipped_ones_with_1(calibrated: Path) -> None:
    out = calibrated / "report"
    assert cli("check", calibrated / "results", calibrated / "sound.csv", "--out", out) == 0
    found = json.loads((out / "check.json").read_text())
    assert found["unchanged"] is True
    assert found["changed"] == []
    assert found["verdict"]["usable"]
    assert {power["what"] for power in found["power"]} >= {"base", "instrument", "tip", "scale"}
    assert (out / "report.html").is_file()
    found = answer("check", calibrated / "results", calibrated / "slipped.csv", code=1)
    (change,) = found["changed"]
    assert not found["unchanged"]
    assert change["what"] == "joint joint_3"
    assert change["by_deg"] == pytest.approx(-0.1, abs=4 * change["std_deg"])
    assert change["by_mm"] is None
    assert change["p"] < 1e-4
    assert not found["verdict"]["usable"]


def test_what_was_found_is_remembered_beside_the_result(calibrated: Path) -> None:
    history = calibrated / "results" / "checks.jsonl"
    before = history.read_text().splitlines() if history.exists() else []
    cli("check", calibrated / "results", calibrated / "sound.csv")
    cli("check", calibrated / "results", calibrated / "moved.csv")
    cli("check", calibrated / "results", calibrated / "moved.csv", "--no-history")
    *kept, sound, moved = map(json.loads, history.read_text().splitlines())
    assert len(kept) == len(before)
    assert sound["unchanged"]
    assert not moved["unchanged"]
    assert {*moved["changed"]} <= {"base", "instrument"}
    assert moved["p"] < sound["p"]
    result = (calibrated / "results" / "result.json").read_bytes()
    assert {line["result_sha256"] for line in (sound, moved)} == {sha256(result).hexdigest()}


def edited(calibrated: Path, change: Text) -> Path:
    file = calibrated / "edited.csv"
    file.write_text(change((calibrated / "sound.csv").read_text()))
    return file


def first_rows(count: int) -> Text:
    return lambda text: "\n".join(text.splitlines()[: count + 1]) + "\n"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda text: text.replace("joint_2", "elbow"), "joint_2"),
        (lambda text: text.replace("x,", "a,", 1), "x"),
        (lambda text: text.replace("0.", "nan", 1), "nan"),
        (lambda _: "", "empty"),
        (first_rows(0), "a header without data"),
    ],
)
def test_rows_that_cannot_be_read_are_refused(
    calibrated: Path, change: Text, expected: str
) -> None:
    file = edited(calibrated, change)
    message = refused("check", calibrated / "results", file)
    assert "edited.csv" in message
    assert expected in message


def test_a_result_that_must_not_be_used_is_refused_unless_anyway(
    calibrated: Path, tmp_path: Path
) -> None:
    content = json.loads((calibrated / "results" / "result.json").read_text())
    content["verdict"] |= {"level": "bad", "usable": False, "sentence": "too few rows"}
    for name in ("inputs.zip",):
        (tmp_path / name).write_bytes((calibrated / "results" / name).read_bytes())
    (tmp_path / "result.json").write_text(json.dumps(content))
    assert "--anyway" in refused("check", tmp_path, calibrated / "sound.csv")
    assert cli("check", tmp_path, calibrated / "sound.csv", "--anyway") == 0


def test_one_row_says_what_it_can(calibrated: Path) -> None:
    file = edited(calibrated, first_rows(1))
    found = answer("check", calibrated / "results", file)
    assert found["unchanged"]
    assert found["rows"] == 1


def test_millimetres_for_metres_are_no_change_of_the_arm(calibrated: Path, capsys: Capture) -> None:
    table = np.genfromtxt(calibrated / "sound.csv", delimiter=",", names=True)
    names = table.dtype.names
    assert names is not None
    rows = np.array([list(row) for row in table.tolist()])
    rows[:, [names.index(axis) for axis in "xyz"]] *= 1000.0
    file = calibrated / "in_mm.csv"
    np.savetxt(file, rows, delimiter=",", header=",".join(names), comments="")
    assert cli("check", calibrated / "results", file) == 1
    assert "another unit" in " ".join(capsys.readouterr().out.split())


def test_zeros_of_another_day_are_named_as_such(calibrated: Path) -> None:
    table = np.genfromtxt(calibrated / "sound.csv", delimiter=",", names=True)
    names = table.dtype.names
    assert names is not None
    rows = np.array([list(row) for row in table.tolist()])
    rows[:, :6] += np.array([0.01, -0.02, 0.015, 0.03, -0.01, 0.02])
    file = calibrated / "other_day.csv"
    np.savetxt(file, rows, delimiter=",", header=",".join(names), comments="")
    found = answer("check", calibrated / "results", file, code=1)
    assert found["changed"][0]["what"] == "zeros of all joints"


def test_a_repaired_result_is_a_whole_one(calibrated: Path, tmp_path: Path) -> None:
    out = tmp_path / "repaired"
    given = ("check", calibrated / "results", calibrated / "slipped.csv", "--repair")
    assert cli(*given, "--out", out) == 0
    result = json.loads((out / "result.json").read_text())
    old = json.loads((calibrated / "results" / "result.json").read_text())
    assert result["repaired"]["what"] == ["joint joint_3"]
    assert result["repaired"]["parameters"] == ["joint_3.offset"]
    assert result["verdict"]["usable"]
    assert {*result} >= {*old}
    # Which data the errors in it are of is said: the old metrics are not the new arm's.
    (errors,) = result["repaired"]["errors"]
    assert errors["kind"] == "tracked_point"
    assert errors["after_mm"] < errors["before_mm"]
    assert {"metrics", "noise"} <= {*result["repaired"]["of_calibration"]}
    assert "parameters" not in result["repaired"]["of_calibration"]
    assert any("before the repair" in note for note in result["verdict"]["notes"])
    name = "joint_3.offset"
    moved = result["parameters"][name]["value"] - old["parameters"][name]["value"]
    assert math.degrees(moved) == pytest.approx(-0.1, abs=0.03)
    assert {file.name for file in out.iterdir()} >= {
        *("result.json", "calibrated.urdf", "residuals.csv", "report.html", "inputs.zip")
    }
    # It is read back like any other.
    for command in (
        ("validate", out / "calibrated.urdf", out, "--result", out / "result.json"),
        ("check", out, calibrated / "slipped.csv"),
        ("export", out, "--format", "mjcf", "--out", tmp_path / "arm.xml"),
    ):
        assert cli(*command) == 0, command
    assert cli("check", out, calibrated / "sound.csv") == 1


def test_what_no_parameter_describes_is_not_repaired(calibrated: Path, tmp_path: Path) -> None:
    given = ("check", calibrated / "results", calibrated / "in_mm.csv", "--repair")
    assert cli(*given, "--out", tmp_path / "none") == 1
    assert not (tmp_path / "none" / "calibrated.urdf").exists()


def test_rows_are_followed_as_they_are_appended(calibrated: Path) -> None:
    """Written by another thread, line by line and half lines; it ends where something changed."""
    text = (calibrated / "slipped.csv").read_text().splitlines(keepends=True)
    file = calibrated / "growing.csv"
    file.unlink(missing_ok=True)

    def write() -> None:
        for line in text:
            with file.open("a") as rows:
                rows.write(line[: len(line) // 2])
                rows.flush()
                rows.write(line[len(line) // 2 :])

    writer = threading.Timer(0.3, write)
    writer.start()
    given = ("check", calibrated / "results", file, "--follow", "--seconds", "120")
    found = answer(*given, code=1)
    writer.join()
    assert not found["unchanged"]
    (first, *_) = found["changed"]
    assert "joint joint_3" in (first["what"], *first["instead"])


def test_a_last_line_that_is_half_written_waits(calibrated: Path) -> None:
    text = (calibrated / "sound.csv").read_text()
    file = calibrated / "half.csv"
    file.write_text("\n".join(text.splitlines()[:4]) + "\n0.1,0.2")
    found = answer("check", calibrated / "results", file, "--follow", "--seconds", "0.1")
    assert found["rows"] == 3
    assert found["unchanged"]
    message = refused("check", calibrated / "results", file.with_name("none.csv"), "--follow",
        "--seconds", "0.1")  # fmt: skip
    assert "none.csv" in message


def test_postures_for_a_check_are_planned_from_a_result(calibrated: Path, tmp_path: Path) -> None:
    out = tmp_path / "plan"
    assert cli("plan", calibrated / "results", "--for", "check", "--out", out) == 0
    lines = (out / "plan_check.csv").read_text().splitlines()
    assert lines[0].startswith("name,joint_1")
    assert len(lines) == 6


def test_a_file_that_is_begun_anew_is_followed_on(tmp_path: Path) -> None:
    """As programs do that keep one file for each day."""
    file = tmp_path / "rows.csv"
    file.write_text("a,b\n1,2\n3,4\n5,")
    grown = growing(file, None)
    assert next(grown) == (b"a,b\n1,2\n3,4\n", True)
    file.write_text("a,b\n1,2\n3,4\n5,6\n")
    assert not next(grown)[1]
    file.unlink()
    file.write_text("a,b\n7,8\n")
    assert next(grown) == (b"a,b\n7,8\n", True)
    file.write_text("a,c\n")
    with pytest.raises(SamplesError, match="other columns"):
        next(grown)
    file.write_text("a,b\n1,2\n")
    grown = growing(file, None)
    next(grown)
    file.write_text("a,b\n1,9\n3,4\n")
    with pytest.raises(SamplesError, match="other rows than before"):
        next(grown)


def test_ctrl_c_ends_following_with_what_is_known(
    calibrated: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(seconds: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("suta_calib.check.growing.time.sleep", interrupted)
    file = edited(calibrated, first_rows(3))
    found = answer("check", calibrated / "results", file, "--follow")
    assert found["rows"] == 3
    assert found["unchanged"]


def test_a_result_that_is_half_written_or_not_its_own_is_refused(
    calibrated: Path, tmp_path: Path
) -> None:
    text = (calibrated / "results" / "result.json").read_text()
    for content in ("", text[: len(text) // 2], "[]", "{}"):
        (tmp_path / "result.json").write_text(content)
        assert "result.json" in refused("check", tmp_path, calibrated / "sound.csv")
    # Its job is gone, and its copy too.
    gone = text.replace("calibration.yaml", "nowhere.yaml")
    (tmp_path / "result.json").write_text(gone)
    assert "nowhere.yaml" in refused("check", tmp_path, calibrated / "sound.csv")


def test_rows_of_another_arm_are_no_single_change(
    calibrated: Path, repository: Path, capsys: Capture
) -> None:
    """Of the same joints, but with other lengths: an arm of another table."""
    arm = ArmModel.from_urdf(repository / "urdf" / "suta_table_4_2.urdf", "tip")
    rows = simulated(arm, 12, seed=5)
    write_samples(calibrated / "another.csv", rows)
    assert cli("check", calibrated / "results", calibrated / "another.csv") == 1
    assert "another arm" in " ".join(capsys.readouterr().out.split())
