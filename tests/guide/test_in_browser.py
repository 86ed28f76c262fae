"""A whole measurement on the page in a browser: one landmark is wrong, and one cable is pulled."""

from __future__ import annotations

import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chromium import PROGRAM, WITHOUT_WEBGL, Chromium

from suta_calib.emulation import Faults, Stops
from suta_calib.emulation.emulated import EmulationOptions, emulated_device
from suta_calib.emulation.emulated_arm import EmulatedArm
from suta_calib.measurements import read_artefact, read_csv_table

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium"),
]
POSTURE = "joint_1=15,joint_2=175,joint_3=160,joint_4=110,joint_5=-90,joint_6=-125"


@contextmanager
def arm_that_errs(job: Path, repository: Path) -> Iterator[Path]:
    """Fifteen landmarks: M6 is wrong at first; at M2 the cable is pulled; after L1 it waits."""
    names = list(read_artefact(job.parent / "artefact.yaml").landmarks)
    options = EmulationOptions(
        repository / "urdf" / "suta.urdf",
        script=job,
        errors_seed=2,
        placements={"P1": None},
        posture=POSTURE,
    )
    emulation = emulated_device(options).emulation
    assert isinstance(emulation.motion, Stops)
    on = dict(zip(names, emulation.motion.posture, strict=True))
    away, wrong = on["O"] + 0.1, on["M6"] + np.array([0.0, 0.06, 0.0, 0.0, 0.0, 0.0])
    first = [away, on["O"], on["M1"], *[on["M2"]] * 5, on["M3"], on["M4"], on["M5"]]
    first += [*[wrong] * 5, on["M6"], on["L1"]]
    second = [away, *(on[name] for name in names[names.index("L2") :])]
    motion = Stops(
        np.array([*first, *second]),
        ({},) * len(first + second),
        rest=1.6,
        move=0.7,
        rounds=(len(first) - 1, len(first + second) - 1),
    )
    faults = Faults.parse("disconnect=4@9")
    with EmulatedArm(replace(emulation, motion=motion, faults=faults), patient=True) as arm:
        yield arm.write_device(job.parent / "device.yaml")


@contextmanager
def guide(job: Path, device: Path, *more: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The command, and the address that it prints."""
    command = [sys.executable, "-m", "suta_calib", "guide", str(job), "--device", str(device)]
    command += ["--port", "0", "--no-open", "--seconds", "0.5", *more]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("Open http://127.0.0.1:"), line
        yield line.split()[1], process
    finally:
        process.terminate()
        process.communicate(timeout=20)


def click(page: Chromium, button: str) -> None:
    page.wait(f"!!document.querySelector('[data-do={button}]')")
    page.evaluate(f"document.querySelector('[data-do={button}]').click()")


def landmarks(job: Path) -> list[str]:
    table = read_csv_table(job.parent / "calibration" / "P1_1.csv")
    return [str(name) for name in table.labels("landmark", "a label column")]


TAKEN = "document.querySelectorAll('#chips .taken').length"
DOUBTED = "document.querySelectorAll('#chips .doubted').length"
NAME = "document.getElementById('name').innerText"


def test_fifteen_landmarks(job: Path, repository: Path, tmp_path: Path) -> None:
    with arm_that_errs(job, repository) as device, Chromium(*WITHOUT_WEBGL) as page:
        with guide(job, device) as (url, process):
            page.open(url)
            page.wait(f"{NAME} === 'O'")
            # The cable is pulled out: the page says so, and goes on when it is back.
            page.wait(f"{NAME} === 'No readings'", 90)
            page.wait(f"{NAME} === 'M3'", 90)
            # A landmark that is wrong is named at once, and taken again.
            page.wait("!document.getElementById('alert').hidden", 90)
            assert "M6 does not fit" in page.text
            assert page.evaluate(DOUBTED) == 1
            click(page, "retake")
            page.wait(f"{NAME} === 'L2'", 90)
            assert page.evaluate("document.getElementById('alert').hidden")
            assert page.evaluate(DOUBTED) == 0
            assert page.evaluate(TAKEN) == 8
            page.wait("document.querySelectorAll('#parameters .bar').length > 5", 60)
            # Nothing is lost with it.
            process.send_signal(signal.SIGKILL)
            process.wait()
            page.wait("document.body.innerText.includes('has ended')")
        assert landmarks(job) == ["O", "M1", "M2", "M3", "M4", "M5", "M6", "L1"]
        with guide(job, device) as (url, _):
            page.open(url)
            page.wait(f"{NAME} === 'L2'", 90)
            assert page.evaluate(TAKEN) == 8
            page.wait("document.body.innerText.includes('P1 is complete')", 150)
            assert len(landmarks(job)) == 15
            page.wait("document.body.innerText.includes('Best next')", 120)
            for width, dark in ((1400, False), (500, True)):
                page.resize(width, 900, dark=dark)
                page.picture(tmp_path / f"{width}.png")
                assert page.evaluate("document.documentElement.scrollWidth") == width
            click(page, "finish")
            page.wait("document.querySelectorAll('#files a').length", 120)
            assert "→" in page.evaluate("document.getElementById('headline').innerText")
            report = page.evaluate("document.querySelector('#files a').href")
            with urllib.request.urlopen(report, timeout=10) as answer:
                assert b"<html" in answer.read()
            assert (job.parent / "results" / "result.json").is_file()
