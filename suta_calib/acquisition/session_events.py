"""What a measuring session tells whoever follows it: the console, a page, a test."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from suta_calib.acquisition.touch_sequence import TouchSequence
from suta_calib.arrays import FloatArray

StationStatus = Literal["taken", "skipped", "next", "open"]


@dataclass(frozen=True)
class Said:
    """A sentence for whoever measures."""

    text: str


@dataclass(frozen=True, eq=False)
class Opened:
    """The session begins: what it measures, and how long each rest is recorded, s."""

    plan: TouchSequence
    seconds: float


@dataclass(frozen=True)
class StationState:
    """One station: whether it is measured, and what speaks against its sample."""

    name: str
    status: StationStatus
    doubt: str = ""


@dataclass(frozen=True, eq=False)
class Stations:
    """Which stations are measured; told at the start and after each change.

    Attributes:
        states: of all of them, in order.
        tips: (3,) where the uncalibrated arm has the tip on each landmark measured, base frame, m.
        placed: (landmarks, 3) where the landmarks of the artefact then are, m, in its order; None
            before three that are not on a line are known.
    """

    states: tuple[StationState, ...]
    tips: Mapping[str, FloatArray]
    placed: FloatArray | None = None

    @property
    def next(self) -> str:
        """Name of the one to go to; empty where none is left."""
        return next((state.name for state in self.states if state.status == "next"), "")


@dataclass(frozen=True, eq=False)
class Live:
    """What the arm does now; told after each read.

    Attributes:
        doing: in words, for the console.
        angles: (joints,) the latest readings, rad or m; None before the first.
        resting: whether it rests.
        recorded: how much of the present rest is recorded, s.
        silence: how long nothing came, s.
    """

    doing: str
    angles: FloatArray | None
    resting: bool
    recorded: float
    silence: float


SessionEvent: TypeAlias = Said | Opened | Stations | Live
Listener: TypeAlias = Callable[[SessionEvent], None]


@dataclass(frozen=True)
class ConsoleListener:
    """Shows a session as lines, and what the arm does in place of the last."""

    say: Callable[[str], None]
    show: Callable[[str], None] | None = None

    def __call__(self, event: SessionEvent) -> None:
        """Take an event."""
        if isinstance(event, Said):
            self.say(event.text)
        elif isinstance(event, Live) and self.show is not None:
            self.show(event.doing)
