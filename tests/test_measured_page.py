"""`make measured` on one job: the peer, a peer that is absent, the table and the picture."""

from __future__ import annotations

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
    page = measured.section(path, rows, "", tmp_path / "measured.md")
    assert f"| plain SciPy | {rows[0].cells[0]} | {rows[0].rms:.3f} |" in page
    assert "ours: no answer: left out of this test" in page
    assert (tmp_path / "measured" / "panda_sockets.svg").is_file()
    assert "| – | – | **0." in measured.summary({"Panda": rows})
    with pytest.raises(measured.CannotRunError, match="kind landmark"):
        measured.figaroh(job, "python")


def test_folders(measured: ModuleType, tmp_path: Path) -> None:
    names = [path.parent.name for path in measured.jobs([])]
    assert {"panda_sockets", "ur5_laser_tracker"} <= set(names)
    assert len(names) == len(set(names))
    assert "two_arms" not in names, "simulated"
    with pytest.raises(SystemExit, match=r"found no calibration\.yaml"):
        list(measured.jobs([tmp_path]))
    assert measured.figaroh_version(str(tmp_path / "no_python")) is None


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
        return measured.chances({"an arm": both}, {"an arm": drawn})

    assert "| ours better |" in page(0.97 * error)
    assert "| ours worse |" in page(1.03 * error)
    assert "| within chance |" in page(rng.permutation(error))
    assert "| level |" in page(error)
    assert "| too few to say |" in page(1.03 * error, rows % 5)
