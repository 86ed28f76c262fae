"""``suta-calib measure`` on an emulated arm behind a real pseudo-terminal."""

from __future__ import annotations

import json
import os
import pty

import numpy as np
import pytest
from cli_job import Capture, cli, refused
from measuring_bench import SECONDS, Bench

from suta_calib.acquisition.guided import Keyboard
from suta_calib.emulation import EmulatedArm, Still, sweep
from suta_calib.geometry.numbers import wrap
from suta_calib.terms import FixedPoint


def test_unattended_it_writes_what_the_arm_truly_did(bench: Bench, capsys: Capture) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    names, raw = "O,M1", bench.folder / "raw.parquet"
    emulation = bench.emulation(bench.stops(names, rest=0.9))
    # However long this process and the one at the port wait for their turn on a busy machine.
    with EmulatedArm(emulation, patient=True) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        more = ("--placement", "P1", "--sequence", names, "--yes", "--json", "--raw", raw)
        assert cli(*bench.command(*more)) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert found["status"] == "complete"
    assert found["missing"] == []
    assert "no losses" in found["happened"][0]
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
    assert "existing samples" in refused(*bench.command("--placement", "P1", "--yes"))
    assert (bench.folder / "calibration/P1_1.csv").read_bytes() == before


FAULTS = {
    "short": (SECONDS, 1.6, "corrupt=0.01,burst=0.1@0.5,stall=0.6@2.2,disconnect=0.4@4.3"),
    "full": (2.0, 5.0, "corrupt=0.01,burst=0.5@1,stall=2@6,disconnect=1.5@12,error=joint_3:0.2@18"),
}


@pytest.mark.parametrize("size", ["short", pytest.param("full", marks=pytest.mark.slow)])
def test_it_survives_a_bad_cable_and_says_what_happened(
    bench: Bench, capsys: Capture, size: str
) -> None:
    seconds, rest, faults = FAULTS[size]
    names = "O,M1,L1" if size == "short" else "O,M1,L1,S1"
    emulation = bench.emulation(bench.stops(names, rest), faults)
    # Faults and rests by one clock: it does not wait on the first place.
    with EmulatedArm(emulation, patient=True, gated=False) as emulator:
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
        assert "error flag set: joint_3" in out


def test_a_raised_error_flag_rejects_and_is_told_by_joint(bench: Bench, capsys: Capture) -> None:
    emulation = bench.emulation(Still(bench.postures["O"]), "error=joint_3:3600@0.3")
    with EmulatedArm(emulation) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        more = ("--placement", "P1", "--yes", "--patience", 1)
        assert cli(*bench.command(*more, seconds=1)) == 1
    out = capsys.readouterr().out
    assert "rejected: error flag of joint_3" in out
    assert "error flag set: joint_3" in out
    assert "missing: O, M1" in out
    assert not (bench.folder / "calibration").exists()


def test_pivoting_is_sampled_while_it_moves(bench: Bench, capsys: Capture) -> None:
    # It moves for as long as a busy computer takes until it believes what it reads.
    emulation = bench.emulation(sweep(bench.arm, bench.postures["O"], slowest=0.5, duration=60.0))
    with EmulatedArm(emulation, patient=True) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        more = ("--point", "F1", "--continuous", 1.2, "--every", 0.05)
        assert cli(*bench.command(*more)) == 0
    capsys.readouterr()
    samples = bench.samples("fixed_point/F1_1.csv", FixedPoint.columns)
    assert set(samples.labels["point"]) == {"F1"}
    assert 15 <= len(samples) <= 26
    # Every sample is a posture the arm was truly in, all joints at one moment: one of the
    # trajectory, or one on the way to the next if the computer was busy.
    true = emulator.trajectory.q
    way = np.diff(true, axis=0)
    for q in samples.q:
        ahead = wrap(q - true[:-1])
        part = np.sum(ahead * way, axis=1) / np.maximum(np.sum(way**2, axis=1), 1e-300)
        off = ahead - np.clip(part, 0.0, 1.0)[:, None] * way
        assert np.abs(off).max(axis=1).min() < 5e-4


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
        (["--placement", "P1"], "joints: found the joints joint_1, elbow"),
        (["--placement", "P1", "--device", "none.yaml"], "none.yaml: found no such file"),
        (["--placement", "P1", "--urdf", "none.urdf"], "none.urdf"),
    ],
)
def test_bad_usage_is_one_line(bench: Bench, arguments: list[str], said: str) -> None:
    device = bench.folder / "device.yaml"
    device.write_text(
        "port: /dev/does-not-exist\njoints: [{name: joint_1}, {name: elbow}]\n", encoding="utf-8"
    )
    err = refused(*bench.command("--yes", *arguments))
    assert said in err
    assert not (bench.folder / "calibration").exists()


def test_a_missing_port_is_one_line(bench: Bench) -> None:
    joints = ", ".join(f"{{name: {name}}}" for name in bench.arm.joints)
    device = bench.folder / "device.yaml"
    device.write_text(f"port: /dev/does-not-exist\njoints: [{joints}]\n", encoding="utf-8")
    err = refused(*bench.command("--placement", "P1", "--yes"))
    assert "/dev/does-not-exist" in err


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
