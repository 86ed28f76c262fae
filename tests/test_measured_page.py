"""`make measured` on one job: the peer, a peer that is absent, the table and the picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from suta_calib import CalibrationJob
from suta_calib.arrays import FloatArray, IntArray


@pytest.fixture
def measured(repository: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """`benchmarks/measured.py`."""
    monkeypatch.syspath_prepend(str(repository / "benchmarks"))
    import measured

    return measured


def test_a_section(measured: ModuleType, repository: Path, tmp_path: Path) -> None:
    path = repository / "examples" / "panda_sockets" / "calibration.yaml"
    job = CalibrationJob.load(path)
    answer = measured.PlainScipy(job).solve()
    rows = [
        measured.Row("plain SciPy", answer),
        measured.Row(measured.OURS, None, "left out of this test"),
    ]
    # Another implementation's kinematics: what it reaches is what ours reaches.
    assert rows[0].rms < 0.4
    units = measured.units_of(job.validation)
    page = measured.section(path, rows, units, "", tmp_path / "measured.md")
    assert f"| plain SciPy | {rows[0].cells[0]} | {rows[0].rms:.3f} |" in page
    assert "ours: no answer: left out of this test" in page
    assert (tmp_path / "measured" / "panda_sockets.svg").is_file()
    assert "| – | – | – | **0." in measured.summary({"Panda": rows}, {"Panda": units})
    only_tracked = "it fits tracked positions only; the job is of the kind landmark"
    with pytest.raises(measured.CannotRunError, match=only_tracked):
        measured.figaroh(job, "python")
    with pytest.raises(measured.CannotRunError, match=only_tracked):
        measured.pybotics(job, tmp_path, "distances")


def test_jobs_that_no_peer_can_fit(measured: ModuleType, repository: Path) -> None:
    examples = repository / "examples"
    whole_robot = CalibrationJob.load(examples / "whole_robot" / "calibration.yaml")
    with pytest.raises(measured.CannotRunError, match="it fits one arm; the job has several"):
        measured.PlainScipy(whole_robot)
    path = examples / "ur5_laser_tracker" / "calibration_eccentric.yaml"
    with pytest.raises(measured.CannotRunError, match="it knows geometry only"):
        measured.pybotics(CalibrationJob.load(path), repository, "distances")


def test_pybotics_has_the_same_arm(measured: ModuleType, repository: Path) -> None:
    if measured.version_in(folder := repository / ".pybotics") is None:
        pytest.skip("pybotics is not installed (make measured)")
    job = CalibrationJob.load(repository / "examples" / "ur5_laser_tracker" / "calibration.yaml")
    short = replace(job, observations=(job.observations[0].take(np.arange(700) % 35 == 0),))
    answer = measured.pybotics(short, folder, "coordinates")
    assert answer.errors.shape == (320,)
    assert np.sqrt(np.mean(answer.errors**2)) < 0.5e-3, "20 poses tell more than the nominal arm"


def test_one_row_for_a_peer_that_has_no_answer(measured: ModuleType) -> None:
    def refused() -> None:
        raise measured.CannotRunError("it fits one arm")

    ways = {"one way": refused, "another": refused}
    (row,) = measured.rows_of_peer("a peer", ways)
    assert (row.name, row.answer, row.why) == ("a peer", None, "it fits one arm")
    answer = measured.Answer(np.ones(3), 0.1)
    found = measured.rows_of_peer("a peer", {**ways, "a third": lambda: answer})
    assert [row.name for row in found] == ["a peer, one way", "a peer, another", "a peer, a third"]
    assert [row.answer for row in found] == [None, None, answer]


def test_folders(measured: ModuleType, tmp_path: Path) -> None:
    names = [path.parent.name for path in measured.jobs([])]
    assert {"panda_sockets", "ur5_laser_tracker"} <= set(names)
    assert len(names) == len(set(names))
    assert "two_arms" not in names, "simulated"
    with pytest.raises(SystemExit, match=r"found no calibration\.yaml"):
        list(measured.jobs([tmp_path]))
    assert measured.figaroh_version(str(tmp_path / "no_python")) is None
    assert measured.version_in(tmp_path) is None


def test_chance(measured: ModuleType, repository: Path) -> None:
    job = CalibrationJob.load(repository / "examples" / "panda_sockets" / "calibration.yaml")
    units = measured.units_of(job.validation)
    assert units.max() + 1 == 7, "placements are drawn whole"
    rng = np.random.default_rng(1)
    error = 1e-3 * np.abs(rng.standard_normal(200))
    rows = np.arange(200)
    # The same samples for both: a constant factor is found, though the errors scatter far more.
    low, high = measured.interval(0.97 * error, error, rows)
    assert low < high < 0
    low, high = measured.interval(error, rng.permutation(error), rows)
    assert low < 0 < high
    assert measured.interval(error, error, rows) == (0.0, 0.0)

    def page(ours: FloatArray, drawn: IntArray = rows) -> str:
        both = [
            measured.Row(name, measured.Answer(errors, 0.0))
            for name, errors in (("plain SciPy", error), (measured.OURS, ours))
        ]
        return measured.summary({"an arm": both}, {"an arm": drawn})

    assert ": ours better |" in page(0.97 * error)
    assert ": ours worse |" in page(1.03 * error)
    assert ": within chance |" in page(rng.permutation(error))
    assert ": level |" in page(error)
    assert ": too few to say |" in page(1.03 * error, rows % 5)
