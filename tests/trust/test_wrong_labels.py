"""Few rows with a wrong label, which a robust fit hides."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from hobby_arms import DeskArm

from suta_calib import CalibrationJob
from suta_calib.assessment import Assessment
from suta_calib.trust.patterns import matches


def judged(folder: Path, new: Mapping[str, str], rows: slice) -> Assessment:
    """The verdict on a desk arm, some of whose rows say another cross than was met."""
    job = DeskArm.made(folder / "desk", 3, 1e-3).job
    file = job.parent / "calibration/table.csv"
    header, *lines = file.read_text().splitlines()
    at = header.split(",").index("landmark")
    for k in range(len(lines))[rows]:
        cells = lines[k].split(",")
        cells[at] = new.get(cells[at], cells[at])
        lines[k] = ",".join(cells)
    file.write_text("\n".join([header, *lines]) + "\n")
    return CalibrationJob.load(job).run().assessment


def test_labels_that_were_exchanged_in_one_file_are_named(tmp_path: Path) -> None:
    # 4 of 60 rows: too few for another reading of all rows.
    assessment = judged(tmp_path, {"A2": "B4", "B4": "A2"}, slice(None))
    assert assessment.level == "care"
    (note,) = (note for note in assessment.notes if note.startswith("Labels of"))
    assert "Labels of 4 rows are probably wrong" in note
    assert "A2 is probably B4 in table.csv:" in note
    assert "B4 is probably A2 in table.csv:" in note
    assert "A2 and B4 were exchanged" in note


def test_a_single_wrong_label_is_named(tmp_path: Path) -> None:
    assessment = judged(tmp_path, {"A3": "C1"}, slice(0, 10))
    assert any(
        note.startswith("The label of 1 row is probably wrong: C1 is probably A3 in table.csv:4.")
        for note in assessment.notes
    )


@pytest.mark.parametrize("at", [3, 5])
def test_sound_labels_are_left_alone(at: int, tmp_path: Path) -> None:
    job = CalibrationJob.load(DeskArm.made(tmp_path / "desk", at, 1e-3).job)
    assert not matches(job.run().solution, "rows")
