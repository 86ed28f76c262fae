"""A file of another format than a command expects is named, with the command that reads it."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from cli_job import cli

from suta_calib.errors import SamplesError
from suta_calib.exchange.recognition import other_format, recognised_format
from suta_calib.job.schema import read_job

MJCF = """<mujoco model="two"><worldbody><body name="base">
<body name="upper" pos="0 0 0.1"><joint name="j1" axis="0 0 1" range="-90 90"/><geom size="0.02"/>
<body name="lower" pos="0.2 0 0"><joint name="j2" axis="0 1 0" range="-90 90"/><geom size="0.02"/>
<site name="hand" pos="0.2 0 0"/></body></body></body></worldbody></mujoco>
"""
JOB = "arm: {urdf: arm.urdf, tip: hand}\nobservations:\n  - {kind: plane, samples: a.csv}\n"


@pytest.mark.parametrize(
    ("text", "command", "hint"),
    [
        (MJCF, "calibrate", "suta-calib import {} --format mjcf --out a.urdf"),
        ("<robot name='a'/>", "calibrate", "suta-calib init {} --tip LINK"),
        (JOB, "pivot", "suta-calib calibrate {}"),
        (JOB, "import", "suta-calib calibrate {}"),
        ("arm: {}\nsets: {}\n", "calibrate", "suta-calib simulate {}"),
        ("port: loop://\njoints: []\n", "observe", "suta-calib monitor --device {}"),
        ("name: sheet\nlandmarks: {}\n", "pivot", "name {} as the key artefact"),
        ("type: chessboard\ncorners: [7, 5]\n", "pivot", "name {} as the key board"),
        ("point,x,y,z,qx,qy,qz,qw\na,0,0,0,0,0,0,1\n", "hand-eye", "suta-calib pivot {}"),
        ("a_x,a_y,a_z,a_qx,a_qy,a_qz,a_qw,b_x\n", "pivot", "suta-calib hand-eye {}"),
        ("placement,repeat,landmark,j1\n", "calibrate", "name {} as the key samples"),
        ("feature,landmark,index,x,y,z\ntop,A,0,0,0,0\n", "pivot", "suta-calib certify {}"),
    ],
)
def test_what_a_file_is(
    text: str, command: str, hint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    suffix = ".xml" if text == MJCF else ".yaml"
    path = tmp_path / f"a{suffix}"
    path.write_text(text)
    assert cli(command, path) == 2
    shown = capsys.readouterr().err
    assert "this looks like " in shown
    assert hint.format(path) in shown


@pytest.mark.parametrize("text", ["", "x,y,z\n1,2,3\n", "a: 1\n", "<html/>", "\0\1", "{}"])
def test_what_is_of_no_format_is_called_none(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text)
    assert recognised_format(path) is None
    assert recognised_format(tmp_path) is None
    assert recognised_format(tmp_path / "none") is None
    assert cli("calibrate", path) == 2
    assert "looks like" not in capsys.readouterr().err


@pytest.mark.parametrize(("line", "told"), [(1, True), (3, False)])
def test_a_row_that_is_wrong_is_no_file_of_another_command(
    line: int, told: bool, tmp_path: Path
) -> None:
    """The columns were those that the command asks for; only a missing one is another's file."""
    path = tmp_path / "poses.csv"
    path.write_text("image,x,y,z,qx,qy,qz,qw\na,0,0,0,0,0,0,1\nb,0,0,0,0,0,0,nan\n")
    error = SamplesError("'nan'", "a finite number", file=path, line=line)
    assert ("suta-calib pivot" in other_format(error, "hand-eye")) is told


def test_who_reads_the_format_is_told_nothing_more(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "calibration.yaml"
    path.write_text(JOB)
    assert cli("calibrate", path) == 2
    assert "looks like" not in capsys.readouterr().err
    # What a job names as an artefact is read as one; what stands in the job's place is none.
    sheet = tmp_path / "sheet.yaml"
    sheet.write_text("landmarks: {A: {position: 1}}\n")
    for command, file in (("simulate", path), ("calibrate", sheet)):
        assert cli(command, file, *(("--out", tmp_path / "out") if file == path else ())) == 2
        assert "looks like" in capsys.readouterr().err


def test_a_mujoco_model_in_place_of_a_urdf(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A job names it in vain, and is told what to do; ``init`` makes a URDF of it."""
    pytest.importorskip("mujoco")
    model, job = tmp_path / "my arm.xml", tmp_path / "calibration.yaml"
    model.write_text(MJCF)
    job.write_text('arm: {urdf: "my arm.xml", tip: hand}\n' + JOB.partition("\n")[2])
    (tmp_path / "a.csv").write_text("plane,j1,j2\n")
    job.write_text(job.read_text() + "parameters:\n  - {select: geometric, prior_mm: 1}\n")
    assert cli("calibrate", job) == 2
    command = f"suta-calib import {shlex.quote(str(model))} --format mjcf --out 'my arm.urdf'"
    assert command in capsys.readouterr().err
    assert cli("init", model, "--out", tmp_path / "only") == 0
    assert "the tip is hand, at the end of the only chain" in capsys.readouterr().err
    new = tmp_path / "new"
    assert cli("init", model, "--tip", "hand", "--out", new) == 0
    assert str(new / "my arm.urdf") in capsys.readouterr().out
    assert read_job(new / "calibration.yaml").arm.model().joints == ("j1", "j2")
    # What is there stays.
    assert cli("init", model, "--tip", "hand", "--out", new) == 2
    assert "my arm.urdf" in capsys.readouterr().err
