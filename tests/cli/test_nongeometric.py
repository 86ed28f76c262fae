"""`extend`, `budget`, and what calibrate, validate and track make of errors beside geometry."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_job import JOB, answer, printed, refused, simulated, write_simulated_job

from suta_calib.measurements import write_samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Selection
from suta_calib.report.model_selection import row_text, wrapped
from suta_calib.tracking.tracker import TipKinematics
from suta_calib.tracking.uncertainty import read_uncertainty

ECCENTRIC = 4e-3
ROW = "  - {select: [joint_3.ecc_c1, joint_3.ecc_s1], bound_deg: 1}\n"


@pytest.fixture
def clean(tmp_path: Path, suta_urdf: Path) -> Path:
    """A job without errors beside geometry."""
    return write_simulated_job(tmp_path / "clean", suta_urdf)


@pytest.fixture
def job(tmp_path: Path, suta_urdf: Path) -> Path:
    """The same with an eccentric encoder in joint 3."""
    path = write_simulated_job(tmp_path / "job", suta_urdf)
    arm = ArmModel.from_urdf(path.parent / "arm.urdf", "tip")
    for name, n, seed in (("calibration", 40, 1), ("validation", 15, 2)):
        samples = simulated(arm, n, seed)
        # The encoder reads what makes angle = reading + c1 cos(reading).
        q, turned = samples.q.copy(), samples.q[:, 2].copy()
        for _ in range(20):
            q[:, 2] = turned - ECCENTRIC * np.cos(q[:, 2])
        read = type(samples)(samples.joints, q, samples.labels, samples.position)
        write_samples(path.parent / name / "a.csv", type(samples).concatenate([_named(read)]))
    return path


def _named(samples: object) -> object:
    from dataclasses import replace

    n = len(samples)  # type: ignore[arg-type]
    return replace(samples, origin=tuple(f"row {k}" for k in range(n)))  # type: ignore[type-var]


def with_row(job: Path) -> Path:
    text = job.read_text().replace("observations:", f"{ROW}observations:")
    (job.parent / "with.yaml").write_text(text)
    return job.parent / "with.yaml"


def test_extend_finds_the_eccentric_encoder(job: Path) -> None:
    found = answer("extend", job, "--quick")
    assert found["added"] == ["joint_3.ecc_c1", "joint_3.ecc_s1"]
    assert found["estimates"]["joint_3.ecc_c1"]["value"] == pytest.approx(ECCENTRIC, abs=2e-4)
    assert found["rows"] == [{"select": ["joint_3.ecc_c1", "joint_3.ecc_s1"], "bound_deg": 1.0}]
    assert found["validation"]["chosen_rms_mm"] < 0.4 * found["validation"]["job_rms_mm"]
    assert len(found["folds"]) == 5
    assert {Path(f).name for f in found["files"].values()} == {
        *("extend.json", "extend.svg", "report.html")
    }
    page = (job.parent / "results" / "report.html").read_text()
    assert "Errors other than geometry" in page
    assert "select: [joint_3.ecc_c1, joint_3.ecc_s1], bound_deg: 1" in page


def test_extend_leaves_a_clean_job_alone(clean: Path) -> None:
    out = printed("extend", clean, "--out", clean.parent / "out")
    assert (
        "Good. Keep the job as it is: no additional error improves the prediction of left-out data"
        in " ".join(out.split())
    )
    assert max(map(len, out.split("Written")[0].splitlines())) <= 80
    models = json.loads((clean.parent / "out" / "extend.json").read_text())["models"]
    assert sum(m["chosen"] for m in models) == 1
    assert any("all joints" in m["name"] for m in models)


def test_calibrate_offers_it_when_the_residuals_show_it(job: Path, clean: Path) -> None:
    said = " ".join(printed("calibrate", job).split())
    assert "The residuals of joint_3 look like an eccentric encoder" in said
    falls = re.search(r"left out of the fit falls from ([\d.]+) mm to ([\d.]+) mm", said)
    assert falls is not None
    assert float(falls[1]) > float(falls[2])
    assert "Run suta-calib extend" in said
    assert "look like" not in printed("calibrate", clean)


def test_what_a_urdf_cannot_hold_is_said_and_can_be_applied(job: Path) -> None:
    extended = with_row(job)
    result = answer("calibrate", extended)
    after = result["metrics"]["validation"]["after"]["rms_mm"]
    page = (job.parent / "results" / "report.html").read_text()
    assert "A URDF cannot hold joint_3.ecc_c1, joint_3.ecc_s1" in page
    urdf, file = (Path(result["files"][n]) for n in ("calibrated.urdf", "result.json"))
    assert "ecc_" not in urdf.read_text()
    alone = answer("validate", urdf, extended)
    plain = alone["metrics"]["validation"]["after"]["rms_mm"]
    left_out = "The job estimates joint_3.ecc_c1, joint_3.ecc_s1. No URDF holds these values"
    assert any(left_out in note and "--result" in note for note in alone["verdict"]["notes"])
    told = answer("validate", urdf, extended, "--result", file)
    assert not any("--result" in note for note in told["verdict"]["notes"])
    assert told["metrics"]["validation"]["after"]["rms_mm"] == pytest.approx(after, rel=1e-6)
    assert plain > 5 * after


def test_values_of_another_urdf_are_refused(job: Path) -> None:
    """The nominal arm with the corrections of the calibrated one would be neither."""
    extended = with_row(job)
    result = answer("calibrate", extended)["files"]["result.json"]
    said = refused("validate", job.parent / "arm.urdf", extended, "--result", result)
    assert "arm.urdf: joint_2: found the origin of joint_2 differs from" in said


def test_rows_to_add_are_yaml_however_many() -> None:
    names = tuple(f"wrist_{k}_joint.ecc_{key}" for k in range(3) for key in ("c1", "s1"))
    lines = wrapped(row_text(Selection(names, bound_rad=np.radians(1.0))))
    assert max(map(len, lines.splitlines())) <= 78
    rows = yaml.safe_load(f"parameters:\n{lines}\n")["parameters"]
    assert rows == [{"select": list(names), "bound_deg": 1}]


def test_the_tracked_tip_is_corrected(job: Path) -> None:
    files = answer("calibrate", with_row(job))["files"]
    nominal = ArmModel.from_urdf(job.parent / "arm.urdf", "tip")
    arm = ArmModel.from_urdf(files["calibrated.urdf"], "tip")
    uncertainty = read_uncertainty(files["result.json"], arm)
    assert set(uncertainty.beside_geometry) == {"joint_3.ecc_c1", "joint_3.ecc_s1"}
    q = np.array([0.3, -0.4, 0.9, 0.2, -1.0, 0.5])
    _, position, std = TipKinematics(arm, uncertainty=uncertainty)(q)
    _, expected = nominal.forward(q, uncertainty.values)
    np.testing.assert_allclose(position, expected, atol=1e-9)
    assert np.linalg.norm(position - arm.forward(q)[1]) > 1e-4
    assert std is not None
    assert (std > 0).all()


def test_budget_splits_the_errors(clean: Path) -> None:
    clean.write_text(JOB + "encoders: {bits: 22, noise_deg: 0.0005}\n")
    found = answer("budget", clean)
    first = found["blocks"][0]
    assert [s["sources"] for s in first["shares"]] == [
        ["gross"],
        ["encoders"],
        ["instrument", "model"],
    ]
    assert sum(s["share_pct"] for s in first["shares"]) == pytest.approx(100)
    assert found["tip"]["model_rms_mm"] is None
    assert (clean.parent / "results" / "budget.svg").read_text().startswith("<svg")
    out = printed("budget", clean)
    assert "tracked_point has no repeats of the same posture" in " ".join(out.split())
    assert max(map(len, out.split("Written")[0].splitlines())) <= 80


def test_masses_that_are_missing_are_named(clean: Path) -> None:
    urdf = clean.parent / "arm.urdf"
    bare = re.sub(r"<inertial>.*?</inertial>", "", urdf.read_text(), flags=re.DOTALL)
    urdf.write_text(bare)
    text = JOB.replace("observations:", "  - {select: ['*.compliance']}\nobservations:")
    clean.write_text(text)
    said = refused("calibrate", clean)
    assert "arm.urdf: joint_1.compliance: found no mass in any link behind joint_1" in said


@pytest.mark.parametrize("command", ["extend", "budget"])
def test_bad_input_is_one_line(clean: Path, command: str) -> None:
    compliance = "  - {select: ['*.compliance'], bound_deg: 1}\nobservations:"
    for text, said in (
        (JOB.replace("observations:", compliance), "bound_deg_per_nm"),
        (JOB + "encoders: {bits: 80}\n", "encoders.bits"),
    ):
        clean.write_text(text)
        assert said in refused(command, clean)
    refused("extend", clean, "--seed", -1)
    assert not (clean.parent / "results").exists()
