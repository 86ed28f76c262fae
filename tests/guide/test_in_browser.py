"""A whole measurement on the page in a browser: one landmark is wrong, and one cable is pulled."""

from __future__ import annotations

import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from chromium import LONGEST, PROGRAM, WITHOUT_WEBGL, Chromium
from device_stand_in import postures_on
from led_arm import LedArm

from suta_calib.measurements import read_artefact, read_csv_table
from suta_calib.model.arm import ArmModel

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium"),
]


@pytest.fixture
def arm(job: Path, repository: Path) -> Iterator[LedArm]:
    """The SUTA, which a test leads to the landmarks."""
    arm = ArmModel.from_urdf(repository / "urdf" / "suta.urdf", "tip")
    with LedArm(
        arm, postures_on(arm, read_artefact(job.parent / "artefact.yaml")), job.parent
    ) as a:
        yield a


@contextmanager
def guide(job: Path, device: Path, *more: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The command, and the address that it prints."""
    command = [sys.executable, "-m", "suta_calib", "guide", str(job), "--device", str(device)]
    command += ["--port", "0", "--no-open", "--seconds", "0.5", *more]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        url = next(line.split()[1] for line in process.stdout if line.startswith("Open http:"))
        yield url, process
    finally:
        process.terminate()
        process.communicate(timeout=LONGEST)


def click(page: Chromium, button: str) -> None:
    page.wait(f"!!document.querySelector('[data-do={button}]')")
    page.evaluate(f"document.querySelector('[data-do={button}]').click()")


def landmarks(job: Path) -> list[str]:
    table = read_csv_table(job.parent / "calibration" / "P1_1.csv")
    return [str(name) for name in table.labels("landmark", "a label column")]


TAKEN = "document.querySelectorAll('#chips .taken').length"
DOUBTED = "document.querySelectorAll('#chips .doubted').length"
NAME = "document.getElementById('name').innerText"


def rested(page: Chromium) -> None:
    """The arm rests, and has been heard for long enough."""
    page.wait("document.getElementById('doing').innerText.startsWith('Go to')")


def measured(page: Chromium, arm: LedArm, *names: str) -> None:
    """One landmark after the other."""
    for name in names:
        count = page.evaluate(TAKEN)
        arm.go(name)
        page.wait(f"{TAKEN} === {count + 1}")


def test_fifteen_landmarks(job: Path, arm: LedArm, tmp_path: Path) -> None:
    first = ["O", "M1", "M2", "M3", "M4", "M5", "M6", "L1"]
    with Chromium(*WITHOUT_WEBGL) as page:
        with guide(job, arm.device) as (url, process):
            page.open(url)
            page.wait(f"{NAME} === 'O'")
            rested(page)
            assert "This browser shows no 3-D" in page.text
            measured(page, arm, "O", "M1", "M2")
            # The cable is pulled out: the page says so, and goes on when it is back.
            arm.plug(False)
            page.wait(f"{NAME} === 'Check the cable'")
            assert "No readings for" in page.text
            arm.plug(True)
            page.wait(f"{NAME} === 'M3'")
            rested(page)
            measured(page, arm, "M3", "M4", "M5")
            # A landmark that is wrong is named at once, and taken again.
            arm.go("M6", np.array([0.0, 0.06, 0.0, 0.0, 0.0, 0.0]))
            page.wait("!document.getElementById('alert').hidden")
            assert "M6 does not fit" in page.text
            assert page.evaluate(NAME) == "M6"
            assert page.evaluate(DOUBTED) == 1
            click(page, "retake")
            page.wait("document.getElementById('alert').hidden")
            assert page.evaluate(NAME) == "M6"
            measured(page, arm, "M6")
            assert page.evaluate("document.getElementById('alert').hidden")
            assert page.evaluate(DOUBTED) == 0
            measured(page, arm, "L1")
            page.wait("document.querySelectorAll('#parameters .bar').length > 5")
            assert "parameters are determined" in page.text
            # Nothing is lost with it.
            process.send_signal(signal.SIGKILL)
            process.wait()
            page.wait("document.body.innerText.includes('has ended')")
        assert landmarks(job) == first
        with guide(job, arm.device) as (url, _):
            page.open(url)
            page.wait(f"{NAME} === 'L2'")
            assert page.evaluate(TAKEN) == 8
            rested(page)
            names = list(read_artefact(job.parent / "artefact.yaml").landmarks)
            assert names[:8] == first
            measured(page, arm, *names[8:-1])
            arm.go(names[-1])
            page.wait("document.body.innerText.includes('P1 is complete')")
            assert len(landmarks(job)) == 15
            page.wait("document.body.innerText.includes('Best next')")
            for width, dark in ((1400, False), (500, True)):
                page.resize(width, 900, dark=dark)
                page.picture(tmp_path / f"{width}.png")
                assert page.evaluate("document.documentElement.scrollWidth") == width
            click(page, "finish")
            page.wait("document.querySelectorAll('#files a').length")
            assert "→" in page.evaluate("document.getElementById('headline').innerText")
            report = page.evaluate("document.querySelector('#files a').href")
            with urllib.request.urlopen(report, timeout=LONGEST) as answer:
                assert b"<html" in answer.read()
            assert (job.parent / "results" / "result.json").is_file()
