"""What a page of the arm in 3-D holds: what viser is told, and what the script in it moves."""

from __future__ import annotations

import base64
import gzip
import json
import re
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Held:
    """Messages for viser's client, and what its own server is told in a page."""

    messages: list[dict[str, Any]]
    scene: dict[str, Any]

    def made(self, kind: str) -> dict[str, dict[str, Any]]:
        """Properties of the things of one kind of message, by name."""
        return {m["name"]: m["props"] for m in self.messages if m["type"] == kind}

    def last(self, kind: str, name: str) -> dict[str, Any]:
        """The last message of a kind about a thing."""
        return [m for m in self.messages if m["type"] == kind and m["name"] == name][-1]

    def labelled(self, kind: str) -> dict[str, dict[str, Any]]:
        """What the panel has of a kind of message, by label."""
        return {m["props"]["label"]: m for m in self.messages if m["type"] == kind}


def held_by(page: bytes) -> Held:
    """What is embedded in a page."""
    (data,) = re.findall(rb'id="suta-calib-scene">([^<]*)<', page)
    raw = gzip.decompress(base64.b64decode(data))
    at = 8 + int.from_bytes(raw[:8], "little")
    told = json.loads(raw[8:at])
    arrays = []
    for size in told["lengths"]:
        at += -at % 8
        arrays.append(raw[at : at + size])
        at += size

    def filled(value: Any) -> Any:
        if isinstance(value, dict) and "__binary_index" in value:
            return np.frombuffer(arrays[value["__binary_index"]], value["dtype"])
        if isinstance(value, dict):
            return {key: filled(each) for key, each in value.items()}
        return value

    return Held([filled(m) for m in told["messages"]], told["scene"])
