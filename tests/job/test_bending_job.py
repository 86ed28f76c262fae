"""A job whose arm bends under loads, from the simulation to the validated answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_job import answer, printed, refused

from suta_calib import ArmModel
from suta_calib.tracking.uncertainty import read_uncertainty

SIMULATION = """
arm: {urdf: URDF, tip: tip}
seed: 2
errors:
  - {select: ["*.offset"], std_deg: 0.5}
  - {select: ["joint_1.compliance_[xy]"], value_deg_per_nm: 0.02}
  - {select: [joint_5.mass], value_kg: 0.1}
noise: {instrument_mm: 0.02}
sets:
  calibration:
    {kind: tracked_point, samples: 60, payload_kg: [0, 3], payload_position_mm: [0, 0, 60],
     base_in_instrument: {position_mm: [1000, 0, 0]}}
  validation:
    {kind: tracked_point, samples: 20, payload_kg: [1, 2], payload_position_mm: [50, 0, 0],
     base_in_instrument: {position_mm: [1000, 0, 0]}}
"""
JOB = """
arm: {urdf: URDF, tip: tip}
parameters:
  - {select: ["*.offset"], bound_deg: 5}
  - {select: ["joint_1.compliance_[xy]"], bound_deg_per_nm: 0.2}
  - {select: [joint_5.mass], prior_kg: 0.05, bound_kg: 0.3, fixed: true}
observations:
  - {kind: tracked_point, samples: calibration/*.csv}
validation:
  - {kind: tracked_point, samples: validation/*.csv}
"""
BENT = ["joint_1.compliance_x", "joint_1.compliance_y"]


@pytest.fixture
def job(tmp_path: Path, suta_urdf: Path) -> Path:
    (tmp_path / "simulation.yaml").write_text(SIMULATION.replace("URDF", str(suta_urdf)))
    printed("simulate", tmp_path / "simulation.yaml", "--out", tmp_path)
    (tmp_path / "calibration.yaml").write_text(JOB.replace("URDF", str(suta_urdf)))
    return tmp_path / "calibration.yaml"


def test_what_it_says_of_an_arm_that_bends(job: Path, suta_urdf: Path) -> None:
    result = answer("calibrate", job)
    found = result["parameters"]
    for name in BENT:
        assert found[name]["value"] == pytest.approx(np.radians(0.02), rel=0.2)
    assert found["joint_5.mass"]["unit"] == "kg"
    # Loads that were not fitted, elsewhere at the tip: no worse than the noise.
    after = result["metrics"]["validation"]["after"]["rms_mm"]
    assert after < 0.06
    page = (job.parent / "results" / "report.html").read_text()
    assert "A URDF cannot hold joint_1.compliance_x, joint_1.compliance_y, joint_5.mass" in page
    urdf, file = (result["files"][name] for name in ("calibrated.urdf", "result.json"))
    told = answer("validate", urdf, job, "--result", file)
    assert told["metrics"]["validation"]["after"]["rms_mm"] == pytest.approx(after, rel=0.05)
    plain = answer("validate", urdf, job)["metrics"]["validation"]["after"]["rms_mm"]
    assert plain > 3 * after
    beside = read_uncertainty(Path(file), ArmModel.from_urdf(urdf, "tip")).beside_geometry
    assert {*beside} == {*BENT, "joint_5.mass"}


def test_without_the_loads_it_fits_worse(job: Path) -> None:
    with_loads = answer("calibrate", job)["metrics"]["calibration"]["after"]["rms_mm"]
    for file in job.parent.glob("*/samples.csv"):
        rows = [line.rsplit(",", 4)[0] for line in file.read_text().splitlines()]
        assert not rows[0].count("payload")
        file.write_text("\n".join(rows) + "\n")
    without = answer("calibrate", job, code=1)["metrics"]["calibration"]["after"]["rms_mm"]
    assert without > 2 * with_loads


def test_extend_looks_for_it(job: Path) -> None:
    text = job.read_text().replace(
        '  - {select: ["joint_1.compliance_[xy]"], bound_deg_per_nm: 0.2}\n', ""
    )
    job.write_text(text)
    said = refused("extend", job)
    assert "joint_5.mass, but no compliance of a joint that carries this mass" in said
    job.write_text("\n".join(line for line in text.splitlines() if "mass" not in line))
    found = answer("extend", job, "--quick")
    # What the mass that nobody estimates does may look like an eccentric disc.
    assert {*BENT} <= {*found["added"]}
    assert BENT in [row["select"] for row in found["rows"]]
