"""The page: what it shows, and what is pressed on it.

What is shown is one mapping; of it every browser gets what has changed since it was told last. So
all browsers show the same, and one that comes late, or comes back, lacks nothing.
"""

from __future__ import annotations

import asyncio
import json
import mimetypes
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Final, Self

from suta_calib.acquisition.guided import Keyboard
from suta_calib.optional_packages import load
from suta_calib.view.access import Page

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

# A browser sends the name of a button.
_LONGEST: Final = 40


class GuidePage:
    """A `Site`: a page, the files that it links to, and the buttons on it.

    Args:
        title: what it is about.
        command: whose page it is: its parts and what moves them are in ``templates``.

    Attributes:
        pressed: names of buttons that were pressed, and nobody has asked for yet.
    """

    def __init__(self, title: str, command: str = "guide") -> None:
        self.pressed: SimpleQueue[str] = SimpleQueue()
        self._command, self._picture = command, b""
        self._shown: dict[str, Any] = {"title": title, "browsers": 0}
        self._files: dict[str, Path] = {}

    def show(self, **parts: Any) -> None:
        """Show other values of these parts, JSON data, in place of what they were."""
        # As one: a browser is told from another thread.
        self._shown = {**self._shown, **parts}

    def shown(self, part: str) -> Any:
        """What a part shows now; None for nothing."""
        return self._shown.get(part)

    def link(self, paths: Iterable[Path]) -> None:
        """Let these files be opened from the page, by their names."""
        self._files = {path.name: path for path in paths}

    def show_picture(self, jpeg: bytes) -> None:
        """Show another live picture, which stands at ``/picture.jpg``."""
        self._picture = jpeg
        self.show(picture=self._shown.get("picture", 0) + 1)

    def press(self, button: str) -> None:
        """As if the button had been pressed."""
        self.pressed.put(button)

    def page(self, path: str) -> Page | None:
        """What stands at a path."""
        if path == "/":
            page = _template("page.html").replace("{{parts}}", _template(f"{self._command}.html"))
            return _text("page.html", page.replace("{{command}}", self._command))
        if path[1:] in ("page.css", "page.js", f"{self._command}.js"):
            return _text(path, _template(path[1:]))
        if path == "/picture.jpg" and self._picture:
            return Page(self._picture, "image/jpeg")
        file = self._files.get(path.removeprefix("/files/"))
        if file is None:
            return None
        media = mimetypes.guess_type(file.name)[0] or "text/plain; charset=utf-8"
        with suppress(OSError):
            return Page(file.read_bytes(), "text/html; charset=utf-8" if "html" in media else media)
        return None

    async def talk(self, connection: ServerConnection) -> None:
        """Tell a browser what is shown, and take what is pressed there."""
        closed = load("websockets.exceptions", "view").ConnectionClosed
        self._count(1)
        telling = asyncio.create_task(self._tell(connection))
        try:
            async for message in connection:
                with suppress(ValueError):
                    button = json.loads(message[: 2 * _LONGEST])
                    if isinstance(button, str) and len(button) <= _LONGEST:
                        self.press(button)
        except closed:
            pass
        finally:
            telling.cancel()
            with suppress(asyncio.CancelledError, closed):
                await telling
            self._count(-1)

    async def _tell(self, connection: ServerConnection) -> None:
        told: Mapping[str, Any] = {}
        while True:
            shown = self._shown
            news = {name: part for name, part in shown.items() if told.get(name, told) is not part}
            if news:
                await connection.send(json.dumps(news))
                told = shown
            # How often a browser is told, s.
            await asyncio.sleep(0.1)

    def _count(self, more: int) -> None:
        self.show(browsers=self._shown["browsers"] + more)


def _template(name: str) -> str:
    return files("suta_calib.guide").joinpath("templates", name).read_text(encoding="utf-8")


def _text(name: str, content: str) -> Page:
    return Page(content.encode(), f"{mimetypes.guess_type(name)[0]}; charset=utf-8")


class PageKeys:
    """Buttons of the page as keys of a session, and the console's keys beside them.

    What is not a key of a session waits in ``others``.
    """

    terminal = True
    _KEYS: Final = {"take": "\n", "retake": "r", "skip": "s", "stop": "q"}

    def __init__(self, page: GuidePage) -> None:
        self._page = page
        self._console = Keyboard()

    def __enter__(self) -> Self:
        self._console.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self._console.__exit__(*exception)

    def key(self) -> str | None:
        """The next one; None for none."""
        with suppress(Empty):
            # Others are of no use while the session runs.
            return self._KEYS.get(self._page.pressed.get_nowait())
        return self._console.key() if self._console.terminal else None
