"""Pictures of a board as they come: from a folder that fills, and from a camera (here a video)."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2")
pytest.importorskip("websockets")

from vision_scenes import CHESSBOARD, facing, taken, write_picture

from suta_calib.assessment import Assessment
from suta_calib.errors import InputError
from suta_calib.guide.live_pictures import LiveOptions, LivePictures
from suta_calib.vision.coverage import BoardCoverage, SeenBoard, moved
from suta_calib.vision.detection import finder_of
from suta_calib.vision.finder import DetectedBoard

SIZE = (640, 480)


@contextmanager
def running(live: LivePictures) -> Iterator[threading.Thread]:
    with live:
        thread = threading.Thread(target=live.run, daemon=True)
        thread.start()
        try:
            yield thread
        finally:
            live.page.press("finish")
            thread.join(20)


def until(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def seen(tilt: tuple[float, float, float]) -> SeenBoard:
    grey = taken(CHESSBOARD, facing(CHESSBOARD, tilt))
    return SeenBoard.of(finder_of(CHESSBOARD).find(grey), CHESSBOARD, grey.shape[::-1])


def test_how_a_board_is_turned_and_what_is_missing() -> None:
    coverage = BoardCoverage()
    assert coverage.advice == "Hold the board in front of the camera"
    facing_it, turned = seen((0, 0, 5)), seen((0, 25, 0))
    # About the camera's y axis its right side goes away, or comes: the normal leans by 25°.
    assert np.abs(np.rad2deg(turned.tilt)) == pytest.approx([25, 0], abs=5)
    assert coverage.is_new(facing_it)
    coverage += facing_it
    assert not coverage.is_new(facing_it)
    assert coverage.is_new(turned)
    assert set(coverage.missing_tilts) == {"left", "right", "top", "bottom"}
    coverage += turned
    assert len(coverage.missing_tilts) == 3
    assert coverage.advice.startswith("Bring the board to the ")
    assert not coverage.enough


def test_a_folder_that_fills(tmp_path: Path) -> None:
    said: list[str] = []
    live = LivePictures(LiveOptions(tmp_path / "pictures", CHESSBOARD, port=0), said.append)
    with running(live) as thread:
        shown = live.page.shown
        until(lambda: shown("doing") == "Waiting for pictures")
        write_picture(tmp_path / "pictures" / "01.png", taken(CHESSBOARD))
        until(lambda: shown("count") == 1)
        assert sum(shown("parts")) > 0
        assert len(shown("tilts")) == 1
        write_picture(tmp_path / "pictures" / "02.png", np.full((480, 640), 90, np.uint8))
        until(lambda: str(shown("doing")).startswith("02.png: the board is not seen"))
        assert shown("count") == 1
        assert not shown("seen")
        assert live.page.page("/picture.jpg") is not None
        (tmp_path / "pictures" / "01.png").unlink()
        until(lambda: shown("count") == 0)
    assert not thread.is_alive()
    assert said[0] == "01.png: the board is found"


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """The board is held still, shown elsewhere, and taken away."""
    import cv2

    file = tmp_path / "held.avi"
    first, second = (taken(CHESSBOARD, facing(CHESSBOARD, t)) for t in ((20, -15, 10), (0, 20, 0)))
    size = first.shape[1], first.shape[0]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, size)
    for grey in [*[first] * 15, np.full_like(first, 90), *[second] * 15]:
        writer.write(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))
    writer.release()
    return file


@pytest.mark.slow
def test_a_camera_takes_what_is_new_and_held_still(tmp_path: Path, video: Path) -> None:
    said: list[str] = []
    folder = tmp_path / "pictures"
    live = LivePictures(LiveOptions(folder, CHESSBOARD, str(video), port=0), said.append)
    with running(live):
        until(lambda: len(list(folder.glob("*.png"))) >= 2)
        # The video begins again: nothing in it is new.
        until(lambda: live.page.shown("doing") == "This is known already")
        count = len(list(folder.glob("*.png")))
        live.page.press("forget")
        until(lambda: any("deleted" in line for line in said))
        assert live.page.shown("buttons")[0]["do"] == "take"
    assert count <= 4
    assert said[0] == "000.png: taken"
    assert not list(folder.glob("*.part"))


def test_the_verdict_is_shown_until_it_is_read(tmp_path: Path) -> None:
    live = LivePictures(LiveOptions(tmp_path / "pictures", CHESSBOARD, port=0), lambda _: None)
    with live:
        live.calibrating()
        live.page.press("end")
        live.conclude(Assessment.of("fine"), (tmp_path / "camera.yaml",))
    assert live.page.shown("verdict")["word"] == "Good"
    assert live.page.shown("verdict")["files"] == ["camera.yaml"]


def test_a_camera_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no video .* that can be opened"):
        LivePictures(LiveOptions(tmp_path, CHESSBOARD, "/no/such.avi", port=0), lambda _: None)


def test_how_far_a_board_moved() -> None:
    def board(numbers: list[int], x: float) -> DetectedBoard:
        pixel = np.array([[10.0 * number + x, 5.0] for number in numbers])
        return DetectedBoard(np.array(numbers), pixel, np.ones(len(numbers)), 1.0)

    assert moved(board([0, 1, 2], 0.0), board([1, 2, 3], 0.0)) == 0.0
    assert moved(board([0, 1, 2], 0.0), board([2], 3.0)) == 3.0
    assert moved(board([0, 1], 0.0), board([2], 3.0)) == np.inf
