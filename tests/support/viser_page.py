"""What a page of the arm in 3-D holds: the messages that viser's client plays."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import zstandard


@dataclass(frozen=True)
class Held:
    """Messages for viser's client, each with its time, s."""

    messages: list[tuple[float, dict[str, Any]]]

    def made(self, kind: str) -> dict[str, dict[str, Any]]:
        """Properties of the things of one kind of message, by name."""
        return {m["name"]: m["props"] for _, m in self.messages if m["type"] == kind}

    def told(self, kind: str, name: str) -> list[tuple[float, dict[str, Any]]]:
        """The messages of a kind about a thing, in order."""
        return [(t, m) for t, m in self.messages if (m["type"], m.get("name")) == (kind, name)]


def held_by(page: bytes) -> Held:
    """What is embedded in a page.

    After its length, 8 bytes, stands in Zstandard: the length of MessagePack, 8 bytes; that; the
    arrays it refers to by number, each at a multiple of 8 bytes.
    """
    (data,) = re.findall(rb'__VISER_EMBED_DATA__="([^"]*)"', page)
    raw = zstandard.ZstdDecompressor().decompress(base64.b64decode(data)[8:], 1 << 28)
    at = 8 + int.from_bytes(raw[:8], "little")
    plain = msgspec.msgpack.decode(raw[8:at])
    arrays = []
    for size in plain["binaryBufferLengths"]:
        at += -at % 8
        arrays.append(raw[at : at + size])
        at += size

    def filled(value: Any) -> Any:
        if isinstance(value, dict) and "__binary_index" in value:
            return np.frombuffer(arrays[value["__binary_index"]], value["dtype"])
        if isinstance(value, dict):
            return {key: filled(each) for key, each in value.items()}
        return value

    return Held([(time, filled(message)) for time, message in plain["messages"]])
