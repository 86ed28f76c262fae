"""A calibration, and one that was stopped before its end."""

from __future__ import annotations

from pathlib import Path

import pytest
from report_scenes import make_job

from suta_calib.job.calibration import Calibration


@pytest.fixture(scope="module", autouse=True)
def pictures(all_drawn: None) -> None:
    """Here reports are looked at."""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Calibration:
    return make_job(tmp_path_factory.mktemp("job"), suta_urdf).run()


@pytest.fixture(scope="module")
def unconverged(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Calibration:
    found = make_job(tmp_path_factory.mktemp("job"), suta_urdf, iterations=1).run()
    assert not found.solution.converged
    return found
