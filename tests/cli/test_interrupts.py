"""Whenever Ctrl-C comes: one line, exit code 130, and nothing left behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SAID = "suta-calib: interrupted; no incomplete files were left"


def interrupted(moment: str, *arguments: object) -> tuple[int, str, str]:
    """Exit code and what was said; see `tests.support.interrupted_command`."""
    module = "tests.support.interrupted_command"
    line = [sys.executable, "-m", module, moment, *map(str, arguments)]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr.strip()


@pytest.mark.parametrize("moment", ["click", "numpy", "casadi", "suta_calib.report.console"])
def test_an_interrupt_while_a_command_starts(moment: str) -> None:
    assert interrupted(moment, "pivot", "data/poses/pivot.csv") == (130, "", SAID)


@pytest.mark.parametrize("moment", ["pinocchio", "suta_calib.report.files"])
def test_an_interrupt_before_results_are_written(moment: str, tmp_path: Path) -> None:
    command = "calibrate", "data/suta/calibration.yaml", "--out", tmp_path / "results"
    assert interrupted(moment, *command) == (130, "", SAID)
    assert not list(tmp_path.iterdir())


def test_what_is_done_is_not_interrupted() -> None:
    code, printed, said = interrupted("end", "--help")
    assert (code, said) == (0, "")
    assert printed.startswith("Usage")
