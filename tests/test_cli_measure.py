"""``suta-calib measure`` on an emulated arm behind a real pseudo-terminal."""

from __future__ import annotations

import json
import os
import pty
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_job import cli
from device_stand_in import postures_on

from suta_calib.acquisition.averaging import wrap
from suta_calib.acquisition.keyboard import Keyboard
from suta_calib.device.description import DeviceSpec, JointSpec
from suta_calib.emulation import EmulatedArm, Emulation, Faults, Still, Stops
from suta_calib.emulation.motion import Motion, continuous
from suta_calib.geometry import FloatArray
from suta_calib.job import joint_ranges
from suta_calib.measurements import Samples, read_artefact, read_samples
from suta_calib.model.arm import ArmModel
from suta_calib.simulation.noise import full_circle
from suta_calib.terms import FixedPoint, PairwiseDistance

NOISE = 1.7e-5
SECONDS = 0.4


@dataclass(frozen=True)
class Bench:
    """A job without samples, and where its arm rests on each landmark."""

    job: Path
    arm: ArmModel
    postures: dict[str, FloatArray]

    @property
    def folder(self) -> Path:
        return self.job.parent

    def emulation(self, motion: Motion, faults: str = "", joints: Sequence[str] = ()) -> Emulation:
        specs = tuple(JointSpec(name, 1) for name in joints or self.arm.joints)
        spec = DeviceSpec(Path("device.yaml"), "", 921600, "frames", "counts", 1 << 22, specs)
        return Emulation(spec, motion, noise=NOISE, faults=Faults.parse(faults))

    def stops(self, names: str, rest: float, move: float = 0.4) -> Stops:
        each = [self.postures[name] for name in names.split(",")]
        where = continuous(np.array(each), full_circle(self.arm))
        labels = tuple({"landmark": name} for name in names.split(","))
        return Stops(where, labels, rest, move, (len(labels) - 1,))

    def command(self, *more: object, seconds: float = SECONDS) -> list[str]:
        device = ("--device", self.folder / "device.yaml", "--seconds", seconds)
        return [str(each) for each in ("measure", self.job, *device, *more)]

    def samples(self, name: str = "calibration/P1_1.csv", columns: Any = None) -> Samples:
        columns = columns or PairwiseDistance.columns
        return read_samples([self.folder / name], joint_ranges(self.arm), columns)

    def check(self, samples: Samples) -> None:
        """The averages are those of the landmarks, to the noise of an average."""
        for label, q in zip(samples.labels["landmark"], samples.q, strict=True):
            assert np.abs(wrap(q - self.postures[label])).max() < 8e-6, label


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Bench:
    folder = tmp_path_factory.mktemp("job")
    shutil.copy(repository / "urdf" / "suta.urdf", folder / "arm.urdf")
    shutil.copy(repository / "data" / "suta" / "artefact.yaml", folder)
    (folder / "calibration.yaml").write_text(
        "arm: {urdf: arm.urdf, tip: tip}\n"
        "parameters: [{select: ['joint_*.offset'], bound_deg: 15}]\n"
        "observations:\n"
        "  - {kind: pairwise_distance, artefact: artefact.yaml, samples: 'calibration/*.csv'}\n"
        "  - {kind: fixed_point, samples: 'fixed_point/*.csv'}\n",
        encoding="utf-8",
    )
    arm = ArmModel.from_urdf(folder / "arm.urdf", "tip")
    postures = postures_on(arm, read_artefact(folder / "artefact.yaml"))
    return Bench(folder / "calibration.yaml", arm, postures)


@pytest.fixture
def bench(made: Bench, tmp_path: Path) -> Bench:
    """A folder of its own for each test."""
    shutil.copytree(made.folder, tmp_path / "job")
    return Bench(tmp_path / "job" / "calibration.yaml", made.arm, made.postures)


def test_unattended_it_writes_what_the_arm_truly_did(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    names, raw = "O,M1", bench.folder / "raw.parquet"
    emulation = bench.emulation(bench.stops(names, rest=0.9))
    with EmulatedArm(emulation) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        more = ("--placement", "P1", "--sequence", names, "--yes", "--json", "--raw", raw)
        assert cli(*bench.command(*more)) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert found["status"] == "complete"
    assert found["missing"] == []
    assert "nothing lost" in found["happened"][0]
    for name in names.split(","):
        assert f"{name}: recorded" in err
    assert "distances, measured - certified: to O" in err
    samples = bench.samples()
    assert samples.labels["landmark"].tolist() == names.split(",")
    assert samples.labels["placement"].tolist() == ["P1"] * 2
    bench.check(samples)
    table = parquet.read_table(raw)
    assert table.column_names[:3] == ["sequence", "time", "arrival"]
    assert table.num_rows > 768
    assert np.all(np.diff(table["sequence"].to_numpy()) == 1)
    # The same once more is refused; nothing that was measured is overwritten.
    before = (bench.folder / "calibration/P1_1.csv").read_bytes()
    assert cli(*bench.command("--placement", "P1", "--yes")) == 2
    assert "already there" in capsys.readouterr().err
    assert (bench.folder / "calibration/P1_1.csv").read_bytes() == before


FAULTS = {
    "short": (SECONDS, 1.6, "corrupt=0.01,burst=0.1@0.5,stall=0.6@2.2,disconnect=0.4@4.3"),
    "full": (2.0, 5.0, "corrupt=0.01,burst=0.5@1,stall=2@6,disconnect=1.5@12,error=joint_3:0.2@18"),
}


@pytest.mark.parametrize("size", ["short", pytest.param("full", marks=pytest.mark.slow)])
def test_it_survives_a_bad_cable_and_says_what_happened(
    bench: Bench, capsys: pytest.CaptureFixture[str], size: str
) -> None:
    seconds, rest, faults = FAULTS[size]
    names = "O,M1,L1" if size == "short" else "O,M1,L1,S1"
    emulation = bench.emulation(bench.stops(names, rest), faults)
    with EmulatedArm(emulation) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        more = ("--placement", "P1", "--sequence", names, "--yes", "--patience", 20)
        assert cli(*bench.command(*more, seconds=seconds)) == 0
    out = capsys.readouterr().out
    samples = bench.samples()
    assert samples.labels["landmark"].tolist() == names.split(",")
    bench.check(samples)
    for said in ("connected again", "frames with a wrong CRC", "lost frames", "stream paused"):
        assert said in out
    if size == "full":
        assert "rejected: error flag of joint_3" in out
        assert "error flag raised: joint_3" in out


def test_a_raised_error_flag_rejects_and_is_told_by_joint(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    emulation = bench.emulation(Still(bench.postures["O"]), "error=joint_3:3600@0.3")
    with EmulatedArm(emulation) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        more = ("--placement", "P1", "--yes", "--patience", 1)
        assert cli(*bench.command(*more, seconds=1)) == 1
    out = capsys.readouterr().out
    assert "rejected: error flag of joint_3" in out
    assert "error flag raised: joint_3" in out
    assert "missing: O, M1" in out
    assert not (bench.folder / "calibration").exists()


def test_pivoting_is_sampled_while_it_moves(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    emulation = bench.emulation(bench.stops("O,M1,L1,S1", rest=0.01, move=0.5))
    with EmulatedArm(emulation) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        more = ("--point", "F1", "--continuous", 1.2, "--every", 0.05)
        assert cli(*bench.command(*more)) == 0
    capsys.readouterr()
    samples = bench.samples("fixed_point/F1_1.csv", FixedPoint.columns)
    assert set(samples.labels["point"]) == {"F1"}
    assert 15 <= len(samples) <= 26
    # Every sample is a posture the arm was truly in, all joints at one moment.
    true = emulator.trajectory.q
    for q in samples.q:
        assert np.abs(wrap(true - q)).max(axis=1).min() < 5e-4


def waited_for(process: subprocess.Popen[str], text: str) -> str:
    """Read what a process prints up to a line with this text in it."""
    assert process.stdout is not None
    said = ""
    for line in process.stdout:
        said += line
        if text in line:
            return said
    raise AssertionError(f"no {text!r} in:\n{said}")


def started(command: Sequence[str], **more: Any) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "suta_calib", *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        **more,
    )


def test_prompts_without_a_terminal(bench: Bench) -> None:
    emulation = bench.emulation(Still(bench.postures["O"]))
    with EmulatedArm(emulation) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        command = bench.command("--placement", "P1", "--sequence", "O,M1,L1")
        process = started(command, stdin=subprocess.PIPE)
        assert process.stdin is not None

        def answer(key: str) -> None:
            process.stdin.write(f"{key}\n")  # type: ignore[union-attr]
            process.stdin.flush()  # type: ignore[union-attr]

        waited_for(process, "Bring the tip to O (1 of 3)")
        answer("")
        waited_for(process, "Enter keeps it")
        answer("")
        waited_for(process, "Bring the tip to M1 (2 of 3)")
        assert bench.samples().labels["landmark"].tolist() == ["O"]
        answer("s")
        waited_for(process, "Bring the tip to L1 (3 of 3)")
        out, _ = process.communicate("q\n", timeout=20)
        assert process.returncode == 0, out
        assert "1 samples in" in out
        assert "missing: M1, L1" in out
    bench.check(bench.samples())


def test_ctrl_c_leaves_what_was_confirmed(bench: Bench) -> None:
    emulation = bench.emulation(Still(bench.postures["O"]))
    with EmulatedArm(emulation) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        process = started(bench.command("--placement", "P1", "--yes"))
        waited_for(process, "O: recorded")
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=20)
        assert process.returncode == 130
        assert "1 samples in" in out
        assert "Traceback" not in out
    assert len(bench.samples()) == 1


@pytest.mark.parametrize("kills", [1, pytest.param(10, marks=pytest.mark.slow)])
def test_killed_at_any_moment_nothing_confirmed_is_lost(bench: Bench, kills: int) -> None:
    names = list(bench.postures)
    moments = random.Random(4)
    command = bench.command("--placement", "P1", "--yes", seconds=0.2)
    for killed in range(kills):
        done = recorded(bench)
        if len(done) == len(names):
            break
        # The arm rests where it was left when the next attempt begins.
        left = names[max(0, len(done) - 1) :] if killed else names
        if killed:
            command = bench.command("--placement", "P1", "--yes", "--resume", seconds=0.2)
        with EmulatedArm(bench.emulation(bench.stops(",".join(left), 0.6, 0.25))) as emulator:
            emulator.write_device(bench.folder / "device.yaml")
            process = started(command)
            said = waited_for(process, "recorded")
            time.sleep(moments.uniform(0.0, 1.5))
            process.send_signal(signal.SIGKILL)
            said += process.communicate(timeout=20)[0]
        confirmed = [n for n in names if f"{n}: recorded" in said]
        now = recorded(bench)
        assert now[: len(done)] == done
        assert set(confirmed) <= set(now)
        assert now == names[: len(now)]
        bench.check(bench.samples())
    last = recorded(bench)[-1]
    sequence = f"{','.join(names[: len(recorded(bench)) + 1])}"
    left = names[names.index(last) : names.index(last) + 2]
    with EmulatedArm(bench.emulation(bench.stops(",".join(left), 0.6, 0.25))) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        more = ("--placement", "P1", "--yes", "--resume", "--sequence", sequence)
        assert cli(*bench.command(*more, seconds=0.2)) == 0
    assert recorded(bench) == sequence.split(",")
    bench.check(bench.samples())


def recorded(bench: Bench) -> list[str]:
    if not (bench.folder / "calibration/P1_1.csv").exists():
        return []
    return [str(label) for label in bench.samples().labels["landmark"]]


# ── Bad input: one line, exit 2 ────────────────────────────────────────────────────────────────
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "one of --placement LABEL, --point LABEL and --free"),
        (["--placement", "P1", "--free"], "one of --placement"),
        (["--placement", "P1", "--continuous", "3"], "--continuous with --placement"),
        (["--point", "F1", "--sequence", "O"], "--sequence without --placement"),
        (["--placement", "P/1"], "--placement: found 'P/1'"),
        (["--placement", "P1", "--sequence", "O,Q"], "no landmark 'Q'"),
        (["--placement", "P1", "--observation", "7"], "--observation: found '7'"),
        (["--placement", "P1", "--observation", "fixed_point"], "use --point"),
        (["--placement", "P1"], "joints: found joints joint_1, elbow"),
        (["--placement", "P1", "--device", "none.yaml"], "none.yaml: found no such file"),
        (["--placement", "P1", "--urdf", "none.urdf"], "none.urdf"),
    ],
)
def test_bad_usage_is_one_line(
    bench: Bench, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    device = bench.folder / "device.yaml"
    device.write_text(
        "port: /dev/does-not-exist\njoints: [{name: joint_1}, {name: elbow}]\n", encoding="utf-8"
    )
    assert cli(*bench.command("--yes", *arguments)) == 2
    out, err = capsys.readouterr()
    assert said in err
    assert out == ""
    assert err.count("\n") == 1
    assert not (bench.folder / "calibration").exists()


def test_a_missing_port_is_one_line(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    joints = ", ".join(f"{{name: {name}}}" for name in bench.arm.joints)
    device = bench.folder / "device.yaml"
    device.write_text(f"port: /dev/does-not-exist\njoints: [{joints}]\n", encoding="utf-8")
    assert cli(*bench.command("--placement", "P1", "--yes")) == 2
    err = capsys.readouterr().err
    assert "/dev/does-not-exist" in err
    assert err.count("\n") == 1


# ── Keys ───────────────────────────────────────────────────────────────────────────────────────
def test_keys_from_a_pipe_are_lines() -> None:
    reader, writer = os.pipe()
    with Keyboard(reader) as keyboard:
        assert keyboard.key() is None
        os.write(writer, b"\nRedo\n  \nq")
        assert [keyboard.key() for _ in range(4)] == ["\n", "r", "\n", None]
        os.close(writer)
        assert [keyboard.key() for _ in range(3)] == ["q", "q", "q"]
    os.close(reader)


def test_keys_of_a_terminal_count_at_once() -> None:
    master, slave = pty.openpty()
    with Keyboard(slave) as keyboard:
        assert keyboard.key() is None
        os.write(master, b"S\r")
        keys = [keyboard.key() for _ in range(3)]
    assert keys == ["s", "\n", None]
    os.close(master)
    os.close(slave)
