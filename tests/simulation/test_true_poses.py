"""The truth beside simulated samples: where all stands that a calibration finds beside the arm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from simulation_scenes import Folder

from suta_calib.emulation.truth import read_truth
from suta_calib.errors import JobError
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import ParameterSet
from suta_calib.report.calibration_tables import EXTERNAL_POSES
from suta_calib.simulation import Simulation, write_simulation
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, Setup
from suta_calib.trust.external_poses import external_poses

HEADER = """
arm: {urdf: URDF, tip: tip}
seed: 3
errors: [{select: ["*.offset"], std_deg: 1}]
sets:
  seen:
"""
POINT = "{position_mm: [400, -50, 30]}"
TURNED = "{position_mm: [400, -50, 30], rotation_rpy_deg: [5, -10, 20]}"
SETS = {
    "landmark": f"    artefact: artefact.yaml\n    placements: {{P1: {TURNED}}}\n",
    "fixed_point": f"    points: {{F1: {POINT}, F2: {{position_mm: [0, 400, 50]}}}}\n",
    "plane": f"    planes: {{S1: {TURNED}}}\n    probe_radius_mm: 8\n",
    "range": f"    anchors: {{A: {POINT}}}\n    length_mm: [200, 300]\n",
    "tracked_point": f"    samples: 12\n    base_in_instrument: {TURNED}\n"
    "    targets: {R1: {position_mm: [30, -20, 50]}, R2: {position_mm: [-40, 0, 10]}}\n",
    "hand_eye": f"    samples: 12\n    eye_in_tip: {TURNED}\n    target_in_base: {TURNED}\n",
}


def all_samples(made: Simulation) -> Samples:
    return Samples.concatenate([file.samples for file in made.files])


def told(made: Simulation, out: Path) -> Any:
    write_simulation(made, out)
    return yaml.safe_load((out / "truth.yaml").read_text())


@pytest.fixture
def folder(tmp_path: Path, suta_urdf: Path) -> Folder:
    return Folder(tmp_path, suta_urdf)


@pytest.mark.parametrize("kind", SETS)
def test_truth_has_the_poses_that_a_calibration_of_the_true_arm_finds(
    folder: Folder, kind: str
) -> None:
    made = folder.simulate(HEADER + f"    kind: {kind}\n{SETS[kind]}")
    written = told(made, folder.path / "out")["external_poses"]["seen"]
    (plan,) = made.spec.sets
    poses = ArmPoses(made.arm.at(made.values), all_samples(made))
    setup = Setup(artefact=made.artefacts.get("seen"), settings=plan.settings)
    found = external_poses(solve(Problem([plan.term.over(poses, setup)], ParameterSet())))
    assert [pose.name for pose in found] == list(written)
    for pose in found:
        row = written[pose.name]
        assert (row["what"], row["within"]) == (pose.frame.what, pose.frame.within)
        np.testing.assert_allclose(row["position_mm"], 1e3 * pose.position, atol=1e-4)
        assert ("matrix" in row) == (pose.matrix is not None)
        if pose.matrix is not None:
            np.testing.assert_allclose(row["matrix"], pose.matrix, atol=1e-6)
            np.testing.assert_allclose(row["quaternion_xyzw"], pose.quaternion, atol=1e-6)
    keys = {column.key for column in EXTERNAL_POSES.columns}
    assert {key.removesuffix("_mm").removesuffix("_deg") for key in row} <= keys


def test_distances_know_of_no_pose(folder: Folder) -> None:
    body = f"    kind: pairwise_distance\n{SETS['landmark']}"
    assert "external_poses" not in told(folder.simulate(HEADER + body), folder.path / "out")


def test_the_tip_may_be_that_of_a_probe(folder: Folder) -> None:
    probe, header = (
        np.array([0.02, -0.01, 0.09]),
        HEADER.replace("tip: tip}", "tip: tip, tip_offset_mm: [20, -10, 90]}"),
    )
    body = f"    kind: fixed_point\n{SETS['fixed_point']}"
    made = folder.simulate(header + body)
    plain = ArmModel.from_urdf(folder.urdf, "tip")
    bent = {name: value for name, value in made.values.items() if name.endswith(".offset")}
    samples = all_samples(made)
    R, p = plain.forward(samples.q, bent)
    touched = p + R @ probe
    for label, expected in (("F1", [0.4, -0.05, 0.03]), ("F2", [0, 0.4, 0.05])):
        rows = samples.labels["point"] == label
        assert rows.sum() == 20
        np.testing.assert_allclose(touched[rows], np.tile(expected, (20, 1)), atol=1e-8)
    # Whoever has the URDF alone reads from the truth where the tip is.
    told(made, folder.path / "out")
    for path in (folder.path / "out/truth.yaml", folder.path / "simulation.yaml"):
        values = read_truth(path, plain)
        assert values == pytest.approx({n: made.values[n] for n in values}, abs=1e-12)


def test_a_probe_on_a_link_that_moves_is_refused(folder: Folder) -> None:
    header = HEADER.replace("tip: tip}", "tip: joint_6, tip_offset_mm: [0, 0, 90]}")
    with pytest.raises(JobError, match=r"simulation\.yaml:2: arm\.tip_offset_mm: found .* joint_6"):
        folder.simulate(header + f"    kind: fixed_point\n{SETS['fixed_point']}")


@pytest.mark.parametrize(("noise", "lengths"), [(0.0, "300"), (0.2, "300"), (0.2, "[200, 400]")])
def test_an_instrument_scatters_whether_or_not_somebody_reads_it(
    folder: Folder, noise: float, lengths: str
) -> None:
    body = (
        f"    kind: range\n    anchors: {{A: {POINT}}}\n    length_mm: {lengths}\n"
        f"    directions: 150\n    noise: {{instrument_mm: {noise}}}\n"
    )
    made = folder.simulate(HEADER + body)
    samples = all_samples(made)
    _, tip = made.arm.forward(samples.q, made.values)
    distance = np.linalg.norm(tip - [0.4, -0.05, 0.03], axis=1)
    expected = samples.numbers.get("length", np.full(len(distance), 0.3))
    scatter = 1e3 * float(np.std(distance - expected))
    # 150 numbers tell their scatter to 6 %.
    assert scatter == pytest.approx(noise, rel=4 * 0.06, abs=1e-6)
