"""A headless Chromium that a test drives through its debugging port."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from itertools import count
from pathlib import Path
from typing import Any, Self

from websockets.sync.client import connect

PROGRAM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
_SWITCHES = (
    *("--headless", "--no-sandbox", "--hide-scrollbars", "--no-first-run"),
    "--remote-debugging-port=0",
)
# What is waited for comes at once; on a busy computer it may take so long, s.
LONGEST = 900.0
# WebGL without a graphics card; it takes more than one core.
WITH_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
WITHOUT_WEBGL = ("--disable-gpu", "--disable-3d-apis")


class Chromium:
    """One page of a browser, 1400 by 900 px at first."""

    def __init__(self, *switches: str) -> None:
        assert PROGRAM is not None
        self._folder = tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True)
        self._number = count(1)
        command = [
            PROGRAM,
            *_SWITCHES,
            *switches,
            f"--user-data-dir={self._folder.name}",
            "about:blank",
        ]
        self._process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def __enter__(self) -> Self:
        try:
            self._page = connect(self._address(), max_size=None, open_timeout=LONGEST)
            self.resize(1400, 900)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()

    def _address(self) -> str:
        """Of the page's debugger."""
        file, end = Path(self._folder.name) / "DevToolsActivePort", time.monotonic() + LONGEST
        while time.monotonic() < end:
            if file.is_file() and (lines := file.read_text().splitlines()):
                listed = f"http://127.0.0.1:{lines[0]}/json/list"
                with urllib.request.urlopen(listed, timeout=LONGEST) as answer:
                    targets = json.load(answer)
                pages = [t for t in targets if t["type"] == "page"]
                if pages:
                    return str(pages[0]["webSocketDebuggerUrl"])
            time.sleep(0.05)
        raise TimeoutError("chromium did not start")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """What the browser answers to a command of its protocol."""
        number = next(self._number)
        self._page.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._page.recv(timeout=LONGEST))
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return dict(answer["result"])

    def resize(self, width: int, height: int, *, dark: bool = False) -> None:
        """Give the page this size, and the colours that the system prefers."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.send("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        # What beats for ever takes half a core to draw.
        still = {"name": "prefers-reduced-motion", "value": "reduce"}
        self.send("Emulation.setEmulatedMedia", features=[scheme, still])

    def open(self, url: str) -> None:
        """Go to an address, and wait until its page is there."""
        self.send("Page.navigate", url=url)
        there = f"location.href === {json.dumps(url)} && document.readyState === 'complete'"
        self.wait(there)

    def evaluate(self, script: str) -> Any:
        """The value of a JavaScript expression."""
        answer = self.send("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, script: str, seconds: float = LONGEST) -> Any:
        """Until an expression is true; its value."""
        end = time.monotonic() + seconds
        # What it is about may not be there yet.
        tried = f"(() => {{ try {{ return {script}; }} catch {{ return null; }} }})()"
        while not (found := self.evaluate(tried)):
            if time.monotonic() > end:
                raise TimeoutError(f"{script}; the page says {self.text!r}")
            time.sleep(0.05)
        return found

    @property
    def text(self) -> str:
        """All that can be read."""
        return str(self.evaluate("document.body.innerText"))

    def picture(self, file: Path) -> None:
        """Write a PNG of what can be seen."""
        file.write_bytes(base64.b64decode(self.send("Page.captureScreenshot")["data"]))
