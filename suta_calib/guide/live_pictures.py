"""Pictures of a board as they are taken: what was found in each, and what is still to be shown.

They come from a camera on this computer, which takes one by itself where the board is held still
and tells something new; or from a folder that another program fills.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty
from types import TracebackType
from typing import Any, Final, Self

import numpy as np

from suta_calib.assessment import Assessment
from suta_calib.errors import InputError, OutputError
from suta_calib.guide.page import GuidePage
from suta_calib.measurements.board import Board
from suta_calib.view.site_server import SiteServer
from suta_calib.vision.coverage import PARTS, BoardCoverage, SeenBoard, degrees, moved
from suta_calib.vision.detection import finder_of
from suta_calib.vision.drawing import live_drawing
from suta_calib.vision.finder import DetectedBoard, NotSeenError
from suta_calib.vision.opencv import open_video, opencv
from suta_calib.vision.pictures import (
    Grey,
    UnusablePictureError,
    find_pictures,
    read_picture,
    save_picture,
)

_PAUSE: Final = 0.1
_BUTTONS: Final = [
    {"do": "take", "label": "Take now"},
    {"do": "forget", "label": "Delete the last"},
    {"do": "finish", "label": "Calibrate"},
]


@dataclass(frozen=True)
class LiveOptions:
    """Where pictures come from, and who may look.

    Attributes:
        folder: of the pictures; what is in it counts.
        board: that is held.
        video: number of a camera, or what else OpenCV opens as a video; empty for a folder that
            another program fills.
        port, host: of the page.
    """

    folder: Path
    board: Board
    video: str = ""
    port: int = 8080
    host: str = "127.0.0.1"


class LivePictures:
    """The page for as long as pictures come; a context manager.

    Args:
        options: where pictures come from.
        say: shows the console a line.

    Raises:
        InputError: the camera cannot be opened.
        OutputError: the folder cannot be made, or the port is taken.
    """

    def __init__(self, options: LiveOptions, say: Callable[[str], None]) -> None:
        self._options, self._say = options, say
        self._finder = finder_of(options.board)
        try:
            options.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{options.folder}: not made: {error.strerror}") from error
        self._video = Video(options.video) if options.video else None
        self.page = GuidePage(options.folder.resolve().name, "detect")
        self._server = SiteServer(self.page, options.port, options.host)
        self._seen: dict[Path, SeenBoard | None] = {}
        self._size: tuple[int, int] = (0, 0)

    def __enter__(self) -> Self:
        self._server.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._video is not None:
            self._video.close()
        self._server.__exit__(kind, error, trace)

    @property
    def url(self) -> str:
        """Of the page."""
        return self._server.url

    def run(self) -> None:
        """Take pictures, or wait for them, until somebody has enough.

        Raises:
            OutputError: a picture cannot be written.
        """
        self.page.show(phase="taking", buttons=_BUTTONS if self._video else _BUTTONS[-1:])
        self._look_into_folder()
        frames = iter(()) if self._video is None else self._video.frames()
        before: DetectedBoard | None = None
        while (pressed := self._pressed()) != "finish":
            if self._video is None:
                time.sleep(_PAUSE)
                self._look_into_folder()
                continue
            frame = next(frames, None)
            if frame is None:
                self.page.show(doing="No pictures come: check the cable of the camera", seen=False)
                time.sleep(_PAUSE)
                continue
            if pressed == "forget" and self._seen:
                self._forget()
            before = self._look_at(frame, before, now=pressed == "take")

    def conclude(self, assessment: Assessment, files: tuple[Path, ...]) -> None:
        """Show the verdict until somebody has read it."""
        self.page.link(files)
        self.page.show(
            phase="done",
            verdict={
                "level": assessment.level,
                "word": assessment.word,
                "text": assessment.statement,
                "notes": list(assessment.notes),
                "files": [file.name for file in files],
            },
            buttons=[{"do": "end", "label": "End"}],
        )
        while self._pressed() != "end":
            time.sleep(_PAUSE)

    def calibrating(self) -> None:
        """Show that it is being computed."""
        self.page.show(phase="calibrating", doing="", buttons=[])

    def _pressed(self) -> str:
        with suppress(Empty):
            return self.page.pressed.get_nowait()
        return ""

    # ── a camera ────────────────────────────────────────────────────────────────────────────
    def _look_at(
        self, frame: Any, before: DetectedBoard | None, *, now: bool
    ) -> DetectedBoard | None:
        """One picture of the camera: shown, and kept if it tells something new."""
        grey: Grey = opencv().cvtColor(frame, opencv().COLOR_BGR2GRAY)
        self._size = grey.shape[1], grey.shape[0]
        detected, why = self._found(grey)
        self._show(grey, detected)
        if detected is None:
            self.page.show(doing=f"The board is not seen: {why}", seen=False)
            return None
        view = SeenBoard.of(detected, self._options.board, self._size)
        new = self._coverage.is_new(view)
        # A board is held still while its corners move by less than this, of the picture's width,
        # from one search to the next: an exposure of 1/30 s then blurs them by less than a tenth of
        # a pixel.
        still = before is not None and moved(before, detected) < 0.002 * self._size[0]
        if now or (new and still):
            self._keep(frame, view)
            return detected
        self.page.show(doing="Hold still" if new else "This is known already", seen=True)
        return detected

    def _keep(self, frame: Any, view: SeenBoard) -> None:
        """Write a picture, and count it; when it is shown as taken it is on the disk."""
        path = save_picture(self._options.folder, frame)
        self._seen[path] = view
        self._say(f"{path.name}: taken")
        self._tell(f"{path.name} is taken")

    def _forget(self) -> None:
        path = list(self._seen)[-1]
        del self._seen[path]
        path.unlink(missing_ok=True)
        self._say(f"{path.name}: deleted")
        self._tell(f"{path.name} is deleted")

    # ── a folder ────────────────────────────────────────────────────────────────────────────
    def _look_into_folder(self) -> None:
        """Search the pictures that have come, and forget those that have gone."""
        try:
            there = [picture.path for picture in find_pictures([self._options.folder])]
        except InputError:
            there = []  # There is none yet.
        gone = [path for path in self._seen if path not in there]
        for path in gone:
            del self._seen[path]
        new = [path for path in there if path not in self._seen]
        for path in new:
            try:
                grey = read_picture(path)
            except UnusablePictureError as problem:
                # It may still be being written.
                if time.time() - path.stat().st_mtime < 1.0:
                    continue
                self._seen[path] = None
                self._tell(f"{path.name}: {problem.found}", seen=False)
                continue
            self._size = grey.shape[1], grey.shape[0]
            detected, why = self._found(grey)
            self._show(grey, detected)
            self._seen[path] = (
                None
                if detected is None
                else SeenBoard.of(detected, self._options.board, self._size)
            )
            what = f"the board is not seen: {why}" if detected is None else "the board is found"
            self._say(f"{path.name}: {what}")
            self._tell(f"{path.name}: {what}", seen=detected is not None)
        if (gone or not self._seen) and not new:
            self._tell("Waiting for pictures" if not self._seen else "")

    # ── both ────────────────────────────────────────────────────────────────────────────────
    @property
    def _coverage(self) -> BoardCoverage:
        return BoardCoverage(tuple(view for view in self._seen.values() if view is not None))

    def _found(self, grey: Grey) -> tuple[DetectedBoard | None, str]:
        try:
            return self._finder.find(grey), ""
        except NotSeenError as problem:
            return None, problem.found

    def _show(self, grey: Grey, detected: DetectedBoard | None) -> None:
        self.page.show_picture(live_drawing(grey, detected))

    def _tell(self, doing: str, *, seen: bool = True) -> None:
        coverage = self._coverage
        self.page.show(
            doing=doing,
            seen=seen,
            count=len(coverage.taken),
            columns=PARTS[0],
            parts=coverage.parts.ravel().tolist(),
            tilts=degrees(coverage.tilts),
            missing=list(coverage.missing_tilts),
            advice=coverage.advice,
            enough=coverage.enough,
        )


class Video:
    """Frames of a camera, or of a video: always the latest, however long one is looked at.

    Raises:
        InputError: it cannot be opened.
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._capture = open_video(source)
        if self._capture is None:
            what = "camera" if source.isdigit() else "video"
            raise InputError(
                f"no {what} {source} that can be opened",
                "the number of a camera that is plugged in, such as 0, or a file or address of a "
                "video",
                where="--video",
                hint="is another program using it?",
            )
        self._latest: Any = None
        self._wake, self._over = threading.Condition(), False
        self._thread = threading.Thread(target=self._read, name="video", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Let go of the camera."""
        self._over = True
        self._thread.join(2.0)
        if self._capture is not None:
            self._capture.release()

    def frames(self) -> Iterator[Any]:
        """The latest picture again and again; None where none came for a second."""
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._latest is not None, 1.0)
                frame, self._latest = self._latest, None
            yield frame

    def _read(self) -> None:
        """Read as fast as pictures come; one that was pulled out is opened again."""
        rate = self._capture.get(opencv().CAP_PROP_FPS)
        # A file gives its pictures at once, a camera as they are taken.
        pause = 1.0 / rate if not self._source.isdigit() and 1.0 < rate < 1000.0 else 0.0
        while not self._over:
            done, frame = (False, None) if self._capture is None else self._capture.read()
            if done:
                with self._wake:
                    self._latest = np.asarray(frame)
                    self._wake.notify()
                time.sleep(pause)
                continue
            if self._capture is not None:
                self._capture.release()
            time.sleep(0.5)
            self._capture = open_video(self._source)
