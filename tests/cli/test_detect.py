"""``suta-calib detect``: from a folder of pictures to the files that jobs read."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from cli_job import Capture

from suta_calib.cli._app import run
from suta_calib.measurements import read_camera, read_corners


@pytest.fixture(scope="module")
def workcell(repository: Path) -> Path:
    return repository / "data" / "workcell"


def some(workcell: Path, count: int) -> list[str]:
    return [str(file) for file in sorted((workcell / "pictures").iterdir())[:count]]


def test_corners_camera_and_pictures(workcell: Path, tmp_path: Path, capsys: Capture):
    pytest.importorskip("cv2")
    out, camera, board = tmp_path / "c.csv", tmp_path / "k.yaml", workcell / "board.yaml"
    files = ["--out", str(out), "--camera-out", str(camera), "--report", str(tmp_path / "r")]
    line = ["detect", *some(workcell, 6), "--board", str(board), *files, "--pictures", "--json"]
    assert run(line) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["images"], answer["detected"]) == (6, 6)
    assert answer["rms_px"] < 0.05
    assert set(answer["camera"]["std"]) == {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"}
    # The truth is in data/workcell/truth.yaml.
    assert answer["camera"]["fx"] == pytest.approx(612.4, abs=4 * answer["camera"]["std"]["fx"])
    stored, found = read_corners(workcell / "corners.csv"), read_corners(out)
    assert read_camera(camera).stds is not None
    assert read_camera(camera).corners == found.digest
    there = stored.take(np.isin(stored.image, found.images))
    assert np.allclose(found.pixel, there.pixel, atol=0.02)
    assert (tmp_path / "r" / "00.found.jpg").stat().st_size > 1000
    assert "Corners in the picture" in (tmp_path / "r" / "report.html").read_text("utf-8")


def test_a_wrong_board_leaves_nothing_behind(workcell: Path, tmp_path: Path, capsys: Capture):
    pytest.importorskip("cv2")
    board, out = tmp_path / "board.yaml", tmp_path / "c.csv"
    board.write_text("{type: chessboard, corners: [9, 7], square_mm: 25}", encoding="utf-8")
    assert run(["detect", *some(workcell, 1), "--board", str(board), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "9x6 inner corners instead of 9x7" in said
    assert not out.exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--camera", "a", "--camera-out", "b"], "give either --camera"),
        (["--pictures"], "give --report"),
        (["--out", "nowhere/c.csv"], "no folder nowhere"),
    ],
)
def test_options_that_do_not_go_together(
    more: list[str], said: str, workcell: Path, capsys: Capture
):
    line = ["detect", *some(workcell, 1), "--board", str(workcell / "board.yaml"), *more]
    assert run(line) == 2
    assert said in capsys.readouterr().err


def test_without_opencv_the_message_installs_it(
    workcell: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
):
    from suta_calib.vision.opencv import opencv

    opencv.cache_clear()
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert run(["detect", *some(workcell, 1), "--board", str(workcell / "board.yaml")]) == 2
    assert "pip install 'suta_calib[vision]'" in capsys.readouterr().err
    opencv.cache_clear()
