"""``suta-calib init`` for a hobby arm: a pen, cameras, LeRobot's motors, and what is printed."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from cli_job import Capture, cli, refused
from servo_arms import URDF

from suta_calib import ArmModel
from suta_calib.device.device_file import read_device
from suta_calib.job.pen import PEN, with_pen
from suta_calib.job.schema import read_job
from suta_calib.measurements import read_artefact, read_board
from suta_calib.model.parameters import POSITION, ROTATION
from suta_calib.units import mm

pytestmark = pytest.mark.usefixtures("undrawn")

MOTORS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
SVG = "{http://www.w3.org/2000/svg}"


def lerobot(path: Path, *names: str) -> Path:
    """A calibration of these motors, as LeRobot writes it."""
    motors = {
        name: {
            "id": k + 1,
            "drive_mode": 0,
            "homing_offset": 7 * k,
            "range_min": 900,
            "range_max": 3100 + k,
        }
        for k, name in enumerate(names)
    }
    path.write_text(json.dumps(motors))
    return path


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("init")
    command = ["init", URDF, "--tip", "hand", "--pen", "--out", folder / "job"]
    command += ["--camera", "wrist=hand", "--camera", "front=beside"]
    command += ["--lerobot", lerobot(folder / "so101.json", *MOTORS), "--port", "/dev/ttyACM1"]
    assert cli(*command) == 0
    return folder / "job"


def test_the_pen_is_a_link_whose_place_is_found(job: Path) -> None:
    arm = ArmModel.from_urdf(job / "arm.urdf", PEN)
    hand = ArmModel.from_urdf(URDF, "hand")
    q = np.array([[0.1, -0.2, 0.3, 0.4, 0.5]])
    assert np.allclose(arm.forward(q)[1], hand.forward(q)[1])
    spec = read_job(job / "calibration.yaml")
    assert spec.arm.tip == PEN
    unknowns = arm.select(*spec.parameters)
    assert [unknowns[f"{PEN}.{key}"].prior for key in POSITION] == [0.05] * 3
    assert not any(unknowns[f"{PEN}.{key}"].free for key in ROTATION)


def test_each_camera_has_a_row_and_a_folder(job: Path) -> None:
    text = (job / "calibration.yaml").read_text()
    rows = re.findall(r"label: \"(\w+)\"\n    target: .*\n    setup: (\S+)\n", text)
    assert rows == [("wrist", "eye-in-hand"), ("front", "eye-to-hand")]
    for name in ("wrist", "front"):
        assert (job / name / "corners.csv").read_text() == "image,point,u,v\n"
        header = (job / name / "samples.csv").read_text()
        assert header == "image,shoulder_pan,shoulder_lift,elbow_flex,wrist_flex,wrist_roll\n"


def test_the_motors_of_lerobot_become_the_device(job: Path) -> None:
    device = read_device(job / "device.yaml")
    assert device.names == MOTORS
    assert device.port == "/dev/ttyACM1"
    assert device.joints[3].zero == 2001
    assert device.joints[3].number == 4


def test_crosses_and_board_are_drawn_where_their_files_have_them(job: Path) -> None:
    root = ElementTree.parse(job / "sheet.svg").getroot()
    assert (root.get("width"), root.get("height")) == ("297mm", "210mm")
    names = [text.text for text in root.iter(f"{SVG}text")][:-1]
    paths = [path.get("d") or "" for path in root.iter(f"{SVG}path")]
    found = np.array([[float(n) for n in re.findall(r"[\d.]+", path)[:2]] for path in paths])
    # The middle of a cross; x points up the page, y to the left.
    middles = found + np.array([8, 0])
    crosses = read_artefact(job / "artefact.yaml").landmarks
    assert names == [*crosses]
    at = np.array([mm(cross.position) for cross in crosses.values()])
    drawn = np.column_stack([-middles[:, 1], -middles[:, 0]])
    assert np.allclose(drawn - drawn[0], (at - at[0])[:, :2], atol=1e-3)
    assert (found > 0).all()
    assert (middles + 8 < [297, 210]).all()
    board = ElementTree.parse(job / "board.svg").getroot()
    squares = [*board.iter(f"{SVG}rect")]
    sides = read_board(job / "board.yaml").row()["corners"]
    assert len(squares) == (sides[0] + 1) * (sides[1] + 1) // 2
    assert {square.get("width") for square in squares} == {"15"}


def test_it_says_what_to_do_next(tmp_path: Path, capsys: Capture) -> None:
    """The link that carries the pen is no other arm."""
    file = lerobot(tmp_path / "so101.json", *MOTORS)
    folder = tmp_path / "job"
    command = ("init", URDF, "--tip", "hand", "--pen", "--lerobot", file, "--out", folder)
    assert cli(*command) == 0
    said = capsys.readouterr()
    assert "other chains" not in said.err
    last = said.out.splitlines()[-1]
    assert last.startswith(f"Next: print {folder}/sheet.svg at 100 %")
    assert last.endswith(f"calibration.yaml --device {folder}/device.yaml --placement table")


def test_what_is_printed_is_measured_with_any_motors(tmp_path: Path, capsys: Capture) -> None:
    assert cli("init", URDF, "--tip", "hand", "--pen", "--out", tmp_path / "job") == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert "sheet.svg at 100 %, and measure with a ruler; then describe the motors" in last
    assert last.endswith("calibration.yaml --device device.yaml --placement table")


def test_motors_of_other_names_are_taken_in_order(tmp_path: Path, capsys: Capture) -> None:
    file = lerobot(tmp_path / "koch.json", *(f"motor_{k}" for k in range(1, 7)))
    assert cli("init", URDF, "--tip", "hand", "--lerobot", file, "--out", tmp_path / "job") == 0
    assert "taken in order. suta-calib motors finds out" in capsys.readouterr().err
    assert read_device(tmp_path / "job/device.yaml").names == (*MOTORS[:5], "motor_6")


def test_meshes_of_the_copy_are_where_they_were(tmp_path: Path) -> None:
    visual = '<link name="base"><visual><geometry><mesh filename="{}"/></geometry></visual></link>'
    names = ("assets/base.stl", "/opt/base.stl", "package://arm/base.stl")
    for name, moved in zip(names, ("../robot/assets/base.stl", *names[1:]), strict=True):
        text = URDF.read_text().replace('<link name="base"/>', visual.format(name))
        copy = with_pen(text, "hand", tmp_path / "robot", tmp_path / "job")
        assert f'<mesh filename="{moved}"/>' in copy


def test_what_init_cannot_use_is_refused(tmp_path: Path) -> None:
    command = ("init", URDF, "--tip", "hand", "--out", tmp_path / "job")
    assert "NAME=hand or NAME=beside" in refused(*command, "--camera", "wrist=table")
    assert "NAME=hand or NAME=beside" in refused(
        *command, "--camera", "a=hand", "--camera", "a=hand"
    )
    assert "it names a folder of samples" in refused(*command, "--camera", "a/b=hand")
    few = lerobot(tmp_path / "few.json", "a", "b")
    assert "2 motors for 5 joints; expected a motor for each joint" in refused(
        *command, "--lerobot", few
    )
    (tmp_path / "pen.urdf").write_text(with_pen(URDF, "hand", tmp_path, tmp_path))
    again = ("init", tmp_path / "pen.urdf", "--tip", "hand", "--pen", "--out", tmp_path / "job")
    assert f"found a link '{PEN}'" in refused(*again)
    assert not (tmp_path / "job").exists()
