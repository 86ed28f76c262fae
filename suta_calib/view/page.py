"""A scene in one file that opens offline: viser's own page, and a server for it inside the page.

The file holds what viser serves a browser that begins to look: its page, and every message about
scene and panel. A script of ours (`offline.js`) takes the place of the connection in it: it hands
these messages over, and answers what is moved and clicked as `Viewer` does.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from dataclasses import asdict
from html import escape
from importlib import resources
from typing import TYPE_CHECKING, Any, Final
from urllib.request import ProxyHandler, build_opener

import numpy as np

from suta_calib.extras import load
from suta_calib.view.scene import Arrows, Ellipsoids, Scene
from suta_calib.view.server import NEAR, Viewer, headline

if TYPE_CHECKING:
    from suta_calib.view.drawing import ShownArm
    from suta_calib.view.drawn_arm import DrawnArm

# Id of the script element that holds the data.
DATA: Final = "suta-calib-scene"
# Longer than any scene takes to come from this computer, s.
_PATIENCE: Final = 60.0
_ALIGNED: Final = 8
# What viser draws by chance or counts from one scene to the next, so that one scene would make
# another file each time.
_DRAWN: Final = re.compile(
    r'(?<="run_id": ")[0-9a-f]+|[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}', re.ASCII
)
_COUNTED: Final = re.compile(r'(?<="order": )\d+', re.ASCII)


def page(scene: Scene) -> bytes:
    """A scene as one HTML file, which needs no network and has the panel of `Viewer`.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
    """
    with Viewer(scene, port=0) as viewer:
        viewer.add_panel()
        # This computer speaks to itself, whatever proxy it reaches others by.
        with build_opener(ProxyHandler({})).open(viewer.url) as answer:
            html: str = answer.read().decode()
        messages, buffers = _told(viewer)
        told = {"messages": messages, "scene": _moved(viewer)}
    data = base64.b64encode(gzip.compress(_packed(told, buffers), 9, mtime=0)).decode()
    script = resources.files("suta_calib.view").joinpath("offline.js").read_text("utf-8")
    ours = (
        f'<script type="application/octet-stream" id="{DATA}">{data}</script>'
        f"<script>{script}</script>"
    )
    html = html.replace("<title>Viser", f"<title>{escape(scene.title)}", 1)
    html = html.replace('"Viser client"', f'"{escape(scene.summary)}"', 1)
    html = html.replace("<noscript>", f"<noscript>{headline(scene)}", 1)
    # First of all, for the page's own script connects when it is read.
    return html.replace("<script", f"{ours}<script", 1).encode()


def _told(viewer: Viewer) -> tuple[list[Any], list[bytes]]:
    """Every message a browser gets that begins to look, and the arrays they refer to by number.

    A frame is, after two lengths of 8 bytes, MessagePack in Zstandard and then the arrays, each
    at a multiple of 8 bytes.
    """
    connect = load("websockets.sync.client", "view").connect
    version = load("viser", "view").__version__
    decode = load("msgspec", "view").msgpack.decode
    zstandard = load("zstandard", "view")
    messages: list[Any] = []
    buffers: list[bytes] = []
    url = viewer.url.replace("http", "ws", 1)
    with connect(url, subprotocols=[f"viser-v{version}"], max_size=None, proxy=None) as socket:
        while not any(message["type"] == "ReplayDoneMessage" for message in messages):
            frame = socket.recv(_PATIENCE)
            size, length = np.frombuffer(frame, "<u8", 2).tolist()
            at = 16 + length
            inner = zstandard.ZstdDecompressor().decompress(frame[16:at], max_output_size=size)
            told = decode(inner)
            messages += (_renumbered(message, len(buffers)) for message in told["messages"])
            for each in told["binaryBufferLengths"] or ():
                at += -at % _ALIGNED
                buffers.append(frame[at : at + each])
                at += each
    return messages, buffers


def _renumbered(value: Any, first: int) -> Any:
    """A message whose arrays are counted from another number."""
    if isinstance(value, dict) and "__binary_index" in value:
        return {**value, "__binary_index": value["__binary_index"] + first}
    if isinstance(value, dict):
        return {key: _renumbered(each, first) for key, each in value.items()}
    if isinstance(value, list):
        return [_renumbered(each, first) for each in value]
    return value


def _packed(told: dict[str, Any], buffers: list[bytes]) -> bytes:
    """The length of what is told, 8 bytes; itself as JSON; then the arrays, aligned.

    Names that viser draws become numbers in the order in which they come, and its own begin at 0.
    """
    plain = json.dumps({**told, "lengths": [len(each) for each in buffers]})
    names = {name: str(k) for k, name in enumerate(dict.fromkeys(_DRAWN.findall(plain)))}
    named = _DRAWN.sub(lambda found: names[found[0]], plain)
    first = min(map(int, _COUNTED.findall(named)), default=0)
    text = _COUNTED.sub(lambda found: str(int(found[0]) - first), named).encode()
    parts = [len(text).to_bytes(_ALIGNED, "little"), text]
    at = _ALIGNED + len(text)
    for each in buffers:
        parts += [bytes(-at % _ALIGNED), each]
        at += -at % _ALIGNED + len(each)
    return b"".join(parts)


def _moved(viewer: Viewer) -> dict[str, Any]:
    """What the script in the page moves, and by what: numbers in m and rad, rounded to nm."""
    scene, rows = viewer.scene, viewer.scene.rows
    return {
        "controls": viewer.controls,
        "q": _rounded(scene.q),
        "rows": {"q": _rounded(rows.q), "at": _rounded(rows.at), "names": rows.names},
        "near": NEAR * viewer.mark,
        "arms": [_arm(arm) for arm in viewer.arms],
        "arrows": [
            {"node": f"/{thing.name}", "at": _rounded(thing.at), "vector": _rounded(thing.vector)}
            for thing in scene.things
            if isinstance(thing, Arrows)
        ],
        "ellipsoids": [
            {"node": f"/{thing.name}", "std": _rounded(thing.std)}
            for thing in scene.things
            if isinstance(thing, Ellipsoids)
        ],
    }


def _arm(shown: ShownArm) -> dict[str, Any]:
    drawn = shown.drawn
    return {
        **numbers_of(drawn),
        "nodes": [shown.node(link) for link in drawn.links],
        "chain": shown.chain,
        "bones": drawn.bones.tolist(),
    }


def numbers_of(drawn: DrawnArm) -> dict[str, Any]:
    """The `DrawnArm.linkage` of an arm, as the script in the page reads it."""
    return {
        key: _rounded(value) if isinstance(value, np.ndarray) else value
        for key, value in asdict(drawn.linkage).items()
    }


def _rounded(values: Any) -> Any:
    return np.round(values, 9).tolist() if values.dtype.kind == "f" else values.tolist()
