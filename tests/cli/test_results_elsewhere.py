"""A folder of results is all that is needed to read it back: it may be copied, its job removed."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture, answer, cli, refused, write_simulated_job

from suta_calib.exchange.result import read_result
from suta_calib.job import inputs_copy
from suta_calib.job.calibration import CalibrationJob
from suta_calib.job.inputs_copy import InputsCopy, packed
from suta_calib.tracking.read_back import read_calibrated


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """A job whose URDF is beside its folder, and results at another place, from relative paths."""
    folder = tmp_path_factory.mktemp("calibrated")
    job = write_simulated_job(folder / "work" / "job", suta_urdf)
    (folder / "arms").mkdir()
    (job.parent / "arm.urdf").rename(folder / "arms" / "arm.urdf")
    job.write_text(job.read_text().replace("arm.urdf", "../../arms/arm.urdf"))
    before = Path.cwd()
    os.chdir(job.parent)
    try:
        assert cli("calibrate", job.name, "--out", "../../o") == 0
    finally:
        os.chdir(before)
    return folder


@pytest.fixture
def alone(calibrated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Nothing but a copy of the results, while the job's own folder has another name."""
    hidden = calibrated.with_name("hidden")
    shutil.copytree(calibrated / "o", tmp_path / "copy")
    calibrated.rename(hidden)
    monkeypatch.chdir(tmp_path)
    yield tmp_path / "copy"
    hidden.rename(calibrated)


def test_a_copy_of_the_results_is_enough(alone: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    assert cli("export", alone, "--format", "urdf", "--out", tmp_path / "arm.urdf") == 0
    assert (tmp_path / "arm.urdf").read_bytes() == (alone / "calibrated.urdf").read_bytes()
    assert cli("view", alone, "--html", tmp_path / "arm.html") == 0
    told = answer("validate", alone / "calibrated.urdf", alone)
    metrics = json.loads((alone / "result.json").read_text())["metrics"]["validation"]
    assert told["metrics"]["validation"]["after"]["rms_mm"] == pytest.approx(
        metrics["after"]["rms_mm"]
    )


def test_from_elsewhere_it_is_the_same_calibration(calibrated: Path, alone: Path) -> None:
    found = read_calibrated(alone)
    job = calibrated.with_name("hidden") / "work" / "job" / "calibration.yaml"
    made = CalibrationJob.load(job).run().calibrated
    assert found.title == "calibration.yaml"
    assert found.values == pytest.approx(made.values)
    np.testing.assert_allclose(found.covariance, made.covariance, rtol=1e-9)


def test_inputs_that_were_changed_since_do_not_count(calibrated: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(calibrated, tmp_path / "moved"))
    before = read_calibrated(calibrated / "o")
    # In place and unchanged they are read where they are, with the meshes beside the URDF.
    assert before.arm.chain.path.samefile(calibrated / "arms" / "arm.urdf")
    hidden = calibrated.with_name("hidden")
    calibrated.rename(hidden)
    try:
        moved = read_calibrated(folder / "o")
        assert moved.arm.chain.path.samefile(folder / "arms" / "arm.urdf")
        samples = folder / "work" / "job" / "calibration" / "a.csv"
        samples.write_text(samples.read_text().replace("0.", "1.", 1))
        (folder / "arms" / "arm.urdf").write_text("<robot/>")
        after = read_calibrated(folder / "o")
    finally:
        hidden.rename(calibrated)
    for name, terms in before.terms.items():
        for (term, _), (other, _) in zip(terms, after.terms[name], strict=True):
            np.testing.assert_array_equal(term.poses.samples.q, other.poses.samples.q)


def test_a_folder_of_two_runs_is_seen(calibrated: Path, tmp_path: Path, capsys: Capture) -> None:
    folder = Path(shutil.copytree(calibrated / "o", tmp_path / "o"))
    job = next((calibrated / "work" / "job").glob("*.yaml"))
    (folder / inputs_copy.NAME).write_bytes(packed(job, [job]))
    assert cli("export", folder, "--format", "urdf") == 2
    assert "found a copy of inputs that does not belong to this result" in capsys.readouterr().err


def test_what_is_too_large_is_left_out_and_named(calibrated: Path, tmp_path: Path) -> None:
    job = calibrated / "work" / "job" / "calibration.yaml"
    files = CalibrationJob.load(job).files
    sizes = {path: path.stat().st_size for path in files}
    largest = max(sizes, key=sizes.__getitem__)
    path = tmp_path / inputs_copy.NAME
    path.write_bytes(packed(job, files, most=sum(sizes.values()) - 1))
    copy = InputsCopy.read(path)
    assert [*copy.left_out.values()] == [sizes[largest]]
    assert len(copy.sha256) == len(files) - 1
    # The same files make the same copy.
    assert packed(job, reversed(files)) == packed(job, files)


def test_an_arm_needs_no_samples(
    calibrated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = calibrated / "work" / "job" / "calibration.yaml"
    urdf = (calibrated / "arms" / "arm.urdf").stat().st_size
    monkeypatch.setattr(packed, "__defaults__", (urdf + job.stat().st_size,))
    assert cli("calibrate", job, "--out", tmp_path / "out") == 0
    hidden = calibrated.with_name("hidden")
    calibrated.rename(hidden)
    try:
        assert read_result(tmp_path / "out").arm is not None
        assert "too large (" in refused("view", tmp_path / "out", "--html", tmp_path / "page.html")
    finally:
        hidden.rename(calibrated)


def test_paths_that_are_absolute_hold_in_the_copy(
    suta_urdf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "first"
    job = write_simulated_job(folder / "job", suta_urdf)
    text = job.read_text().replace("arm.urdf", str(suta_urdf)) + "# An end.\n"
    job.write_text(text.replace("calibration/", f"{job.parent}/calibration/"))
    copy = tmp_path / "inputs.zip"
    copy.write_bytes(packed(job, CalibrationJob.load(job).files))
    shutil.rmtree(folder)
    unpacked = InputsCopy.read(copy).extract(tmp_path / "second")
    assert str(tmp_path / "first") not in unpacked.read_text()
    assert unpacked.read_text().endswith("# An end.\n")
    assert CalibrationJob.load(unpacked).arm.tip == "tip"


@pytest.mark.parametrize("name", ["../precious.txt", "{outside}/precious.txt"])
def test_a_copy_of_a_strangers_writes_nothing_else(name: str, tmp_path: Path) -> None:
    name = name.format(outside=tmp_path)
    told = {"job": "job.yaml", "folder": "/", "left_out": {}, "sha256": {"job.yaml": "", name: ""}}
    path = tmp_path / "results" / "inputs.zip"
    path.parent.mkdir()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("inputs.json", json.dumps(told))
        archive.writestr("job.yaml", "")
        archive.writestr(name, "theirs")
    with pytest.raises(Exception, match="names of files that do not belong to it"):
        InputsCopy.read(path)


def test_a_copy_that_would_fill_the_disk_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "inputs.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("inputs.json", bytes(3 * inputs_copy.MOST_BYTES))
    with pytest.raises(Exception, match="found more than 64 MB"):
        InputsCopy.read(path)
    path.write_bytes(b"PK")
    with pytest.raises(Exception, match="found another or a damaged file"):
        InputsCopy.read(path)
