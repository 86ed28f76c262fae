"""What a page that viser froze holds: its messages, with their arrays, at their times."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import zstandard


@dataclass(frozen=True)
class Recording:
    """Messages with the time, s, at which each comes."""

    seconds: float
    messages: list[tuple[float, dict[str, Any]]]

    def made(self, kind: str) -> dict[str, dict[str, Any]]:
        """Properties of the things of one kind of message, by name."""
        return {m["name"]: m["props"] for _, m in self.messages if m["type"] == kind}

    def last(self, kind: str, name: str, until: float = np.inf) -> dict[str, Any]:
        """The last message of a kind about a thing, up to a time."""
        found = [
            m for t, m in self.messages if m["type"] == kind and m["name"] == name and t <= until
        ]
        return found[-1]


def recording_of(page: bytes) -> Recording:
    """The scene that is embedded in a page."""
    (data,) = re.findall(rb'__VISER_EMBED_DATA__="([^"]*)"', page)
    raw = base64.b64decode(data)
    inner = zstandard.ZstdDecompressor().decompress(
        raw[8:], max_output_size=int.from_bytes(raw[:8], "little")
    )
    length = int.from_bytes(inner[:8], "little")
    top = msgspec.msgpack.decode(inner[8 : 8 + length])
    buffers, at = [], 8 + length
    for size in top["binaryBufferLengths"]:
        at += -at % 8
        buffers.append(inner[at : at + size])
        at += size

    def filled(value: Any) -> Any:
        if isinstance(value, dict) and "__binary_index" in value:
            return np.frombuffer(buffers[value["__binary_index"]], value["dtype"])
        if isinstance(value, dict):
            return {key: filled(each) for key, each in value.items()}
        return value

    return Recording(top["durationSeconds"], [(t, filled(m)) for t, m in top["messages"]])
