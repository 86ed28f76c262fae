"""Two cameras on one tip in a job: by columns of the samples, and by labelled rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from simulated import SUTA_URDF, arm_named, random_readings

from suta_calib.geometry.numbers import rotation_from_vector, vector_from_rotation
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import Samples, write_samples
from suta_calib.model.arm import ArmModel
from suta_calib.terms.external_frame import pose_named
from suta_calib.terms.hand_eye_start import Poses, after, inverse_poses

EYES = {
    "left": (rotation_from_vector([0.1, 0.2, -1.5]), np.array([0.02, -0.05, 0.08])),
    "right": (rotation_from_vector([0.4, -0.1, 1.2]), np.array([-0.03, 0.04, 0.06])),
}
TARGET = rotation_from_vector([2.0, 0.4, 0.3]), np.array([0.6, 0.2, -0.1])
HEAD = f"""\
arm: {{urdf: {SUTA_URDF}, tip: tip}}
parameters: [{{select: "joint_[2-5].offset", bound_deg: 5}}]
observations:
"""
COLUMNS = "- {kind: hand_eye, samples: [left.csv, right.csv]}\n"
ROWS = """\
- {kind: hand_eye, samples: only_left.csv, label: left, target: wall}
- {kind: hand_eye, samples: only_right.csv, label: right, target: wall}
"""


def seen(arm: ArmModel, eye: Poses, seed: int, labels: dict[str, str]) -> Samples:
    """What a camera on the tip sees of the target, with noise."""
    random = np.random.default_rng(seed)
    q = random_readings(arm, random, 20)
    true = {f"joint_{k}.offset": 0.004 * k for k in range(2, 6)}
    R, p = after(inverse_poses(after(arm.forward(q, true), eye)), TARGET)
    R = R @ rotation_from_vector(5e-4 * random.standard_normal((20, 3)))
    p = p + 1e-4 * random.standard_normal((20, 3))
    named = {name: np.full(20, label) for name, label in labels.items()}
    return Samples.from_arrays(arm.joints, q, labels=named, position=p, rotation=R)


@pytest.mark.parametrize("rows", [COLUMNS, ROWS], ids=["columns", "rows"])
def test_two_cameras_share_a_target(rows: str, tmp_path: Path) -> None:
    arm = arm_named("suta")
    for seed, (name, eye) in enumerate(EYES.items()):
        labels = {"eye": name, "target": "wall"}
        write_samples(tmp_path / f"{name}.csv", seen(arm, eye, seed, labels))
        write_samples(tmp_path / f"only_{name}.csv", seen(arm, eye, seed, {}))
    job = tmp_path / "calibration.yaml"
    job.write_text(HEAD + rows, encoding="utf-8")
    answer = CalibrationJob.load(job).run()
    values = answer.solution.values
    assert {n.partition(".")[0] for n in values if "[" in n} == {
        *("hand_eye[left]", "hand_eye[right]", "target[wall]")
    }
    # The first joint and the target are one: from eye to eye nothing is.
    X = {name: pose_named(values, f"hand_eye[{name}]") for name in EYES}
    found = after(inverse_poses(X["left"]), X["right"])
    true = after(inverse_poses(EYES["left"]), EYES["right"])
    assert np.linalg.norm(found[1] - true[1]) < 2e-3
    assert np.linalg.norm(vector_from_rotation(true[0].T @ found[0])) < 5e-3
