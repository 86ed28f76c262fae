"""What the samples of a job that is being measured determine, and where to go on."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml

from suta_calib.guide.determined import determined, next_place
from suta_calib.job.calibration import CalibrationJob
from suta_calib.job.standing_elsewhere import job_for_other_samples, job_so_far


def measure(job: Path, repository: Path, rows: int) -> None:
    """The first rows of the first placement."""
    lines = (repository / "data" / "suta" / "calibration" / "P1.csv").read_text().splitlines()
    (job.parent / "calibration").mkdir(exist_ok=True)
    (job.parent / "calibration" / "P1_1.csv").write_text("\n".join(lines[: rows + 1]) + "\n")


def test_every_landmark_determines_more(job: Path, repository: Path) -> None:
    assert determined(job) is None
    assert next_place(job) is None
    shares, tips = [], []
    for rows in (2, 6, 15):
        measure(job, repository, rows)
        found = determined(job)
        assert found is not None
        assert found.samples == rows
        assert found.worst >= found.tip
        shares.append({p.name: p.share for p in found.parameters})
        tips.append(found.tip)
    assert tips == sorted(tips, reverse=True)
    # Where the base is moves no tip.
    assert "joint_1.offset" not in shares[0]
    for name, share in shares[2].items():
        assert 0 <= shares[0][name] <= shares[1][name] + 1e-9
        assert shares[1][name] <= share + 1e-9 <= 1 + 1e-9
    assert shares[2]["joint_4.z"] > 0.5 > shares[0]["joint_4.z"]


@pytest.mark.slow
def test_the_next_placement_is_named(job: Path, repository: Path) -> None:
    measure(job, repository, 15)
    place = next_place(job)
    assert place is not None
    assert place.sort == "point"
    assert place.what.startswith("one point at x = ")
    assert not place.enough
    assert place.landmarks.shape == (1, 3)


def test_a_job_of_the_rows_that_are_measured(job: Path, repository: Path) -> None:
    target = job.parent / "so_far.yaml"
    lines = [line for line in job.read_text().splitlines() if "fixed_point" not in line]
    job.write_text("\n".join(lines))
    assert job_so_far(job, target) is None
    measure(job, repository, 4)
    assert job_so_far(job, target) == target
    loaded = CalibrationJob.load(target)
    assert [len(term.poses) for term in loaded.observations] == [4]
    assert loaded.validation == ()
    shutil.copytree(job.parent / "calibration", job.parent / "validation")
    assert job_so_far(job, target) == job


def test_a_place_that_is_stated_and_not_measured_yet_hinders_nothing(
    job: Path, repository: Path
) -> None:
    measure(job, repository, 4)
    row = "{kind: pairwise_distance, "
    pose = "{position_mm: [170, 0, 0]}"
    text = job.read_text().replace(row, f"{row}pose: {{P1: {pose}, sheet: {pose}}}, ", 1)
    job.write_text(text)
    target = job_so_far(job, job.parent / "so_far.yaml")
    assert target is not None
    assert [*yaml.safe_load(target.read_text())["observations"][0]["pose"]] == ["P1"]


def test_a_job_is_tried_beside_the_measured_one(job: Path, repository: Path) -> None:
    measure(job, repository, 4)
    folder = job.parent / "emulated"
    copy = job_for_other_samples(job, folder / job.name)
    assert job_so_far(copy, folder / "x.yaml") is None
    shutil.copytree(job.parent / "calibration", folder / "calibration")
    so_far = job_so_far(copy, folder / "x.yaml")
    assert so_far is not None
    assert CalibrationJob.load(so_far).spec.observations[0].artefact == job.parent / "artefact.yaml"
