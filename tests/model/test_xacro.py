"""A .xacro file wherever a URDF is asked for: the same arm, with and without a job."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli, write_simulated_job

from suta_calib.errors import InputError, UrdfError
from suta_calib.inputs import XacroFile
from suta_calib.job import CalibrationJob
from suta_calib.job.schema import read_job
from suta_calib.model.arm import ArmModel

pytest.importorskip("xacro")


def as_xacro(urdf: Path, path: Path) -> Path:
    """The SUTA with one length as a property, which the plain file has as a number."""
    text = urdf.read_text(encoding="utf-8")
    space = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" '
    prop = '\n<xacro:property name="forearm" value="0.571"/>\n'
    head, _, rest = text.partition("<robot ")
    start, _, body = rest.partition(">")
    assert '"0 0 0.571"' in body
    body = body.replace('"0 0 0.571"', '"0 0 ${forearm}"', 1)
    path.write_text(f"{head}{space}{start}>{prop}{body}", encoding="utf-8")
    return path


def test_the_same_arm(suta_urdf: Path, tmp_path: Path) -> None:
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    other = ArmModel.from_urdf(as_xacro(suta_urdf, tmp_path / "arm.urdf.xacro"), "tip")
    q = np.random.default_rng(0).uniform(-1, 1, (5, len(arm.joints)))
    for mine, theirs in zip(arm.forward(q), other.forward(q), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<robot", "something that xacro refuses"),
        (
            '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="${x}"/>'
            "</robot>",
            "something that xacro refuses .*'x' is not defined",
        ),
        (
            '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'
            '<xacro:include filename="nothing.xacro"/></robot>',
            "something that xacro refuses .*nothing.xacro",
        ),
        ("", "something that xacro refuses"),
    ],
)
def test_what_xacro_refuses_is_said(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.xacro"
    path.write_text(text)
    with pytest.raises(UrdfError, match=says) as refused:
        ArmModel.from_urdf(path, "tip")
    assert str(refused.value).startswith(f"{path}:")
    assert "\n" not in str(refused.value)


def test_a_xacro_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UrdfError, match="no such file"):
        ArmModel.from_urdf(tmp_path / "arm.xacro", "tip")


def test_a_job_with_a_xacro_file(suta_urdf: Path, tmp_path: Path) -> None:
    """The calibrated URDF is the expanded one; the copy beside it holds what the file includes."""
    job = write_simulated_job(tmp_path / "job", suta_urdf)
    arm = as_xacro(suta_urdf, tmp_path / "job/arm.xacro")
    head = '\n<xacro:property name="forearm" value="0.571"/>\n'
    assert head in arm.read_text()
    include = '<xacro:include filename="$(find arm)/parts/lengths.xacro"/>'
    arm.write_text(arm.read_text().replace(head, include))
    (tmp_path / "job/package.xml").write_text("<package><name>arm</name></package>")
    (tmp_path / "job/parts").mkdir()
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    (tmp_path / "job/parts/lengths.xacro").write_text(f"<robot {space}>{head.strip()}</robot>")
    (tmp_path / "job/arm.urdf").unlink()
    job.write_text(job.read_text().replace("arm.urdf", "arm.xacro"))
    assert cli("calibrate", job, "--out", tmp_path / "results") == 0
    found = json.loads((tmp_path / "results/result.json").read_text())["parameters"]
    calibrated = ArmModel.from_urdf(tmp_path / "results/calibrated.urdf", "tip")
    value = found["joint_4.z"]["value"]
    assert calibrated.parameters["joint_4.z"].nominal == pytest.approx(value, abs=1e-12)
    assert value != pytest.approx(0.571, abs=1e-4)
    (tmp_path / "job").rename(tmp_path / "gone")
    out = tmp_path / "kin.yaml"
    assert cli("export", tmp_path / "results", "--format", "xacro-yaml", "--out", out) == 0
    assert out.is_file()


def with_arguments(urdf: Path, path: Path) -> Path:
    """The SUTA whose forearm an argument has: of a default length, of another, or of none."""
    text = as_xacro(urdf, path).read_text()
    declared = '<xacro:arg name="length" default="0.571"/><xacro:arg name="gripper" default=""/>'
    text = text.replace('<xacro:property name="forearm" value="0.571"/>', declared)
    path.write_text(text.replace("${forearm}", "$(arg length)"))
    return path


def test_its_arguments_have_values(suta_urdf: Path, tmp_path: Path) -> None:
    path = with_arguments(suta_urdf, tmp_path / "arm.xacro")
    for length in ("0.6", "0.5", "0.6"):
        arm = ArmModel.from_urdf(XacroFile(path, {"length": length}), "tip")
        assert arm.parameters["joint_4.z"].nominal == float(length)
        assert arm.chain.path == path
    assert ArmModel.from_urdf(path, "tip").parameters["joint_4.z"].nominal == 0.571


def test_arguments_that_it_does_not_have_are_refused(suta_urdf: Path, tmp_path: Path) -> None:
    path = with_arguments(suta_urdf, tmp_path / "arm.xacro")
    with pytest.raises(UrdfError, match=r"'lenght'.*one of gripper, length; did you mean 'length'"):
        ArmModel.from_urdf(XacroFile(path, {"lenght": "0.6"}), "tip")
    with pytest.raises(UrdfError, match=r"without arguments \(length\); expected a .xacro file"):
        ArmModel.from_urdf(XacroFile(suta_urdf, {"length": "0.6"}), "tip")
    path.write_text(path.read_text().replace('<xacro:arg name="length" default="0.571"/>', ""))
    with pytest.raises(UrdfError, match=r"argument 'length'.*--xacro-arg NAME:=VALUE"):
        ArmModel.from_urdf(path, "tip")


def test_a_job_gives_arguments(suta_urdf: Path, tmp_path: Path) -> None:
    job = write_simulated_job(tmp_path / "job", suta_urdf)
    with_arguments(suta_urdf, tmp_path / "job/arm.xacro")
    (tmp_path / "job/arm.urdf").unlink()
    text = job.read_text()
    assert "urdf: arm.urdf" in text

    def given(value: str) -> CalibrationJob:
        job.write_text(text.replace("urdf: arm.urdf", f"urdf: {value}"))
        return CalibrationJob.load(job)

    loaded = given("{file: arm.xacro, args: {length: 0.5715, gripper: true}}")
    assert loaded.arm.parameters["joint_4.z"].nominal == 0.5715
    assert cli("calibrate", job) == 0
    results = tmp_path / "job/results"
    assert cli("validate", results / "calibrated.urdf", results) == 0
    for value, says in (
        ("{file: arm.xacro}", "urdf.args: found no such key"),
        ("{file: arm.xacro, args: {}}", "urdf.args: .*expected a mapping"),
        ("{file: arm.xacro, args: {length: [1]}}", r"urdf.args.length: .*expected text, a number"),
        ("{file: arm.xacro, arguments: {length: 1}}", "urdf.arguments: found an unknown key"),
        ("{file: none.xacro, args: {length: 1}}", "urdf.file: found no file"),
        ("{file: calibration.yaml, args: {length: 1}}", "urdf.args: .*not a .xacro"),
        ("{file: arm.xacro, args: {size: 1}}", "the argument 'size'"),
    ):
        with pytest.raises(InputError, match=says):
            given(value)


def test_a_command_line_gives_arguments(
    suta_urdf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = with_arguments(suta_urdf, tmp_path / "arm.xacro")
    start = ("init", path, "--tip", "tip", "--out", tmp_path / "job")
    assert cli(*start, "--xacro-arg", "length:=0.6", "--xacro-arg", "gripper:=a b:=c") == 0
    spec = read_job(tmp_path / "job/calibration.yaml").arm
    assert isinstance(spec.urdf, XacroFile)
    assert spec.urdf.arguments == {"length": "0.6", "gripper": "a b:=c"}
    assert spec.model().parameters["joint_4.z"].nominal == 0.6
    capsys.readouterr()
    for argument, says in (
        (("--xacro-arg", "length=0.6"), "NAME:=VALUE"),
        (("--xacro-arg", ":=0.6"), "NAME:=VALUE"),
        (("--xacro-arg", "length:=1", "--xacro-arg", "length:=2"), "each name once"),
        (("--xacro-arg", "lenght:=1"), "did you mean 'length'"),
    ):
        assert cli(*start, *argument) == 2
        assert says in capsys.readouterr().err
    csv = tmp_path / "motion.csv"
    assert cli("path-accuracy", csv, csv, "--xacro-arg", "length:=1") == 2
    assert "give it with --urdf" in capsys.readouterr().err
