from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from device_streams import PtyDevice, device

from suta_calib.cli._app import run
from suta_calib.cli._process import INTERRUPTED
from suta_calib.device import Bus, Reading
from suta_calib.device.diagnosis import remarks
from suta_calib.device.formats import encode_frame
from suta_calib.device.monitoring import Monitor, Snapshot
from suta_calib.device.reading import Statistics
from suta_calib.model.arm import ArmModel

JOINTS = ", ".join(f"{{name: joint_{k + 1}}}" for k in range(6))


@pytest.fixture
def arm(tmp_path: Path) -> Iterator[PtyDevice]:
    """A device on a pty, with its device.yaml beside it."""
    with PtyDevice(tmp_path / "arm") as plugged:
        (tmp_path / "device.yaml").write_text(f"port: arm\njoints: [{JOINTS}]\n")
        yield plugged


def monitor(arm: PtyDevice, *more: str) -> int:
    return run(["monitor", "--device", str(arm.link.parent / "device.yaml"), *more])


def reading(n: int, angles: list[float], error: bool = False) -> Reading:
    flags = np.array([error] + [False] * (len(angles) - 1))
    quiet = np.zeros(len(angles), dtype=bool)
    return Reading(n, n * 0.01, np.array(angles), flags, quiet, 100 + n * 0.01)


def test_noise_is_measured_on_the_circle_and_without_invalid_positions() -> None:
    watched = Monitor(device(2))
    random = np.random.default_rng(3)
    noise = random.normal(0, 1e-3, (100, 2))
    angles = np.angle(np.exp(1j * (noise + np.array([math.pi, 0.5]))))
    for n in range(100):
        watched.add([reading(n, angles[n].tolist())])
    watched.add([reading(99, [1.0, 0.5], error=True)])
    seen = watched.snapshot(100.99)
    assert seen.noise[0] == pytest.approx(noise[:, 0].std(ddof=1), rel=1e-9)
    assert seen.error.tolist() == [True, False]
    assert seen.rate == pytest.approx(101 / 0.99)


def test_only_the_last_second_counts() -> None:
    watched = Monitor(device(1))
    watched.add([reading(n, [0.0 if n < 300 else 1.0]) for n in range(600)])
    seen = watched.snapshot(100 + 5.99)
    assert seen.noise[0] == 0.0
    assert seen.rate == pytest.approx(100, abs=2)
    assert seen.clock_ppm == pytest.approx(0.0, abs=1e-6)
    assert watched.snapshot(200.0).rate == 0.0


def test_the_rate_counts_frames_with_a_damaged_word() -> None:
    watched = Monitor(device(1))
    for n in range(300):
        if n % 3:
            watched.add([reading(n, [0.0])])
        else:
            watched.note_damaged(100 + n * 0.01, n // 3 + 1)
    assert watched.snapshot(100 + 2.99).rate == pytest.approx(100, abs=2)
    assert watched.snapshot(200.0).rate == 0.0


def test_the_rate_is_of_the_time_in_which_it_was_read(
    arm: PtyDevice, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """To close a port takes time, at a socket a third of a second."""
    closed, looked = [0.0], [0.0]
    close, snapshot = Bus.close, Monitor.snapshot

    def slow(bus: Bus) -> None:
        closed[0] = closed[0] or time.perf_counter()
        close(bus)

    def noted(self: Monitor, now: float) -> Snapshot:
        looked[0] = now
        return snapshot(self, now)

    monkeypatch.setattr(Bus, "close", slow)
    monkeypatch.setattr(Monitor, "snapshot", noted)
    arm.stream()
    assert monitor(arm, "--json", "--seconds", "0.2") == 0
    assert json.loads(capsys.readouterr().out)["frames"] > 0
    assert 0.0 < looked[0] <= closed[0]


def test_before_the_first_reading_there_are_no_numbers() -> None:
    seen = Monitor(device(3)).snapshot(5.0)
    assert np.isnan(seen.angles).all()
    assert np.isnan(seen.noise).all()
    assert (seen.rate, seen.clock_ppm) == (0.0, None)


def test_remarks_name_joint_meaning_and_remedy() -> None:
    statistics = Statistics(("a", "b", "c"), frames=100, frame_crc_errors=10)
    assert remarks(Statistics(("a",), frames=9), device(1)) == []
    statistics.error_flags[0] = 25
    statistics.warning_flags[1] = 100
    statistics.joint_crc_errors[2] = 4
    said = remarks(statistics, device(3))
    for sentence, words in zip(
        said,
        (
            ["a: error", "not valid", "25 %"],
            ["b: warning", "near its limits", "100 %"],
            ["c: the CRC", "cable from this encoder"],
            ["9.1 % of frames are damaged"],
        ),
        strict=True,
    ):
        assert all(word in sentence for word in words), sentence
    (lost,) = remarks(Statistics(("a",), frames=90, lost_frames=10), device(1))
    assert "10 % of frames are missing" in lost


def test_the_object_says_everything(
    arm: PtyDevice, suta_urdf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    counts = [0, 1 << 18, 0, 0, 1 << 20, 3 << 20]
    warned = [False, True, False, False, False, False]
    arm.stream(lambda n, us: encode_frame(n, us, counts, None, warned))
    code = monitor(arm, "--json", "--seconds", "0.4", "--urdf", str(suta_urdf), "--tip", "tip")
    said = capsys.readouterr()
    assert (code, said.err) == (0, "")
    data = json.loads(said.out)
    assert data["frames"] > 50
    assert (data["lost_frames"], data["frame_crc_errors"], data["garbage_bytes"]) == (0, 0, 0)
    angles = [joint["angle_deg"] for joint in data["joints"].values()]
    assert angles == pytest.approx([0, 22.5, 0, 0, 90, -90])
    assert data["joints"]["joint_2"]["warning"]
    assert data["joints"]["joint_2"]["noise_deg"] == 0.0
    assert not data["joints"]["joint_1"]["warning"]
    _, position = ArmModel.from_urdf(suta_urdf, "tip").forward(np.deg2rad(angles))
    assert data["tip"]["position_mm"] == pytest.approx(1e3 * position)
    assert "joint_2: warning" in data["remarks"][0]


def test_numbers_beside_the_joints_are_shown(
    arm: PtyDevice, capsys: pytest.CaptureFixture[str]
) -> None:
    (arm.link.parent / "device.yaml").write_text(
        "port: arm\nformat: lines\nunit: rad\njoints: [{name: a}]\nextra_columns: [ax, ay]\n"
    )
    arm.stream(lambda *_: b"0.5,9.8125,nan\n")
    assert monitor(arm, "--seconds", "0.4") == 0
    assert "a 28.648°  ax 9.8125  ay –" in capsys.readouterr().out
    assert monitor(arm, "--json", "--seconds", "0.2") == 0
    assert json.loads(capsys.readouterr().out)["extra"] == {"ax": 9.8125, "ay": None}


def test_without_a_terminal_it_prints_lines(
    arm: PtyDevice, capsys: pytest.CaptureFixture[str]
) -> None:
    arm.stream(lambda n, us: encode_frame(n, us, [1 << 18] * 6, [n % 2 == 0] + [False] * 5))
    assert monitor(arm, "--seconds", "0.5") == 0
    first, *_, last = capsys.readouterr().out.splitlines()
    assert re.match(r"\d+\.\d frames/s  joint_1 22\.500° ERROR  joint_2 22\.500°  ", first)
    assert "joint_1: error" in last
    assert "\x1b" not in first


def test_in_a_terminal_it_draws_a_table(
    arm: PtyDevice, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    arm.stream()
    # A busy machine may hear nothing at the end, and needs more time for as much.
    for seconds in ("0.6", "2.5", "8"):
        assert monitor(arm, "--seconds", seconds) == 0
        out = capsys.readouterr().out
        if "no problem was found" in out:
            break
    assert "noise, °" in out
    assert "─" * 20 in out
    assert "no problem was found" in out


def test_an_interrupt_still_says_what_was_seen(
    arm: PtyDevice, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    original, seen = Bus.read, []

    def read(self: Bus, timeout: float = 0.1) -> list[Reading]:
        if len(seen) > 20:
            raise KeyboardInterrupt
        seen.extend(original(self, timeout))
        return seen[-1:]

    monkeypatch.setattr(Bus, "read", read)
    arm.stream()
    assert monitor(arm) == INTERRUPTED
    said = capsys.readouterr()
    assert re.search(r"^\d+ frames; 0 lost", said.out, re.MULTILINE)
    assert said.err.strip() == "suta-calib: interrupted; no incomplete files were left"


def test_silence_is_one_line(arm: PtyDevice, capsys: pytest.CaptureFixture[str]) -> None:
    for more in ((), ("--json",)):
        assert monitor(arm, "--silence", "0.1", *more) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.startswith(f"suta-calib: error: {arm.link}: no byte received")
        assert "at 921600 baud; check that the device is switched on" in said.err
        assert "device.yaml" in said.err
        assert said.err.count("\n") == 1


@pytest.mark.parametrize(
    ("edit", "more", "words"),
    [
        ("joint_6", (), ["frames of 6 joints; expected 5"]),
        ("", ("--urdf", "x.urdf"), ["--urdf", "--tip"]),
        ("", ("--base", "base_link"), ["--base without --urdf"]),
        ("joint_3", ("--urdf", "URDF", "--tip", "tip"), ["joint_3", "device.yaml"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arm: PtyDevice,
    suta_urdf: Path,
    capsys: pytest.CaptureFixture[str],
    edit: str,
    more: tuple[str, ...],
    words: list[str],
) -> None:
    path = arm.link.parent / "device.yaml"
    if edit:
        path.write_text(path.read_text().replace(f", {{name: {edit}}}", ""))
    arm.stream()
    assert monitor(arm, *(str(suta_urdf) if word == "URDF" else word for word in more)) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    for word in words:
        assert word in said.err
