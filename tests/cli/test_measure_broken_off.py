"""``suta-calib measure`` without a terminal, stopped and killed: what was confirmed stays."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import pytest
from cli_job import Capture, cli
from measuring_bench import Bench

from suta_calib.emulation import EmulatedArm, Still


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
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT} | more
    return subprocess.Popen([sys.executable, "-m", "suta_calib", *command], text=True, **pipes)


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
        out, _ = process.communicate("q\n", timeout=120)
        assert process.returncode == 0, out
        assert "1 sample in" in out
        assert "missing: M1, L1" in out
    bench.check(bench.samples())


@pytest.mark.parametrize(
    "how", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_broken_off_what_was_confirmed_stays_and_is_told(bench: Bench, how: signal.Signals) -> None:
    emulation = bench.emulation(Still(bench.postures["O"]))
    with EmulatedArm(emulation) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        command = bench.command("--placement", "P1", "--sequence", "O,M1", "--yes", "--json")
        process = started(command, stderr=subprocess.PIPE)
        assert process.stderr is not None
        while "O: recorded" not in process.stderr.readline():
            assert process.poll() is None
        process.send_signal(how)
        out, err = process.communicate(timeout=120)
    assert process.returncode == 128 + how
    found = json.loads(out)
    assert (found["status"], found["samples"], found["missing"]) == ("interrupted", 1, ["M1"])
    assert "interrupted" in err
    assert "1 sample in" in err
    assert "Traceback" not in err
    assert len(bench.samples()) == 1


@pytest.mark.parametrize("option", ["--seconds", "--patience", "--tremble-deg"])
def test_a_number_that_is_none_is_refused(bench: Bench, capsys: Capture, option: str) -> None:
    (bench.folder / "device.yaml").write_text("port: none\njoints: [{name: a}]\n")
    assert cli(*bench.command("--placement", "P1", "--yes", option, "nan")) == 2
    assert f"Invalid value for '{option}': found 'nan'" in capsys.readouterr().err


# Of it a busy computer takes its time until it believes the readings to be fresh.
REST = 1.2


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
        hand = bench.emulation(bench.stops(",".join(left), REST, 0.25))
        with EmulatedArm(hand, patient=True) as emulator:
            emulator.write_device(bench.folder / "device.yaml")
            process = started(command)
            said = waited_for(process, "recorded")
            time.sleep(moments.uniform(0.0, 1.5))
            process.send_signal(signal.SIGKILL)
            said += process.communicate(timeout=120)[0]
        confirmed = [n for n in names if f"{n}: recorded" in said]
        now = recorded(bench)
        assert now[: len(done)] == done
        assert set(confirmed) <= set(now)
        assert now == names[: len(now)]
        bench.check(bench.samples())
    last = recorded(bench)[-1]
    sequence = f"{','.join(names[: len(recorded(bench)) + 1])}"
    left = names[names.index(last) : names.index(last) + 2]
    hand = bench.emulation(bench.stops(",".join(left), REST, 0.25))
    with EmulatedArm(hand, patient=True) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        more = ("--placement", "P1", "--yes", "--resume", "--sequence", sequence)
        assert cli(*bench.command(*more, seconds=0.2)) == 0
    assert recorded(bench) == sequence.split(",")
    bench.check(bench.samples())


def recorded(bench: Bench) -> list[str]:
    if not (bench.folder / "calibration/P1_1.csv").exists():
        return []
    return [str(label) for label in bench.samples().labels["landmark"]]
