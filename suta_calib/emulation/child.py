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
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from suta_calib.emulation.player import Player
from suta_calib.emulation.stream import Emulation
from suta_calib.emulation.terminal import PseudoTerminal
from suta_calib.errors import SutaCalibError


class Orders(NamedTuple):
    """What a process is to play, and where the true trajectory goes at the end (npz)."""

    emulation: Emulation
    link: Path
    seconds: float
    wait: bool
    gated: bool
    patient: bool
    trajectory: Path


def main() -> None:
    """Play what standard input orders until it is closed."""
    # Ctrl-C in a terminal reaches every process there; whoever started this one decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders: Orders = pickle.load(sys.stdin.buffer)
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())

    def stop_when_closed() -> None:
        # Not sys.stdin: its lock, held here, would keep the interpreter from ending.
        while os.read(sys.stdin.fileno(), 1):
            pass
        stop.set()

    threading.Thread(target=stop_when_closed, daemon=True).start()
    try:
        with PseudoTerminal(orders.link) as terminal:
            _say(port=terminal.name)
            player = Player(
                orders.emulation,
                terminal,
                _event,
                gated=orders.gated,
                recorded=True,
                patient=orders.patient,
            )
            player.run(orders.seconds, stop.is_set, wait=orders.wait)
        np.savez(orders.trajectory, **vars(player.trajectory))
        _say(played=asdict(player.played))
    except SutaCalibError as error:
        _say(error=str(error))


def _event(text: str) -> None:
    _say(event=text)


def _say(**message: Any) -> None:
    try:
        sys.stdout.write(json.dumps(message) + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        return


if __name__ == "__main__":
    main()
