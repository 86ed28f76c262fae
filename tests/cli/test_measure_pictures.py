"""``suta-calib measure --camera``: a picture at each rest, named beside the joints' readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_job import cli, refused
from five_joints import AXES, urdf

from suta_calib import ArmModel
from suta_calib.acquisition.measuring import MeasureOptions
from suta_calib.acquisition.pictures import (
    FOLDER,
    NothingSeenError,
    RestPictures,
    SoughtBoard,
    narrow_postures,
)
from suta_calib.arrays import FloatArray
from suta_calib.emulation import EmulatedArm, EmulationOptions, Timing
from suta_calib.emulation.emulated import emulated_device
from suta_calib.errors import DeviceError, InputError
from suta_calib.geometry.numbers import homogeneous, rotation_from_rpy
from suta_calib.job.new_job import new_job, write_job
from suta_calib.measurements import Camera, read_board, read_corners, read_csv_table
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND
from suta_calib.vision import RenderOptions, rendered

cv2 = pytest.importorskip("cv2")


@pytest.fixture
def camera(tmp_path: Path) -> str:
    """Numbered pictures in place of a camera, each of another grey."""
    folder = tmp_path / "camera"
    folder.mkdir()
    for k in range(8):
        cv2.imwrite(str(folder / f"{k:02}.png"), np.full((12, 16, 3), 20 * k, np.uint8))
    return str(folder / "%02d.png")


def grey(path: Path) -> int:
    return int(cv2.imread(str(path))[0, 0, 0]) // 20


def test_pictures_are_numbered_on_and_nothing_is_overwritten(camera: str, tmp_path: Path) -> None:
    folder = tmp_path / "wrist" / FOLDER
    pictures = RestPictures(camera, folder)
    assert [pictures()["image"] for _ in range(2)] == ["000.png", "001.png"]
    pictures.close()
    again = RestPictures(camera, folder)
    assert again()["image"] == "002.png"
    assert [grey(folder / f"00{k}.png") for k in range(3)] == [0, 1, 0]
    for _ in range(7):
        again()
    with pytest.raises(DeviceError, match="no picture from the camera"):
        again()


def test_corners_are_found_as_pictures_are_taken(tmp_path: Path) -> None:
    """By the job's row of the camera; a picture without the board is not kept."""
    job = tmp_path / "job"
    arm = ArmModel.from_urdf(urdf(AXES["crossed"]), "tip")
    cameras = {"wrist": EYE_IN_HAND, "front": EYE_TO_HAND}
    write_job(new_job(arm, job, urdf=tmp_path / "arm.urdf", cameras=cameras))
    board = read_board(job / "board.yaml")
    lens = Camera(640, 480, np.array([600.0, 600, 319.5, 239.5, 0, 0, 0, 0, 0]))
    random, there = np.random.default_rng(1), list[FloatArray]()
    for k, x in enumerate((-0.05, None, -0.04)):
        picture = np.full((480, 640), 128, np.uint8)
        if x is not None:
            pose = homogeneous(rotation_from_rpy([0.2, 0.3, 0.1]), np.array([x, -0.03, 0.3]))
            picture = rendered(board, lens, pose, random, RenderOptions(samples=2))
            points = np.array([*board.points.values()])
            there.append(lens.project(points @ pose[:3, :3].T + pose[:3, 3]))
        cv2.imwrite(str(tmp_path / f"{k:02}.png"), picture)
    sought = SoughtBoard.of(job / "calibration.yaml", "wrist")
    assert sought is not None
    assert SoughtBoard.of(job / "calibration.yaml", "side") is None
    pictures = RestPictures(str(tmp_path / "%02d.png"), job / "wrist" / FOLDER, sought)
    assert pictures() == {"image": "000.png"}
    with pytest.raises(NothingSeenError, match="an empty picture"):
        pictures()
    assert pictures() == {"image": "001.png"}
    corners = read_corners(job / "wrist/corners.csv")
    assert corners.images == ["000.png", "001.png"]
    assert len(corners) == 80
    np.testing.assert_allclose(corners.table(board.points), there, atol=0.2)
    assert (job / "front/corners.csv").read_text() == "image,point,u,v\n"


def test_joints_that_moved_little_are_told() -> None:
    """An angle beyond half a turn is that of its readings."""
    angles = [np.radians(row) for row in ((170, 0, 0), (-175, 40, 20), (-100, 80, 45))]
    told = narrow_postures(("pan", "lift", "roll"), angles)
    assert "moved by less than 60 deg: roll 45. The farther" in told
    assert not narrow_postures(("pan", "lift", "roll"), angles[:1])
    assert not narrow_postures(("lift",), [row[1:2] for row in angles])


def test_what_is_no_camera_is_refused(camera: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--camera: found no camera '.*nothing.png'"):
        RestPictures(str(tmp_path / "nothing.png"), tmp_path)
    device = tmp_path / "device.yaml"
    for given, free in ((camera, True), ("a/b=0", True), ("wrist=", True), ("wrist=0", False)):
        labels = {} if free else {"point": "F1"}
        options = MeasureOptions(tmp_path, device, labels, free=free, camera=given)
        with pytest.raises(InputError, match=r"NAME=NUMBER|at each rest"):
            options.check()
    words = ("measure", tmp_path / "job.yaml", "--recording", device, "--free")
    assert "--free and --device" in refused(*words, "--camera", f"wrist={camera}")


@pytest.mark.slow
def test_each_rest_of_an_arm_has_its_picture(camera: str, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(AXES["crossed"]))
    job = tmp_path / "calibration.yaml"
    job.write_text("arm: {urdf: arm.urdf, tip: tip}\n")
    options = EmulationOptions(
        tmp_path / "arm.urdf",
        tip="tip",
        rate=200.0,
        motion="postures",
        directions=6,
        timing=Timing(1.2, 0.4),
    )
    with EmulatedArm(emulated_device(options).emulation, patient=True) as emulator:
        emulator.write_device(tmp_path / "device.yaml")
        words = ("measure", job, "--device", tmp_path / "device.yaml", "--free", "--yes")
        more = ("--rests", 4, "--seconds", 0.4, "--camera", f"wrist={camera}")
        assert cli(*map(str, (*words, *more))) == 0
    table = read_csv_table(tmp_path / "wrist/samples.csv")
    names = table.labels("image").tolist()
    assert names == [f"00{k}.png" for k in range(4)]
    assert [grey(tmp_path / "wrist" / FOLDER / name) for name in names] == [0, 1, 2, 3]
