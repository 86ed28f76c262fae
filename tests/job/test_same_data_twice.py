"""What is there twice counts once, and it is said."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import simulated, write_simulated_job

from suta_calib.errors import JobError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import write_samples
from suta_calib.model.arm import ArmModel

ROW = "  - {kind: tracked_point, samples: 'calibration/*.csv', sigma_mm: 0.05}\n"


@pytest.fixture
def job(tmp_path: Path, suta_urdf: Path) -> Path:
    return write_simulated_job(tmp_path / "job", suta_urdf)


def with_rows(job: Path, *rows: str) -> CalibrationJob:
    text = job.read_text()
    assert ROW in text
    job.write_text(text.replace(ROW, "".join(rows)))
    return CalibrationJob.load(job)


def test_one_file_by_three_paths_is_one_file(job: Path) -> None:
    (job.parent / "linked").symlink_to(job.parent / "calibration")
    patterns = "[calibration/a.csv, ../job/calibration/*.csv, linked/a.csv]"
    loaded = with_rows(job, ROW.replace("'calibration/*.csv'", patterns))
    assert len(loaded.observations[0].poses) == 40


@pytest.mark.parametrize("copied", [False, True])
def test_two_rows_of_one_kind_over_the_same_samples_are_refused(job: Path, copied: bool) -> None:
    again = ROW.replace("calibration/*.csv", "../job/calibration/a.csv")
    if copied:
        shutil.copy(job.parent / "calibration" / "a.csv", job.parent / "b.csv")
        again = ROW.replace("calibration/*.csv", "b.csv")
    with pytest.raises(JobError, match=r"40 samples that are in observations\[0\] too") as caught:
        with_rows(job, ROW, again)
    assert "calibration.yaml:7: observations[1].samples" in str(caught.value)


def test_a_few_rows_of_another_row_of_the_job_are_refused_too(job: Path) -> None:
    header, *rows = (job.parent / "calibration" / "a.csv").read_text().splitlines(keepends=True)
    (job.parent / "a.csv").write_text("".join([header, *rows[:25]]))
    (job.parent / "b.csv").write_text("".join([header, *rows[20:]]))
    with pytest.raises(JobError, match=r"5 samples that are in observations\[0\] too"):
        with_rows(job, *(ROW.replace("calibration/*.csv", name) for name in ("a.csv", "b.csv")))


@pytest.mark.parametrize("name", ["calibration/b.csv", "more/a.csv"])
def test_a_copied_file_counts_once_and_is_said(job: Path, name: str) -> None:
    once = CalibrationJob.load(job).run()
    copy = job.parent / name
    copy.parent.mkdir(exist_ok=True)
    shutil.copy(job.parent / "calibration" / "a.csv", copy)
    twice = with_rows(job, ROW.replace("'calibration/*.csv'", f"[calibration/a.csv, {name}]")).run()
    said = f"40 rows of {copy.name} are in a.csv too. They count once."
    assert said in twice.assessment.notes
    assert not any("They count once" in note for note in once.assessment.notes)
    for estimate in once.solution.estimates.values():
        if estimate.std:
            same = twice.solution.estimates[estimate.name].std
            assert same == pytest.approx(estimate.std, rel=0.02)
    assert twice.solution.noise == pytest.approx(once.solution.noise, rel=0.02)


def test_a_file_whose_rows_stand_three_times_counts_once_and_is_said(job: Path) -> None:
    once = CalibrationJob.load(job).run()
    file = job.parent / "calibration" / "a.csv"
    header, *rows = file.read_text().splitlines(keepends=True)
    file.write_text("".join([header, *rows * 3]))
    thrice = CalibrationJob.load(job).run()
    said = "80 rows of a.csv appear twice or more in the same file. They count once."
    assert said in thrice.assessment.notes
    assert not any("They count once" in note for note in once.assessment.notes)
    assert {*thrice.assessment.notes} - {said} == {*once.assessment.notes}
    for estimate in once.solution.estimates.values():
        if estimate.std:
            same = thrice.solution.estimates[estimate.name].std
            assert same == pytest.approx(estimate.std, rel=0.02)


def test_rows_read_again_at_once_are_no_copies(job: Path) -> None:
    """A recorder faster than its tracker writes what it has until there is more."""
    file = job.parent / "calibration" / "a.csv"
    header, *rows = file.read_text().splitlines(keepends=True)
    file.write_text("".join([header, *(row for row in rows for _ in range(3))]))
    notes = CalibrationJob.load(job).run().assessment.notes
    assert not any("They count once" in note for note in notes)


@pytest.mark.parametrize(("rows", "said"), [(40, True), (0, False)])
def test_readings_of_a_fitted_rest_are_not_held_out(job: Path, rows: int, said: bool) -> None:
    """Validation that was read at the calibration's rests, at once or after coming back."""
    arm = ArmModel.from_urdf(job.parent / "arm.urdf", "tip")
    seen = simulated(arm, 40, seed=1 if rows else 3)
    wandered = seen.q + 1e-6 * np.random.default_rng(0).standard_normal(seen.q.shape)
    write_samples(job.parent / "validation" / "a.csv", replace(seen, q=wandered))
    notes = CalibrationJob.load(job).run().assessment.notes
    assert (
        any(f"{rows} of 40 validation rows were read in the posture" in note for note in notes)
        == said
    )
