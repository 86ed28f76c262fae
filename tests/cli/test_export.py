"""``suta-calib export`` end to end: what is written, beside it, and what is refused."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from cli_job import answer, cli, refused, write_simulated_job

from suta_calib.exchange import export_formats
from suta_calib.model.arm import ArmModel


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    folder = tmp_path_factory.mktemp("calibrated")
    assert cli("calibrate", write_simulated_job(folder, suta_urdf)) == 0
    return folder


@pytest.fixture
def job(calibrated: Path, tmp_path: Path) -> Path:
    """A copy of the job's folder, with its results, at another place."""
    return Path(shutil.copytree(calibrated, tmp_path / "job"))


def test_a_file_and_what_it_cannot_hold(job: Path, tmp_path: Path) -> None:
    out = tmp_path / "arm.xml"
    told = answer("export", job / "results", "--format", "mjcf", "--out", out)
    beside = Path(f"{out}.left_out.json")
    assert told["files"] == [str(out), str(beside)]
    assert told["verdict"]["usable"]
    result = json.loads((job / "results/result.json").read_text())
    left_out = json.loads(beside.read_text())
    assert left_out["covariance"]["parameters"] == result["covariance"]["parameters"]
    assert left_out["covariance"]["matrix"] == result["covariance"]["matrix"]
    # A format that holds everything leaves nothing of a run before.
    assert cli("export", job / "results", "--format", "json", "--out", out) == 0
    assert not beside.exists()


def test_values_of_no_geometry_are_said(job: Path) -> None:
    path = job / "results/result.json"
    data = json.loads(path.read_text())
    gain = {"unit": "1", "nominal": 0.0, "value": 0.01, "std": 0.001, "state": "identified"}
    data["parameters"]["joint_2.gain"] = gain
    path.write_text(json.dumps(data))
    told = answer("export", path, "--format", "urdf")
    assert told["verdict"]["level"] == "care"
    assert "joint_2.gain" in told["verdict"]["notes"][0]
    assert told["left_out"]["parameters"] == {"joint_2.gain": 0.01}


def test_every_format_is_listed_with_an_example() -> None:
    told = {each["name"]: each for each in answer("export", "--list")["formats"]}
    assert set(told) == set(export_formats())
    assert all(f"--format {name}" in each["example"] for name, each in told.items())


def test_an_answer_that_must_not_be_used_is_refused(job: Path) -> None:
    path = job / "results/result.json"
    data = json.loads(path.read_text())
    data["verdict"] |= {"usable": False, "level": "bad", "notes": ["It is worse."]}
    path.write_text(json.dumps(data))
    before = sorted(job.rglob("*"))
    assert "must not be used (It is worse)" in refused("export", path, "--format", "urdf")
    assert sorted(job.rglob("*")) == before
    assert cli("export", path, "--format", "urdf", "--anyway") == 0


def test_a_job_that_was_changed_or_is_gone(job: Path, tmp_path: Path) -> None:
    with (job / "calibration.yaml").open("a") as file:
        file.write("# another day\n")
    command = ("export", job / "results", "--format", "urdf", "--out", tmp_path / "arm.urdf")
    # Where the job stood when it was solved, it still is; this copy must not stand for it.
    data = json.loads((job / "results/result.json").read_text())
    (_, hashed), *_ = data["run"]["inputs"].items()
    data["run"]["inputs"] = {"elsewhere/calibration.yaml": hashed}
    (job / "results/result.json").write_text(json.dumps(data))
    (job / "results/inputs.zip").unlink()
    assert "calibration.yaml, which was changed since" in refused(*command)
    assert cli(*command, "--urdf", job / "arm.urdf", "--tip", "tip") == 0
    made = ArmModel.from_urdf(tmp_path / "arm.urdf", "tip")
    written = ArmModel.from_urdf(job / "results/calibrated.urdf", "tip")
    assert made.parameters["joint_4.z"].nominal == written.parameters["joint_4.z"].nominal


REFUSED = {
    "no format": ((), "found no --format"),
    "an unknown format": (("--format", "urd"), "the format 'urd'; expected one of .*did you mean"),
    "another format's option": (
        ("--format", "urdf", "--pose", "tip"),
        "option 'pose' for the form",
    ),
    "no camera": (("--format", "camera-info"), "no camera"),
    "no calibration": (("--format", "lerobot"), "--calibration"),
    "itself": (("--format", "json", "--out", "{results}/result.json"), "an input of the same"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_refused(what: str, job: Path) -> None:
    words, says = REFUSED[what]
    given = [word.format(results=job / "results") for word in words]
    before = {path: path.stat().st_mtime_ns for path in job.rglob("*")}
    err = refused("export", job / "results", *given)
    assert re.search(says, err), err
    assert {path: path.stat().st_mtime_ns for path in job.rglob("*")} == before


def test_the_camera_of_a_job(repository: Path, tmp_path: Path) -> None:
    """What a job estimated of its camera, near what the pictures were made with."""
    from suta_calib.measurements import read_camera

    ignored = shutil.ignore_patterns("pictures", "results*")
    folder = shutil.copytree(repository / "data/workcell", tmp_path / "workcell", ignore=ignored)
    assert cli("calibrate", folder / "calibration.yaml") == 0
    out = tmp_path / "camera.yaml"
    assert cli("export", folder / "results", "--format", "camera-info", "--out", out) == 0
    found = read_camera(out)
    before = read_camera(folder / "camera.yaml")
    assert (found.width, found.height) == (before.width, before.height)
    truth = [612.4, 612.9, 324.8, 236.1]
    assert max(abs(found.intrinsics[:4] - truth)) < max(abs(before.intrinsics[:4] - truth))
    assert cli("export", folder / "results", "--format", "ros-tf", "--out", out) == 0
    assert "child_frame_id: camera" in out.read_text()
