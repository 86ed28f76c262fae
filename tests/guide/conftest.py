"""A job that is not measured yet."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest


@pytest.fixture
def job(tmp_path: Path, repository: Path) -> Path:
    """The SUTA's job without samples, and a row for fixed points."""
    data, file = repository / "data" / "suta", tmp_path / "calibration.yaml"
    text = (data / "calibration.yaml").read_text().replace("../../urdf/", f"{repository}/urdf/")
    row = '  - {kind: fixed_point, samples: "fixed_point/*.csv"}\n'
    file.write_text(text.replace("validation:\n", f"{row}validation:\n"))
    shutil.copy(data / "artefact.yaml", tmp_path)
    return file
