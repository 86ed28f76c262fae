"""Who may look at a scene in the browser: whoever has its address, and no other web page."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from cli_job import write_simulated_job
from simulated import SUTA_URDF

from suta_calib.job.calibration import CalibrationJob
from suta_calib.view.access import Access
from suta_calib.view.calibration import view_calibration
from suta_calib.view.server import Viewer

viser = pytest.importorskip("viser")
UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}",
}


@pytest.fixture(scope="module")
def viewer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewer]:
    job = write_simulated_job(tmp_path_factory.mktemp("job"), SUTA_URDF)
    with view_calibration(CalibrationJob.load(job).run().calibrated) as served:
        yield served


def exchange(viewer: Viewer, text: str, *, reset: bool = False) -> bytes:
    """The first line of what a server answers; with ``reset`` the connection is cut off."""
    to = ("127.0.0.1", viewer.server.get_port())
    with socket.create_connection(to, timeout=10) as client:
        client.sendall(text.encode("latin-1"))
        if reset:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            return b""
        return client.recv(4096).partition(b"\r\n")[0]


def request(viewer: Viewer, path: str = "", **headers: str) -> bytes:
    """The first line of the answer to a request of ``path`` below the viewer's address."""
    url = urlsplit(viewer.url)
    given = {"Host": url.netloc, **{key.replace("_", "-"): v for key, v in headers.items()}}
    lines = [f"GET {path or url.path} HTTP/1.1", *(f"{k}: {v}" for k, v in given.items())]
    return exchange(viewer, "\r\n".join([*lines, "", ""]))


OPENED, GIVEN, REFUSED = b"HTTP/1.1 101", b"HTTP/1.1 200", b"HTTP/1.1 403"


def test_who_has_the_address_sees_it(viewer: Viewer) -> None:
    url = urlsplit(viewer.url)
    assert request(viewer).startswith(GIVEN)
    assert request(viewer, url.path + "?darkMode").startswith(GIVEN)
    # As the page that viser serves asks: its own address, without the slash.
    asked = {**UPGRADE, "Origin": f"http://{url.netloc}"}
    assert request(viewer, url.path.rstrip("/"), **asked).startswith(OPENED)
    # Through a tunnel the port is another one.
    assert request(viewer, Host="localhost:9000", Origin="http://localhost:9000").startswith(GIVEN)


@pytest.mark.parametrize("upgrade", [{}, UPGRADE])
@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {}),
        ("/index.html", {}),
        ("/0123456789abcdef0123456789abcdef/", {}),
        ("/%C3%A4/", {}),
        ("", {"Host": "evil.example:8080"}),
        ("", {"Host": "127.0.0.1.evil.example"}),
        ("", {"Host": "[::1"}),
        ("", {"Origin": "http://evil.example"}),
        ("", {"Origin": "null"}),
        ("", {"Origin": "http://127.0.0.1:1"}),
    ],
)
def test_no_other_page_gets_an_answer(
    viewer: Viewer, path: str, headers: dict[str, str], upgrade: dict[str, str]
) -> None:
    assert request(viewer, path, **{**upgrade, **headers}).startswith(REFUSED)


def test_hostile_requests_leave_it_serving_and_silent(
    viewer: Viewer, capfd: pytest.CaptureFixture[str]
) -> None:
    path, host = urlsplit(viewer.url).path, f"Host: {urlsplit(viewer.url).netloc}\r\n"
    upgrade = "".join(f"{key}: {value}\r\n" for key, value in UPGRADE.items())
    start = f"GET {path} HTTP/1.1\r\n"
    for text in (
        "\0\1\2\r\n\r\n",
        "GET / HTTP/9.9\r\n\r\n",
        "POST / HTTP/1.1\r\n\r\n",
        "GET /" + "a" * 20_000 + " HTTP/1.1\r\n\r\n",
        f"{start}\r\n",
        f"{start}{host}{host}\r\n",
        f"{start}{host}{upgrade.replace(viser.__version__, '0.0')}\r\n",
        f"{start}{host}{upgrade.replace('dGhl', '####')}\r\n",
        f"{start}{host}{upgrade}\r\n\xff\xff\xff\xff",
        # A text message, where viser's are binary; then one that is no message of viser's.
        f"{start}{host}{upgrade}\r\n\x81\x82\x01\x02\x03\x04ab",
        f"{start}{host}{upgrade}\r\n\x82\x82\x01\x02\x03\x04ab",
    ):
        exchange(viewer, text)
        exchange(viewer, text, reset=True)
        exchange(viewer, text[: len(text) // 2], reset=True)
    time.sleep(0.2)
    assert request(viewer).startswith(GIVEN)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("host", "name", "ours"),
    [
        ("127.0.0.1", "localhost:8080", True),
        ("127.0.0.1", "192.168.0.7:8080", False),
        ("192.168.0.7", "192.168.0.7", True),
        ("0.0.0.0", "192.168.0.7:8080", True),
        ("0.0.0.0", f"{socket.gethostname()}:8080", True),
        ("0.0.0.0", "evil.example", False),
        ("::", "[fe80::1]:8080", True),
    ],
)
def test_the_name_of_this_computer(host: str, name: str, ours: bool) -> None:
    assert Access(host)._is_ours(name) is ours
