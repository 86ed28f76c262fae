"""What goes wrong on an emulated cable, and when."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np

from suta_calib.display import Displayable
from suta_calib.errors import InputError, did_you_mean
from suta_calib.units import from_mm

WORDS: Final = {
    "corrupt=SHARE": "this share of all bytes is replaced by random ones",
    "flip=SHARE": "in this share of all bytes one bit is wrong",
    "lose=SHARE": "this share of all bytes is lost",
    "skip=SHARE": "this share of all frames is not sent (gaps in the sequence numbers)",
    "gap=N@T": "N frames in a row are not sent, from time T",
    "burst=S@T": "random bytes instead of frames for S seconds, from time T",
    "stall=S@T": "nothing is sent for S seconds, from time T; these frames are lost",
    "hold=S@T": "frames are delayed for S seconds, from time T, and then all sent together",
    "stale=N": "a program that opens the port receives N old frames first, with their old times",
    "disconnect=S@T": "the port disappears for S seconds, from time T, and comes back under its "
    "link",
    "reboot=S@T": "as disconnect, and sequence numbers and clock start again",
    "error=JOINT:S@T": "the encoder of this joint sets its error flag for S seconds, from time T",
    "warning=JOINT:S@T": "the encoder of this joint sets its warning flag for S seconds, from "
    "time T",
    "lift=MM:S@T": "the tip is MM off its place for S seconds, from T on (motion socket or plate)",
    "slip=MM@T": "the socket, or the plate, moves by MM at time T (motion socket or plate)",
}
_FORMS: Final = {word.partition("=")[0]: word for word in WORDS}


@dataclass(frozen=True)
class Window:
    """A span of time: from ``start`` (included) for ``duration``, both s."""

    start: float
    duration: float

    @property
    def end(self) -> float:
        """When it is over, s."""
        # 0.1 + 0.2 is not 0.3; nobody means the difference.
        return round(self.start + self.duration, 9)

    def __contains__(self, time: float) -> bool:
        return self.start <= time < self.end


@dataclass(frozen=True)
class Flag(Displayable):
    """A joint's encoder raises a flag: its name, and when."""

    joint: str
    window: Window


@dataclass(frozen=True)
class Gap:
    """``count`` frames that are not sent, from ``start`` (s) on."""

    count: int
    start: float


@dataclass(frozen=True)
class TipLift(Displayable):
    """The tip is off its place by a distance, m, while."""

    distance: float
    window: Window


@dataclass(frozen=True)
class PlaceSlip(Displayable):
    """What the tip is on moves by a distance, m, at a time, s."""

    distance: float
    start: float


@dataclass(frozen=True)
class Faults(Displayable):
    """Everything that goes wrong; nothing by default. Times are s after the port was first opened.

    Attributes:
        corrupt, flip, lose: shares of bytes, from 0 to 1, as `WORDS` describes them.
        skip: share of frames.
        stale: number of old frames.
        gaps, bursts, stalls, holds, disconnects, reboots: when.
        errors, warnings: flags by joint.
        lifts, slips: what happens to the tip of an arm that is swept by hand.
    """

    corrupt: float = 0.0
    flip: float = 0.0
    lose: float = 0.0
    skip: float = 0.0
    stale: int = 0
    gaps: tuple[Gap, ...] = ()
    bursts: tuple[Window, ...] = ()
    stalls: tuple[Window, ...] = ()
    holds: tuple[Window, ...] = ()
    disconnects: tuple[Window, ...] = ()
    reboots: tuple[Window, ...] = ()
    errors: tuple[Flag, ...] = ()
    warnings: tuple[Flag, ...] = ()
    lifts: tuple[TipLift, ...] = ()
    slips: tuple[PlaceSlip, ...] = ()

    @property
    def absences(self) -> tuple[Window, ...]:
        """When the port is gone, in order."""
        return tuple(sorted((*self.disconnects, *self.reboots), key=lambda window: window.start))

    def check_joints(self, joints: Sequence[str]) -> None:
        """Refuse flags of joints that the device does not have.

        Raises:
            InputError: names the joint, and the joints there are.
        """
        for flag in (*self.errors, *self.warnings):
            if flag.joint not in joints:
                raise InputError(
                    f"no joint {flag.joint!r}",
                    f"one of {', '.join(joints)}",
                    where="--faults",
                    hint=did_you_mean(flag.joint, joints),
                )

    @classmethod
    def parse(cls, text: str) -> Faults:
        """Faults as the command line writes them: ``corrupt=0.01,stall=2@10``; see `WORDS`.

        Raises:
            InputError: a word that is none of them, or an unusable number.
        """
        faults = cls()
        for item in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = item.partition("=")
            faults = replace(faults, **_parsed(faults, item, name.strip(), value.strip()))
        for earlier, later in pairwise(faults.absences):
            if later.start < earlier.end:
                raise InputError(
                    f"a port that disappears at {later.start:g} s although it is already gone "
                    f"until {earlier.end:g} s",
                    "disconnects and reboots that do not overlap",
                    where="--faults",
                )
        return faults


def _parsed(faults: Faults, item: str, name: str, value: str) -> dict[str, Any]:
    """The fields that one word changes."""
    if name not in _FORMS:
        expected, hint = f"one of {', '.join(WORDS)}", did_you_mean(name, _FORMS)
        raise InputError(repr(item), expected, where="--faults", hint=hint)

    def number(text: str, kind: type[float] = float) -> Any:
        try:
            value = kind(text)
        except ValueError:
            raise InputError(repr(item), _FORMS[name], where="--faults") from None
        if not (math.isfinite(value) and value >= 0):
            raise InputError(repr(item), "a number that is not negative", where="--faults")
        return value

    if _FORMS[name].endswith("=SHARE"):
        if (share := number(value)) > 1:
            raise InputError(repr(item), "a share from 0 to 1", where="--faults")
        return {name: share}
    if name == "stale":
        return {"stale": number(value, int)}
    first, _, time = value.rpartition("@")
    start, field = number(time), f"{name}s"
    fault: Gap | Flag | Window | TipLift | PlaceSlip
    if name == "gap":
        fault = Gap(number(first, int), start)
    elif name in ("error", "warning"):
        joint, _, duration = first.rpartition(":")
        fault = Flag(joint, Window(start, number(duration)))
    elif name == "lift":
        distance, _, duration = first.rpartition(":")
        fault = TipLift(from_mm(number(distance)), Window(start, number(duration)))
    elif name == "slip":
        fault = PlaceSlip(from_mm(number(first)), start)
    else:
        fault = Window(start, number(first))
    return {field: (*getattr(faults, field), fault)}


class Damage:
    """Corrupts, flips and loses bytes at random, the same way for the same seed."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults = faults
        self._random = np.random.default_rng([seed, 3])

    def __call__(self, data: bytes) -> bytes:
        """The bytes as they arrive."""
        if not (self._faults.corrupt or self._faults.flip or self._faults.lose):
            return data
        received = np.frombuffer(data, dtype=np.uint8).copy()
        # Exclusive-or with anything but zero: a corrupted byte is never the right one by chance.
        self._change(received, self._faults.corrupt, self._random.integers(1, 256, len(data)))
        self._change(received, self._faults.flip, 1 << self._random.integers(0, 8, len(data)))
        arrived = self._random.random(len(data)) >= self._faults.lose
        return received[arrived].tobytes()

    def garbage(self, count: int) -> bytes:
        """Random bytes."""
        return self._random.bytes(count)

    def _change(self, data: np.ndarray, share: float, mask: np.ndarray) -> None:
        hit = self._random.random(len(data)) < share
        data[hit] ^= mask[hit].astype(np.uint8)
