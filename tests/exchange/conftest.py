"""A calibrated arm, its job and its results, once for all tests of exports."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_job import cli, write_simulated_job

from suta_calib.exchange import Result, read_result


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """The results' folder of a small simulated job; tests that change it work on a copy."""
    folder = tmp_path_factory.mktemp("job")
    assert cli("calibrate", write_simulated_job(folder, suta_urdf)) == 0
    return folder / "results"


@pytest.fixture(scope="session")
def result(results: Path) -> Result:
    return read_result(results)
