"""Files of poses and of points with known answers, and outliers among them."""

from __future__ import annotations

from pathlib import Path

import pytest
from pose_answers import XYZ
from pose_scenes import POSE, pivot_numbers, point_numbers, write_csv


@pytest.fixture
def pivot_file(tmp_path: Path) -> Path:
    numbers = pivot_numbers(["left"] * 40)
    numbers[[6, 21], :3] += [[0.01, 0, 0], [0, -0.008, 0.003]]
    return write_csv(tmp_path / "pivot.csv", POSE, numbers)


@pytest.fixture
def point_files(tmp_path: Path) -> tuple[Path, Path]:
    a, b = point_numbers(12)
    b[4] += [0.01, 0.004, 0.0]
    return write_csv(tmp_path / "a.csv", XYZ, a), write_csv(tmp_path / "b.csv", XYZ, b)
