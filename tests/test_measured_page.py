"""`make measured` on one job: the peer, a peer that is absent, the table and the picture."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from suta_calib import CalibrationJob


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
