"""``suta-calib track`` over a real pseudo-terminal, with an emulated arm at the other end."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import answer, cli, printed, refused
from simulated import SUTA_URDF
from swinging_arm import emulated
from tracking_scene import TRUTH, calibrated

from suta_calib.emulation import EmulatedArm, Emulation, EmulationOptions, Faults
from suta_calib.emulation.emulated import emulated_device
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.trajectory import read_trajectory

TRACK = ("track", SUTA_URDF, "--tip", "tip", "--device")


def tracked(
    emulation: Emulation, folder: Path, capsys: Any, enough: Callable[[Any, EmulatedArm], bool]
) -> tuple[Any, str, EmulatedArm]:
    """``track --json`` for as long as it takes: a busy machine needs more time for as much.

    Returns:
        Its answer, what it said on stderr, and the arm, stopped.
    """
    log = folder / "log.csv"
    for seconds in (0.8, 2.5, 8.0):
        log.unlink(missing_ok=True)
        with EmulatedArm(emulation) as emulator:
            device = emulator.write_device(folder / "device.yaml")
            command = (*TRACK, device, "--csv", log, "--seconds", seconds, "--json")
            assert cli(*command) == 0
        captured = capsys.readouterr()
        answer = json.loads(captured.out)
        if enough(answer, emulator):
            break
    return answer, captured.err, emulator


def test_json_files_and_datagrams_agree_and_are_where_the_arm_truly_is(tmp_path: Path, capsys):
    log = tmp_path / "log.csv"
    log.write_text("an earlier recording\n")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        receiver.bind(("127.0.0.1", 0))
        to = f"127.0.0.1:{receiver.getsockname()[1]}"
        with EmulatedArm(emulated()) as emulator:
            device = emulator.write_device(tmp_path / "device.yaml")
            options = ("--csv", log, "--force", "--udp", to, "--igtl", "127.0.0.1:0")
            assert cli(*TRACK, device, *options, "--seconds", 1, "--json") == 0
        receiver.setblocking(False)
        datagrams = []
        while True:
            try:
                datagrams.append(json.loads(receiver.recv(4096)))
            except BlockingIOError:
                break
    captured = capsys.readouterr()
    answer = json.loads(captured.out)
    assert captured.err.splitlines() == [f"suta-calib: {event}" for event in answer["events"]]
    assert answer["poses"]["invalid"] == 0
    count = answer["poses"]["valid"]
    assert count == answer["latency"]["count"] == answer["publishers"]["csv"]["published"]
    assert 10 < count == answer["readings"] <= emulator.played.sent
    # A port that a busy machine reads too late takes no more; nothing else may be lost.
    assert answer["stream"]["lost_frames"] <= emulator.played.unheard
    table = read_csv_table(log)
    assert len(table) == count
    assert datagrams[-1] == answer["last"]
    assert [d["sequence"] for d in datagrams] == [int(s) for s in table.columns["sequence"]]
    arm = ArmModel.from_urdf(SUTA_URDF, "tip")
    found = read_trajectory(log, arm)
    np.testing.assert_allclose(found.position, arm.forward(found.angles)[1], atol=1e-8)
    truth = emulator.trajectory
    rows = np.searchsorted(truth.time, found.time - 1e-5)
    np.testing.assert_allclose(truth.time[rows], found.time, atol=2e-6)
    np.testing.assert_allclose(found.position, arm.forward(truth.q[rows])[1], atol=2e-4)
    assert answer["last"]["valid"]


def test_uncertainty_and_tool(device: Path, tmp_path: Path, capsys):
    scene = calibrated(tmp_path)
    tool = tmp_path / "tip.json"
    tool.write_text('{"tip_mm": [0, 0, 100]}')
    command = ("track", tmp_path / "calibrated.urdf", "--tip", "tip", "--device", device)
    options = ("--result", scene.path, "--tool", tool, "--seconds", 0.6, "--json", "--rate", 50)
    assert cli(*command, *options) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["uncertainty"] == {
        "source": "covariance of the calibration",
        "parameters": list(TRUTH),
        "held": ["joint_1.offset"],
        "held_within": [],
        "tool_included": False,
    }
    assert answer["tool_mm"] == [0, 0, 100]
    assert all(0 < value < 1e-2 for value in answer["last"]["std"])
    assert answer["poses"]["valid"] < 2 + answer["readings"] / 10
    assert answer["readings"] > 20
    assert answer["notes"] == []


def test_what_was_held_and_moves_the_tip_is_streamed_and_said(device: Path, tmp_path: Path, capsys):
    scene = calibrated(tmp_path)
    drawn = {"value": scene.nominal.offered["joint_6.z"].nominal, "std": None}
    scene.result["parameters"]["joint_6.z"] = drawn
    scene.result["unidentified"].append("joint_6.z")
    within = {"parameter": "joint_6.z", "plausible": 0.06, "direction": {"joint_6.z": 1.0}}
    scene.path.write_text(json.dumps(scene.result | {"held": [within]}), encoding="utf-8")
    command = ("track", tmp_path / "calibrated.urdf", "--tip", "tip", "--device", device)
    options = ("--result", scene.path, "--seconds", 0.3)
    found = answer(*command, *options)
    assert found["uncertainty"]["held_within"] == ["joint_6.z"]
    assert np.linalg.norm(found["last"]["std"]) == pytest.approx(0.06 / np.sqrt(3.0), rel=1e-3)
    assert cli(*command, *options) == 0
    said = "from the assumed error of joint_6.z, held at nominal; valid only while the held joint_1"
    assert said in capsys.readouterr().out


def test_an_arm_that_grows_with_warmth_is_said_to_be_taken_as_cool(device: Path, tmp_path: Path):
    scene = calibrated(tmp_path)
    scene.result["parameters"]["links.expansion"] = {"value": 23e-6, "std": None, "state": "fixed"}
    scene.path.write_text(json.dumps(scene.result), encoding="utf-8")
    command = ("track", tmp_path / "calibrated.urdf", "--tip", "tip", "--device", device)
    options = ("--result", scene.path, "--seconds", 0.3)
    (note,) = answer(*command, *options)["notes"]
    assert "taken to be 20 °C, though links.expansion was estimated" in note
    assert "is 10 K warmer, each metre of it is longer or shorter by up to 0.23 mm" in note
    assert printed(*command, *options).count(note) == 1


def test_error_flags_make_poses_invalid(tmp_path: Path, capsys):
    flagged = emulated(faults=Faults.parse("error=joint_3:60@0.4"))
    answer, _, emulator = tracked(flagged, tmp_path, capsys, lambda a, _: all(a["poses"].values()))
    assert answer["poses"]["invalid"] > 0
    assert answer["stream"]["flags"]["joint_3"]["errors"] >= answer["poses"]["invalid"]
    table = read_csv_table(tmp_path / "log.csv")
    truth, time = emulator.trajectory, [float(t) for t in table.columns["time"]]
    moved = np.interp(time, truth.time, truth.motion_time)
    valid = np.array(table.columns["valid"]) == "1"
    assert moved[valid].max() < 0.4 <= moved[~valid].min() + 1e-5
    assert table.columns["valid"].count("0") == answer["poses"]["invalid"]
    assert table.columns["flags"][-1] == "joint_3:error"


def test_nothing_valid_is_exit_1(tmp_path: Path, capsys):
    with EmulatedArm(emulated(faults=Faults.parse("error=joint_1:60@0"))) as emulator:
        device = emulator.write_device(tmp_path / "device.yaml")
        assert cli(*TRACK, device, "--seconds", 0.4) == 1
    assert "no valid pose" in capsys.readouterr().err


def test_a_device_that_goes_and_comes_back_is_waited_for(tmp_path: Path, capsys):
    vanishing = emulated(faults=Faults.parse("disconnect=0.3@0.4"))

    def back(answer: Any, emulator: EmulatedArm) -> bool:
        """The last reading is one of after it came back."""
        truth, last = emulator.trajectory, answer["last"]["time"]
        return bool(np.interp(last, truth.time, truth.motion_time) > 0.7)

    answer, err, emulator = tracked(vanishing, tmp_path, capsys, back)
    assert back(answer, emulator)
    assert answer["stream"]["interruptions"] >= 1
    assert any("connected again" in event for event in answer["events"])
    assert "connected again" in err


@pytest.mark.parametrize(
    "how", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_ctrl_c_leaves_complete_files(device: Path, tmp_path: Path, how: signal.Signals):
    log = tmp_path / "log.csv"
    command = [sys.executable, "-m", "suta_calib", *map(str, TRACK), str(device)]
    process = subprocess.Popen(
        [*command, "--csv", str(log), "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    part = tmp_path / "log.csv.part"
    end = time.monotonic() + 60
    while not (part.exists() and part.stat().st_size > 5000):
        assert time.monotonic() < end
        time.sleep(0.02)
    os.kill(process.pid, how)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 128 + how
    assert err.splitlines()[-1].startswith("suta-calib: interrupted")
    answer = json.loads(out)
    assert answer["interrupted"]
    assert len(read_csv_table(log)) == answer["publishers"]["csv"]["published"]
    assert not part.exists()


def write_device(folder: Path, text: str) -> Path:
    path = folder / "device.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        ("[{name: joint_1}, {name: joint_2}]", "joints: found the joints joint_1, joint_2"),
        ("[{name: joint_1, sign: 2}]", "sign"),
    ],
)
def test_bad_devices_are_one_clear_line(tmp_path: Path, joints: str, said: str):
    device = write_device(tmp_path, f"port: {tmp_path}/none\njoints: {joints}\n")
    assert said in refused(*TRACK, device, "--csv", tmp_path / "log.csv")
    assert [file.name for file in tmp_path.iterdir()] == ["device.yaml"]


def test_a_port_that_is_not_there_leaves_no_file(tmp_path: Path):
    joints = ", ".join(f"{{name: joint_{k}}}" for k in range(1, 7))
    device = write_device(tmp_path, f"port: {tmp_path}/none\njoints: [{joints}]\n")
    assert refused(*TRACK, device, "--csv", tmp_path / "log.csv").count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == ["device.yaml"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--udp", "5005"), "expected HOST:PORT"),
        (("--igtl", "99999"), "port up to 65535"),
        (("--igtl", "somewhere"), "expected a port number"),
        (("--igtl", "0", "--igtl-name", "x" * 30), "1 to 20 ASCII characters"),
        (("--rate", "0"), "--rate"),
        (("--tool", "nothing.json"), "nothing.json: found no such file"),
        (("--result", "nothing.json"), "nothing.json: found no such file"),
        (("--csv", "/proc/none/log.csv"), "/proc"),
    ],
)
def test_bad_usage_is_one_clear_line(tmp_path: Path, options: tuple[str, ...], said: str):
    joints = ", ".join(f"{{name: joint_{k}}}" for k in range(1, 7))
    device = write_device(tmp_path, f"port: {tmp_path}/none\njoints: [{joints}]\n")
    assert said in refused(*TRACK, device, *options)


def test_no_recording_and_no_input_is_replaced_unasked(tmp_path: Path, capsys):
    joints = ", ".join(f"{{name: joint_{k}}}" for k in range(1, 7))
    device = write_device(tmp_path, f"port: {tmp_path}/none\njoints: [{joints}]\n")
    log = tmp_path / "log.csv"
    for found in (log, tmp_path / "log.csv.part"):
        found.write_text("measured\n")
        assert cli(*TRACK, device, "--csv", log) == 2
        assert (
            f"{found}: found an existing recording; expected the name of a new"
            in capsys.readouterr().err
        )
        assert found.read_text() == "measured\n"
        found.unlink()
    for inputs in (device, SUTA_URDF):
        assert cli(*TRACK, device, "--csv", inputs, "--force") == 2
        assert "found an input of the same command" in capsys.readouterr().err
    assert "found another output" in refused(*TRACK, device, "--csv", log, "--parquet", log)


def test_the_console_says_where_how_late_and_how_old(tmp_path: Path, capsys):
    with EmulatedArm(emulated(faults=Faults.parse("stall=9@0.7"))) as emulator:
        device = emulator.write_device(tmp_path / "device.yaml")
        assert cli(*TRACK, device, "--seconds", 2.5, "--stats") == 0
    text = capsys.readouterr().out
    assert re.search(r"^tip .* latency p50", text, re.MULTILINE)
    assert "position, mm" in text
    assert "p99" in text
    assert "no reading for " in text
    # How long depends on how busy the machine is, but not whether.
    assert re.search(r"Tip in the base: NO READING FOR [1-9]\.", text)


@pytest.mark.slow
def test_a_rest_on_a_point_shows_the_drift_beside_the_poses(tmp_path: Path, capsys):
    scene = calibrated(tmp_path)
    options = EmulationOptions(SUTA_URDF, tip="tip", rate=200.0, motion="still")
    points = tmp_path / "points.yaml"
    with EmulatedArm(emulated_device(options).emulation, patient=True) as emulator:
        device = emulator.write_device(tmp_path / "device.yaml")
        command = ("track", tmp_path / "calibrated.urdf", "--tip", "tip", "--device", device)
        known = ("--result", scene.path)
        place = 1e3 * np.array(answer(*command, *known, "--seconds", 0.3)["last"]["position"])
        points.write_text(f"points: {{dock: {{position_mm: {(place + 0.2).tolist()}}}}}\n")
        more = ("--recalibrate", points, "--seconds", 4)
        assert cli(*command, *known, *more, "--json") == 0
        found = json.loads(capsys.readouterr().out)
        assert cli(*command, *known, *more) == 0
    shown = capsys.readouterr().out
    assert found["recalibration"]["touches"] == 1
    assert found["publishers"]["recalibrate"] == {"touches": 1, "rests elsewhere": 0}
    assert np.linalg.norm(found["last"]["position"] - place / 1e3) < 1e-4
    assert 1e-6 < np.linalg.norm(found["last"]["recalibrated"]["shift"]) < 1e-3
    assert "Drift of the zeros by 1 touch, deg: joint_1" in shown
    assert "--recalibrate alone; expected --result" in refused(*command, "--recalibrate", points)
