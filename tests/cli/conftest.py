"""Files of poses and points with known answers, and outliers among them; an arm on a cable."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli_job import write_simulated_job
from measuring_bench import Bench
from pose_answers import XYZ
from pose_scenes import POSE, pivot_numbers, point_numbers, write_csv
from swinging_arm import emulated

from suta_calib.emulation import EmulatedArm


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


@pytest.fixture(scope="module")
def device(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The ``device.yaml`` of an arm that swings while the tests run."""
    with EmulatedArm(emulated()) as emulator:
        yield emulator.write_device(tmp_path_factory.mktemp("device") / "device.yaml")


@pytest.fixture
def job(tmp_path: Path, suta_urdf: Path) -> Path:
    """The simulated job in a folder of its own."""
    return write_simulated_job(tmp_path / "job", suta_urdf)


@pytest.fixture(scope="module")
def made_bench(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Bench:
    return Bench.made(tmp_path_factory.mktemp("job"), repository)


@pytest.fixture
def bench(made_bench: Bench, tmp_path: Path) -> Bench:
    """An arm on a cable, and a folder of its own for each test."""
    shutil.copytree(made_bench.folder, tmp_path / "job")
    return Bench(tmp_path / "job" / "calibration.yaml", made_bench.arm, made_bench.postures)
