"""What a job is about, before its samples exist."""

from __future__ import annotations

from pathlib import Path

import pytest

from suta_calib.errors import JobError
from suta_calib.job import read_outline

TEXT = """\
arm: {urdf: arm.urdf, tip: tool0}
parameters:
  - {select: ["*.offset", tip.x]}
  - {select: tip.y, fixed: true}
observations:
  - {kind: fixed_point, samples: "fixed/*.csv"}
  - {kind: landmark, artefact: artefact.yaml, samples: [a.csv, b.csv]}
validation:
  - {kind: fixed_point, samples: more.csv}
"""


def test_samples_need_not_exist(tmp_path: Path) -> None:
    job = tmp_path / "calibration.yaml"
    job.write_text(TEXT)
    outline = read_outline(job)
    assert outline.one() == ("tool0", None)
    assert outline.unknowns == ("*.offset", "tip.x")
    assert [row.where for row in outline.rows] == [
        "observations[0]",
        "observations[1]",
        "validation[0]",
    ]
    assert [row.held_out for row in outline.rows] == [False, False, True]
    assert outline.rows[1].samples == ("a.csv", "b.csv")
    assert outline.rows[0].artefact() is None


def test_what_is_asked_for_must_exist(tmp_path: Path) -> None:
    job = tmp_path / "calibration.yaml"
    job.write_text(TEXT)
    outline = read_outline(job)
    with pytest.raises(JobError, match=r"calibration\.yaml:1: arm\.urdf: found no file"):
        outline.urdf()
    with pytest.raises(JobError, match=r"observations\[1\]\.artefact: found no file"):
        outline.rows[1].artefact()
    (tmp_path / "arm.urdf").touch()
    assert outline.urdf() == tmp_path / "arm.urdf"
    job.write_text("arm: {urdf: arm.urdf}\n")
    with pytest.raises(JobError, match=r"arm\.tip: found no such key"):
        read_outline(job)
