"""The page over HTTP: who has its address gets it, is told what changes, and may press buttons."""

from __future__ import annotations

import json
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from suta_calib.acquisition import StopFinder
from suta_calib.device import decoder_for
from suta_calib.emulation import Emulation, Stops, device_of, frames
from suta_calib.errors import OutputError
from suta_calib.guide.page import GuidePage, PageKeys
from suta_calib.model.arm import ArmModel
from suta_calib.view.measuring import Mark, MeasuredArm

pytest.importorskip("viser")


@pytest.fixture(scope="module")
def page() -> GuidePage:
    return GuidePage("the bench")


@pytest.fixture(scope="module")
def served(page: GuidePage, repository: Path) -> Iterator[MeasuredArm]:
    arm = ArmModel.from_urdf(repository / "urdf" / "suta.urdf", "tip")
    with MeasuredArm("job", arm, 0, "127.0.0.1", page) as served:
        yield served


def status(url: str) -> int:
    try:
        with urllib.request.urlopen(url, timeout=5) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


def talk(served: MeasuredArm, path: str = "talk") -> ClientConnection:
    return connect(served.url.replace("http", "ws") + path)


def heard(client: ClientConnection, part: str) -> Any:
    end = time.monotonic() + 5
    while time.monotonic() < end:
        news = json.loads(client.recv(timeout=5))
        if part in news:
            return news[part]
    raise TimeoutError(part)


def test_what_stands_where(served: MeasuredArm, page: GuidePage, tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    report.write_text("<p>report</p>")
    page.link([report])
    with urllib.request.urlopen(served.url, timeout=5) as answer:
        assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
        assert b"suta-calib guide" in answer.read()
    assert status(served.url + "scene/") == 200
    assert status(served.url + "files/report.html") == 200
    report.unlink()
    for path in ("files/report.html", "files/../page.py", "nothing", "files/"):
        assert status(served.url + path) == 404, path
    without_key = served.url.rpartition("/")[0].rpartition("/")[0]
    for path in ("/", "/scene/", "/talk", "/files/report.html"):
        assert status(without_key + path) == 403, path


def test_every_browser_is_told_what_changes(served: MeasuredArm, page: GuidePage) -> None:
    page.show(phase="measuring")
    with talk(served) as first, talk(served) as second:
        assert heard(first, "title") == "the bench"
        assert heard(second, "phase") == "measuring"
        page.show(phase="between")
        assert heard(first, "phase") == heard(second, "phase") == "between"
        first.send('"retake"')
        assert page.pressed.get(timeout=5) == "retake"
        for noise in ("", "{", "7", '"' + "a" * 100 + '"', b"\xff\x00"):
            second.send(noise)
        second.send('"skip"')
        assert page.pressed.get(timeout=5) == "skip"
        assert page.pressed.empty()
        assert page.shown("browsers") == 2
    # One that comes late lacks nothing.
    with talk(served) as late:
        assert heard(late, "phase") == "between"


def test_the_scene_stands_beside_the_page(served: MeasuredArm) -> None:
    version = f"viser-v{pytest.importorskip('viser').__version__}"
    url = served.url.replace("http", "ws") + "scene"
    with connect(url, subprotocols=[version], max_size=None) as client:  # type: ignore[list-item]
        assert len(client.recv(timeout=20)) > 100
    with pytest.raises(InvalidStatus):
        connect(url)


def test_nobody_else_may_talk(served: MeasuredArm) -> None:
    with pytest.raises(InvalidStatus):
        connect(served.url.replace("http", "ws") + "other")
    with pytest.raises(InvalidStatus):
        connect(served.url.replace("http", "ws") + "talk", origin="http://evil.example")  # type: ignore[arg-type]


def test_buttons_are_keys(page: GuidePage) -> None:
    keys = PageKeys(page)
    for button in ("retake", "finish", "skip", "take", "stop"):
        page.press(button)
    with keys:
        assert [keys.key() for _ in range(5)] == ["r", None, "s", "\n", "q"]


def test_the_arm_moves_among_its_places(served: MeasuredArm) -> None:
    assert not served.seen
    served.move(np.radians([15, 175, 160, 110, -90, -125]))
    served.mark([Mark("O", np.zeros(3), "taken"), Mark("M1", np.ones(3), "next")])
    served.mark([])
    assert served.seen


def test_a_port_that_is_taken_is_named(served: MeasuredArm, repository: Path) -> None:
    arm = ArmModel.from_urdf(repository / "urdf" / "suta.urdf", "tip")
    port = int(served.url.split(":")[2].partition("/")[0])
    with pytest.raises(OutputError, match=r"another program that listens there.*--port"):
        MeasuredArm("job", arm, port, "127.0.0.1", GuidePage(""))


def test_readings_are_drawn_with_less_than_half_a_processor(
    served: MeasuredArm, page: GuidePage, repository: Path
) -> None:
    arm = ArmModel.from_urdf(repository / "urdf" / "suta.urdf", "tip")
    posture, seconds = np.radians([15, 175, 160, 110, -90, -125]), 2
    motion = Stops(np.array([posture, posture + 0.2]), ({}, {}), rest=1.0, move=0.5)
    sent = list(frames(Emulation(device_of(arm), motion, noise=1.7e-5), float(seconds)))
    decoder, finder = decoder_for(device_of(arm)), StopFinder(arm.joints, 0.5)
    began = time.process_time()
    # 768 a second in 38 pieces, of which twenty are drawn.
    for number, piece in enumerate(np.array_split(np.arange(len(sent)), 38 * seconds)):
        readings = [r for k in piece for r in decoder.feed(sent[k][1], sent[k][0])]
        finder.feed(readings)
        if number % 2 and readings:
            served.move(readings[-1].angles)
            page.show(live={"share": number})
    assert len(sent) == 768 * seconds
    assert (time.process_time() - began) / seconds < 0.5
