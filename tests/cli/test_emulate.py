"""``suta-calib emulate`` end to end on real pseudo-terminals."""

from __future__ import annotations

import csv
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_job import Capture, cli, printed, refused
from emulated import TRUTH, angles, listen, true_landmarks, write_artefact

from suta_calib.device import read_device
from suta_calib.emulation import read_truth
from suta_calib.geometry.numbers import wrap
from suta_calib.model.arm import ArmModel

JOB = """\
arm: {urdf: arm.urdf, tip: tip}
parameters:
  - {select: ["joint_*.offset"], bound_deg: 15}
  - {select: [joint_4.z, tip.y], bound_mm: 30}
observations:
  - {kind: fixed_point, samples: "not/there/yet/*.csv"}
  - {kind: pairwise_distance, artefact: artefact.yaml, samples: "nor/these/*.csv"}
"""
P1 = "P1=437.5,12.5,0,0,0,-105"


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """A job whose samples have not been measured yet."""
    write_artefact(tmp_path)
    (tmp_path / "calibration.yaml").write_text(JOB)
    return tmp_path / "calibration.yaml"


@pytest.fixture(scope="module")
def arm(suta_urdf: Path) -> ArmModel:
    return ArmModel.from_urdf(suta_urdf, "tip")


@contextmanager
def emulating(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """The command in a process of its own."""
    command = [sys.executable, "-m", "suta_calib", "emulate", *map(str, arguments)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def first_line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().rstrip("\n")


def test_a_job_is_gone_through_with_the_truth_beside_it(
    job: Path, suta_urdf: Path, arm: ArmModel
) -> None:
    folder = job.parent
    files = {key: folder / name for key, name in [("device", "d.yaml"), ("truth", "t.yaml")]}
    with emulating(
        *(suta_urdf, "--script", job, "--placement", P1, "--rest", "0.3", "--move", "0.1"),
        *("--errors-seed", 5, "--seating-mm", 0, "--signs", "1,-1,1,1,-1,1"),
        *("--device-out", files["device"], "--truth-out", files["truth"]),
        *("--trajectory-out", folder / "path.csv", "--link", folder / "port"),
    ) as process:
        port = first_line(process)
        assert str((folder / "port").readlink()) == port
        device = read_device(files["device"])
        assert (device.port, device.joints[1].sign) == (str(folder / "port"), -1)
        readings = listen(device.port, device, 60.0, on_the_last_place)
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=120)
        assert (process.returncode, out) == (0, "")
    assert "3 rests in 1 round; 8 true parameters" in err
    assert "frames sent" in err.splitlines()[-1]
    values = read_truth(files["truth"], arm)
    departing = {n for n, v in values.items() if v != arm.parameters[n].nominal}
    assert departing == {*(f"joint_{k}.offset" for k in range(1, 7)), "joint_4.z", "tip.y"}
    check_landmarks(folder, arm, values, readings)
    check_trajectory(folder / "path.csv", arm, values, readings)


def on_the_last_place(readings: list) -> bool:
    """Two rests and the ways to the last one take 0.8 s of the arm's time."""
    return bool(readings) and readings[-1].time - readings[0].time > 0.9


def check_landmarks(folder: Path, arm: ArmModel, values: dict, readings: list) -> None:
    """The true arm's tip was on A first, and on C in the end."""
    _, tip = arm.forward(angles(readings)[[0, -1]], values)
    labels = [{"placement": "P1", "landmark": mark} for mark in "AC"]
    np.testing.assert_allclose(tip, true_landmarks(folder, labels), atol=2e-4)


def check_trajectory(file: Path, arm: ArmModel, values: dict, readings: list) -> None:
    """Its rows are the true poses at the readings' times."""
    with file.open(newline="") as opened:
        rows = list(csv.DictReader(opened))
    time = np.array([float(row["time"]) for row in rows])
    np.testing.assert_allclose(np.diff(time), 1 / 768, atol=2e-6)
    true = np.array([[float(row[joint]) for joint in arm.joints] for row in rows])
    at = np.searchsorted(time, [each.time - 1e-4 for each in readings])
    assert np.abs(wrap(angles(readings) - true[at])).max() < 1.2e-4
    some = slice(None, None, 50)
    pose = np.array([[float(row[key]) for key in "xyz"] for row in rows])
    np.testing.assert_allclose(arm.forward(true[some], values)[1], pose[some], atol=1e-9)
    visited = [row["landmark"] for row in rows if row["landmark"]]
    assert list(dict.fromkeys(visited)) == ["A", "B", "C"]
    assert {row["placement"] for row in rows} == {"P1", ""}


def test_it_ends_after_its_time_and_on_ctrl_c(suta_urdf: Path) -> None:
    arguments = (
        suta_urdf,
        "--tip",
        "tip",
        "--motion",
        "still",
        "--format",
        "lines",
        "--unit",
        "deg",
    )
    with emulating(*arguments) as endless:
        port = first_line(endless)
        assert Path(port).exists()
        # A port that is held is nobody else's: one that has ended would give its name away.
        with emulating(*arguments, "--seconds", "0.3", "--start", "now") as timed:
            assert first_line(timed) != port
            timed.communicate(timeout=120)
            assert timed.returncode == 0
        endless.send_signal(signal.SIGINT)
        _, err = endless.communicate(timeout=120)
        assert endless.returncode == 130
        assert "interrupted" in err
        assert "Traceback" not in err


def test_a_truth_that_was_written_can_be_read_again(
    tmp_path: Path, suta_urdf: Path, arm: ArmModel, capsys: Capture
) -> None:
    rows = "".join(
        f"  {name}: {{value_{'mm' if unit == 'm' else 'deg'}: {value * scale!r}}}\n"
        for name, value in TRUTH.items()
        for unit in [arm.parameters[name].unit]
        for scale in [1e3 if unit == "m" else 180 / np.pi]
    )
    (tmp_path / "truth.yaml").write_text("simulated: true\nparameters:\n" + rows)
    out = tmp_path / "again.yaml"
    common = (suta_urdf, "--tip", "tip", "--seconds", 0.05, "--start", "now")
    assert cli("emulate", *common, "--truth", tmp_path / "truth.yaml", "--truth-out", out) == 0
    found = read_truth(out, arm)
    for name, parameter in arm.parameters.items():
        assert found[name] == pytest.approx(TRUTH.get(name, parameter.nominal), abs=1e-12)
    captured = capsys.readouterr()
    assert captured.out.count("\n") == 1
    assert captured.out.startswith("/dev/")


def test_an_empty_truth_is_the_nominal_arm(tmp_path: Path, arm: ArmModel) -> None:
    file = tmp_path / "truth.yaml"
    file.write_text("simulated: true\nparameters: {}\n")
    assert read_truth(file, arm) == {n: p.nominal for n, p in arm.parameters.items()}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--faults", "stal=1"], "--faults: found 'stal=1'"),
        (["--faults", "error=joint_9:1@2"], "no joint 'joint_9'"),
        (["--faults", "disconnect=1@2"], "expected --link PATH"),
        (["--signs", "1,1"], "2 signs; expected 6"),
        (["--signs", "1,2,1,1,1,1"], "--signs: found"),
        (["--unit", "deg"], "22 bits"),
        (["--posture", "joint_8=3"], "no joint 'joint_8'"),
        (["--point", "F1=1,2,3"], "--motion pivot"),
        (["--placement", P1], "--placement without --script"),
        (["--motion", "pivot", "--point", "F1=9000,0,0"], "out of the arm's reach"),
        (["--motion", "pivot", "--csv", "x.csv"], "expected --motion trajectory"),
        (["--csv", "nowhere.csv"], "nowhere.csv: found no such file"),
        (["--truth", "nowhere.yaml"], "nowhere.yaml: found no such file"),
        (["--script", "nowhere.yaml"], "nowhere.yaml: found no such file"),
        (["--rate", "0"], "rate"),
        (["--trajectory-out", "/dev/null/x.csv"], "no folder"),
    ],
)
def test_bad_usage_is_one_line(suta_urdf: Path, arguments: list[str], message: str) -> None:
    assert message in refused("emulate", suta_urdf, "--tip", "tip", "--seconds", 0.01, *arguments)


@pytest.mark.parametrize(
    ("change", "arguments", "message"),
    [
        ("artefact: artefact.yaml, ", ["--placement", P1], "found no artefact in the job"),
        ("", ["--placement", "P1=1"], "--placement: found 'P1=1'; expected LABEL=x,y,z"),
        ("", ["--placement", P1, "--sequence", "A,Z"], "no landmark 'Z'"),
        ("", ["--placement", P1, "--motion", "still"], "--script together with --motion"),
        ("", ["--placement", "P1=9000,0,0"], "landmark 'A' of placement 'P1' out of"),
        ("observations", [], "neither a job nor a simulation"),
        ("", ["--placement", P1, "--truth", "TRUTH"], "a parameter that the arm does not have"),
    ],
)
def test_scripts_that_cannot_be_played_are_one_line(
    job: Path, suta_urdf: Path, change: str, arguments: list[str], message: str
) -> None:
    job.write_text(JOB.replace(change, "x" if change == "observations" else "") if change else JOB)
    truth = job.parent / "truth.yaml"
    truth.write_text("parameters:\n  joint_9.offset: {value_deg: 1}\n")
    arguments = [str(truth) if each == "TRUTH" else each for each in arguments]
    assert message in refused("emulate", suta_urdf, "--script", job, "--seconds", 0.01, *arguments)


def test_a_simulation_says_everything_itself(
    repository: Path, suta_urdf: Path, capsys: Capture
) -> None:
    script = repository / "data/suta/simulation.yaml"
    common = (suta_urdf, "--script", script, "--seconds", 0.02, "--start", "now")
    assert cli("emulate", *common, "--set", "validation", "--placement", "V2", "--repeats", 1) == 0
    assert "15 rests in 1 round; 37 true parameters" in capsys.readouterr().err
    assert cli("emulate", *common, "--set", "fixed_point", "--directions", 4) == 0
    assert "4 rests in 1 round" in capsys.readouterr().err
    assert "calibration, validation, fixed_point" in refused("emulate", *common, "--set", "nothing")
    assert "one of P1, P2" in refused("emulate", *common, "--placement", "V2")


def test_a_placement_without_a_pose_is_found_within_reach(
    job: Path, suta_urdf: Path, capsys: Capture
) -> None:
    texts = []
    for out in (job.parent / "one.yaml", job.parent / "two.yaml"):
        common = ("--script", job, "--seconds", 0.02, "--start", "now", "--truth-out", out)
        assert cli("emulate", suta_urdf, *common, "--placement", "P1", "--placement", "B2") == 0
        assert "6 rests in 2 rounds" in capsys.readouterr().err
        texts.append(out.read_text())
    assert texts[0] == texts[1]
    poses = yaml.safe_load(texts[0])["placements"]
    assert poses.keys() == {"P1", "B2"}
    assert poses["P1"] != poses["B2"]
    assert all(pose["rotation_rpy_deg"][:2] == [0, 0] for pose in poses.values())
    assert all(pose["position_mm"][2] >= 0 for pose in poses.values())


def test_help_lists_every_fault() -> None:
    from suta_calib.emulation.faults import WORDS

    out = printed("emulate", "--help")
    assert all(word in out for word in WORDS)
