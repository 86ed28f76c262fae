"""The SUTA as its job describes it, and its posture on every landmark."""

from __future__ import annotations

from pathlib import Path

import pytest
from acquisition_scenes import Scene
from device_stand_in import postures_on

from suta_calib.acquisition.touch_sequence import read_arm, read_row
from suta_calib.arrays import FloatArray
from suta_calib.model.arm import ArmModel


@pytest.fixture(scope="module")
def job(repository: Path) -> Path:
    return repository / "data" / "suta" / "calibration.yaml"


@pytest.fixture(scope="module")
def arm(job: Path) -> ArmModel:
    return read_arm(job)


@pytest.fixture(scope="module")
def postures(arm: ArmModel, job: Path) -> dict[str, FloatArray]:
    artefact = read_row(job, None, ["pairwise_distance"]).artefact
    assert artefact is not None
    return postures_on(arm, artefact)


@pytest.fixture
def scene(job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path) -> Scene:
    return Scene(job, arm, postures, tmp_path)
