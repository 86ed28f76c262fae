"""A recording of minutes has 100,000 rows: time and memory grow with them, no faster."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest
from pose_answers import XYZ
from pose_scenes import PAIR, POSE, pair_numbers, pivot_numbers, point_numbers, write_csv


@pytest.mark.slow
@pytest.mark.parametrize("command", ["pivot", "hand-eye", "register"])
def test_a_hundred_thousand_rows(command: str, tmp_path: Path) -> None:
    rows = 100_000
    if command == "pivot":
        files = [write_csv(tmp_path / "p.csv", POSE, pivot_numbers(["left"] * rows))]
    elif command == "hand-eye":
        rows = 10_000
        files = [write_csv(tmp_path / "p.csv", PAIR, pair_numbers(rows, "eye-in-hand"))]
    else:
        points = zip("ab", point_numbers(rows), strict=True)
        files = [write_csv(tmp_path / f"{name}.csv", XYZ, numbers) for name, numbers in points]
    process = [sys.executable, "-m", "suta_calib", command, *map(str, files), "--json"]
    subprocess.run(process, check=True, capture_output=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert used.ru_maxrss < 2e6  # kB
    assert used.ru_utime + used.ru_stime < 120.0
