"""``suta-calib motors``: device.yaml and samples after the touches have shown the motors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_job import answer, refused
from hobby_arms import sheet
from servo_arms import SLOPE, TABLE, ServoArm, arm_with_pen, placed

from suta_calib.device.device_file import device_text, read_device
from suta_calib.job import CalibrationJob
from suta_calib.job.new_job import new_job, write_job
from suta_calib.measurements import Samples, write_samples
from suta_calib.measurements.artefact import write_artefact

pytestmark = pytest.mark.usefixtures("undrawn")

ORDER, SIGNS = (0, 1, 3, 2, 4), (1, -1, 1, 1, -1)


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job as init writes it, measured with a device.yaml that nobody checked."""
    folder = tmp_path_factory.mktemp("servos") / "my_arm"
    folder.mkdir()
    servos = ServoArm.made(arm_with_pen(folder), 2, order=ORDER, signs=SIGNS)
    write_job(new_job(servos.arm, folder, pen=True))
    write_artefact(folder / "artefact.yaml", sheet())
    (folder / "calibration/samples.csv").unlink()
    for name, place in (("table", TABLE), ("slope", SLOPE)):
        q = servos.touching(placed(sheet(), place), (0, -20, 45, 45, 0))
        marks = [*sheet().landmarks]
        labels = {"placement": [name] * 15, "repeat": ["1"] * 15, "landmark": marks}
        samples = Samples.from_arrays(servos.arm.joints, servos.readings(q), labels=labels)
        write_samples(folder / f"calibration/{name}.csv", samples)
    (folder / "device.yaml").write_text(device_text(servos.device, "as unpacked"))
    return folder / "calibration.yaml"


def test_device_and_samples_are_written_as_the_motors_are(job: Path, tmp_path: Path) -> None:
    device, folder = tmp_path / "device.yaml", tmp_path / "mapped"
    command = ("motors", job, "--device", job.parent / "device.yaml")
    found = answer(*command, "--out", device, "--samples-out", folder)
    assert found["status"] == "found"
    assert found["verdict"]["usable"]
    joints = {row["joint"]: row for row in found["joints"]}
    assert joints["wrist_flex"]["motor"] == "elbow_flex"
    assert joints["shoulder_lift"]["sign"] == -1
    assert joints["shoulder_pan"]["zero_std_deg"] is None
    assert found["device"] == str(device)
    corrected = read_device(device)
    assert [spec.name for spec in corrected.joints][2:4] == ["wrist_flex", "elbow_flex"]
    assert [spec.number for spec in corrected.joints] == [1, 2, 3, 4, 5]
    # The job is right with these samples, and was not with the old ones.
    copy = tmp_path / "job"
    copy.mkdir()
    for name in ("calibration.yaml", "artefact.yaml", "arm.urdf"):
        text = (job.parent / name).read_text()
        (copy / name).write_text(text.partition("\nvalidation:")[0] + "\n")
    (folder / "calibration").rename(copy / "calibration")
    assert {path.name for path in (copy / "calibration").iterdir()} == {"table.csv", "slope.csv"}
    loaded = CalibrationJob.load(copy / "calibration.yaml")
    assert np.abs(loaded.observations[0].poses.samples.q).max() < np.pi


def test_no_input_is_replaced_and_options_are_checked(job: Path, tmp_path: Path) -> None:
    device = job.parent / "device.yaml"
    command = ("motors", job, "--device", device)
    assert "found an input of the same command" in refused(*command, "--out", device)
    assert "JOINT=1 or JOINT=-1" in refused(*command, "--sign", "wrist_roll=2")
    nothing = tmp_path / "none.yaml"
    nothing.write_text(device.read_text().replace("wrist_roll", "gripper"))
    assert "wrist_roll" in refused("motors", job, "--device", nothing)
