"""A small simulated job on disk: the SUTA seen by an external instrument."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from suta_calib.cli._app import run
from suta_calib.measurements import Samples, write_samples
from suta_calib.model.arm import ArmModel

Capture = pytest.CaptureFixture[str]
TRUTH = {
    "joint_2.offset": 0.02,
    "joint_3.offset": -0.015,
    "joint_4.z": 0.574,
    "joint_5.offset": 0.01,
}
NOISE = 0.05e-3
JOB = """\
arm: {urdf: arm.urdf, tip: tip}
parameters:
  - {select: ["joint_*.offset"], bound_deg: 15}
  - {select: [joint_4.z, joint_6.z], bound_mm: 30}
observations:
  - {kind: tracked_point, samples: 'calibration/*.csv', sigma_mm: 0.05}
validation:
  - {kind: tracked_point, samples: 'validation/*.csv'}
solver: {starts: 2, seed: 0}
"""


def simulated(
    arm: ArmModel, n: int, seed: int, truth: Mapping[str, float] = MappingProxyType(TRUTH)
) -> Samples:
    """Simulated samples of an instrument that stands anywhere, n rows."""
    random = np.random.default_rng(seed)
    q = random.uniform(-1.5, 1.5, (n, len(arm.joints)))
    _, position = arm.forward(q, truth)
    turn = Rotation.from_rotvec([0.1, -0.4, 1.2]).as_matrix()
    seen = position @ turn.T + [1.0, -0.5, 0.3] + NOISE * random.standard_normal((n, 3))
    return Samples.from_arrays(arm.joints, q, position=seen)


def write_simulated_job(folder: Path, urdf: Path) -> Path:
    """The job with its samples; returns the path of ``calibration.yaml``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.urdf").write_bytes(urdf.read_bytes())
    arm = ArmModel.from_urdf(folder / "arm.urdf", "tip")
    for name, n, seed in (("calibration", 40, 1), ("validation", 15, 2)):
        (folder / name).mkdir()
        write_samples(folder / name / "a.csv", simulated(arm, n, seed))
    (folder / "calibration.yaml").write_text(JOB, encoding="utf-8")
    return folder / "calibration.yaml"


def made_worse(job: Path) -> Path:
    """The same job with held-out data of an arm that is off the other way."""
    arm = ArmModel.from_urdf(job.parent / "arm.urdf", "tip")
    opposite = {name: 2 * arm.parameters[name].nominal - value for name, value in TRUTH.items()}
    write_samples(job.parent / "validation" / "a.csv", simulated(arm, 15, 2, opposite))
    return job


def cli(*arguments: object) -> int:
    """Run one command line; the exit code."""
    return run([str(a) for a in arguments])


def spoken(*arguments: object) -> tuple[int, str, str]:
    """Exit code of one command line, and what it said on stdout and on stderr."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = cli(*arguments)
    return code, out.getvalue(), err.getvalue()


def answer(*arguments: object, code: int = 0) -> dict[str, Any]:
    """What a command prints with --json: one object, and nothing on stderr."""
    ended, out, err = spoken(*arguments, "--json")
    assert (ended, err) == (code, ""), (ended, err)
    found = json.loads(out)
    assert isinstance(found, dict)
    return found


def printed(*arguments: object, code: int = 0) -> str:
    """What a command prints on stdout."""
    ended, out, err = spoken(*arguments)
    assert ended == code, err
    return out


def refused(*arguments: object) -> str:
    """The one line of a command that must refuse, beside warnings; nothing is on stdout."""
    code, out, err = spoken(*arguments)
    errors = [line for line in err.splitlines(keepends=True) if "warning: " not in line]
    assert (code, out, len(errors)) == (2, "", 1), (code, out, err)
    assert errors[0].startswith("suta-calib: error: ")
    return errors[0]
