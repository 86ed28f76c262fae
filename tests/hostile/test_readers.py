"""Readers of bytes, over files that were good once: an answer, or one error that names the file."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from hostile_scene import JOB, SAMPLES, URDF
from hypothesis import given, settings
from hypothesis import strategies as st

from suta_calib.certification import read_raw_points
from suta_calib.device import read_device
from suta_calib.errors import SutaCalibError
from suta_calib.job.acceptance import AcceptanceJob
from suta_calib.job.schema import read_job
from suta_calib.measurements import read_artefact, read_csv_table
from suta_calib.measurements.pose_files import read_points, read_pose_pairs, read_tool_poses
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import read_simulation
from suta_calib.stereotactic.cis_files import read_calibration_body, read_optical_pivot
from suta_calib.tracking.tracker import read_tool
from suta_calib.tracking.trajectory import read_trajectory
from suta_calib.tracking.uncertainty import read_uncertainty

RESULT = (
    '{"status": "converged", "parameters": {"joint_2.offset": {"value": 0.01, "std": 1e-4},'
    ' "joint_4.z": {"value": 0.57, "std": 1e-5}}, "covariance": {"parameters":'
    ' ["joint_2.offset", "joint_4.z"], "matrix": [[1e-8, 1e-10], [1e-10, 1e-10]]}}'
)
TOOL = '{"tip_mm": [0.5, -1.0, 120.0]}'


@cache
def arm(urdf: Path) -> ArmModel:
    return ArmModel.from_urdf(urdf, "tip")


# By a file of the scene, or of what is written beside it.
READERS: dict[str, Callable[[Path], object]] = {
    JOB: read_job,
    URDF: lambda path: ArmModel.from_urdf(path, "tip"),
    SAMPLES: read_csv_table,
    "artefact.yaml": read_artefact,
    "device.yaml": read_device,
    "iso.yaml": AcceptanceJob.load,
    "simulation.yaml": read_simulation,
    "pivot.csv": read_tool_poses,
    "pairs.csv": read_pose_pairs,
    "a.csv": read_points,
    "points.csv": read_raw_points,
    "recorded.csv": read_trajectory,
    "cis-calbody.txt": read_calibration_body,
    "cis-optpivot.txt": read_optical_pivot,
    "result.json": lambda path: read_uncertainty(path, arm(path.parent / URDF)),
    "tip.json": read_tool,
}
SNIPPETS = (
    b'\0|\xff|\xe2\x80\xa8|\r|\n\n|,|"|#|{|[|&a *a|nan|-inf|1e999|1e-320|1e200|null|true|<!--'
)
BYTES = st.binary(max_size=8) | st.sampled_from(SNIPPETS.split(b"|"))
CHANGES = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 12), BYTES), min_size=1, max_size=3)


@pytest.fixture(scope="module")
def beside(scene: Path) -> Path:
    """A folder whose files stand beside the scene's, so that they find what they name."""
    (scene / "result.json").write_text(RESULT)
    (scene / "tip.json").write_text(TOOL)
    return scene


@pytest.mark.parametrize("name", READERS)
def test_any_change_of_a_file_is_read_or_refused(name: str, beside: Path) -> None:
    path = beside / name
    good = path.read_bytes()[:4000]
    READERS[name](path)
    spoilt = path.with_name(f"spoilt{path.suffix}")

    @settings(max_examples=30)
    @given(changes=CHANGES, end=st.floats(0.5, 1))
    def change(changes: list[tuple[float, int, bytes]], end: float) -> None:
        data = good[: round(end * len(good))] if end < 0.9 else good
        for at, cut, new in changes:
            k = round(at * len(data))
            data = data[:k] + new + data[k + cut :]
        spoilt.write_bytes(data)
        try:
            with warnings.catch_warnings(action="ignore"):
                READERS[name](spoilt)
        except SutaCalibError as error:
            said = str(error)
            assert "found " in said
            assert len(said) < 1500

    try:
        change()
    finally:
        spoilt.unlink(missing_ok=True)
