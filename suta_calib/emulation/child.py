"""The process an `EmulatedArm` runs in.

It is handed everything on its standard input, says what happens on its standard output, one JSON
object per line, and stops when its input is closed: so it cannot outlive whoever started it.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import sys
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from suta_calib.emulation.player import Player
from suta_calib.emulation.stream import Emulation
from suta_calib.emulation.terminal import PseudoTerminal
from suta_calib.errors import SutaCalibError


@dataclass(frozen=True, eq=False)
class Orders:
    """What a process is to play.

    Attributes:
        emulation: the arm.
        link: to the port.
        seconds: how long at most.
        wait: for somebody to open the port before anything moves.
        gated: whether the arm waits between rounds.
        trajectory: where the true trajectory goes at the end (npz).
    """

    emulation: Emulation
    link: Path
    seconds: float
    wait: bool
    gated: bool
    trajectory: Path


def main() -> None:
    """Play what standard input orders until it is closed."""
    # Ctrl-C in a terminal reaches every process there; whoever started this one decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders: Orders = pickle.load(sys.stdin.buffer)
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    threading.Thread(target=_until_closed, args=(stop,), daemon=True).start()
    try:
        with PseudoTerminal(orders.link) as terminal:
            _say(port=terminal.name)
            player = Player(
                orders.emulation,
                terminal,
                lambda text: _say(event=text),
                gated=orders.gated,
                recorded=True,
            )
            player.run(orders.seconds, stop.is_set, wait=orders.wait)
        np.savez(orders.trajectory, **vars(player.trajectory))
        _say(played=asdict(player.played))
    except SutaCalibError as error:
        _say(error=str(error))


def _until_closed(stop: threading.Event) -> None:
    # Not sys.stdin: its lock, held here, would keep the interpreter from ending.
    while os.read(sys.stdin.fileno(), 1):
        pass
    stop.set()


def _say(**message: Any) -> None:
    try:
        sys.stdout.write(json.dumps(message) + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        return


if __name__ == "__main__":
    main()
