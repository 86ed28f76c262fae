"""An emulated arm in a process of its own, for as long as a ``with`` block lasts.

The process gets everything on its standard input, says what happens on its standard output, and
stops when its input is closed: so it cannot outlive whoever started it.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from queue import Empty, Queue
from typing import Any, Self

from suta_calib.device.description import DeviceSpec
from suta_calib.device.device_file import device_text
from suta_calib.emulation.player import Played, Player, TrueTrajectory
from suta_calib.emulation.stream import EMULATED, Emulation
from suta_calib.emulation.terminal import PseudoTerminal
from suta_calib.errors import SutaCalibError
from suta_calib.measurements import write_text


class EmulatedArm:
    """Streams an emulation on a pseudo-terminal, from another process, in real time.

    For example::

        with EmulatedArm(emulation) as emulator:
            device = emulator.write_device(folder / "device.yaml")
            ...
        truth = emulator.trajectory

    Args:
        emulation: the arm.
        link: symbolic link to the port; one in a temporary folder by default, so that `port`
            stays the same through a disconnect.
        seconds: how long at most, waiting included.
        wait: for somebody to open the port before anything moves.
        gated: whether the arm waits between rounds; see `RoundClock`.
        patient: whether it waits for a reader that lags, who then loses nothing however busy the
            computer is; see `Player`.

    Attributes:
        events: what has happened so far, in words.
    """

    def __init__(
        self,
        emulation: Emulation,
        *,
        link: Path | None = None,
        seconds: float = 3600.0,
        wait: bool = True,
        gated: bool = True,
        patient: bool = False,
    ) -> None:
        self.emulation = emulation
        self.events: list[str] = []
        self._link = link
        self._run = {"seconds": seconds, "wait": wait}
        self._playing = {"gated": gated, "patient": patient, "recorded": True}
        self._started: Queue[str] = Queue()
        self._process: subprocess.Popen[bytes] | None = None
        self._played: tuple[Played, TrueTrajectory] | None = None

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="suta_calib-emulated-")
        try:
            self._start(Path(self._folder.name))
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def port(self) -> str:
        """What to open."""
        return str(self._link)

    @property
    def device(self) -> DeviceSpec:
        """The device with its port."""
        return replace(self.emulation.device, port=self.port)

    @property
    def played(self) -> Played:
        """What was sent; known when it has stopped."""
        assert self._played is not None, "the emulated arm has not stopped"
        return self._played[0]

    @property
    def trajectory(self) -> TrueTrajectory:
        """What the arm truly did; known when it has stopped."""
        assert self._played is not None, "the emulated arm has not stopped"
        return self._played[1]

    def write_device(self, path: Path) -> Path:
        """Write the ``device.yaml`` of this arm; returns its path."""
        write_text(path, device_text(self.device, EMULATED))
        return path

    def stop(self) -> None:
        """Take the port away and end the process; a second time does nothing."""
        stop_s = 10.0
        if self._process is None:
            return
        process, self._process = self._process, None
        assert process.stdin is not None
        process.stdin.close()
        try:
            process.wait(stop_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._reader.join(stop_s)
        self._folder.cleanup()

    def _start(self, folder: Path) -> None:
        # Of a process that hangs: one that ends is noticed at once, and a busy computer is slow.
        start_s = 120.0
        self._link = folder / "port" if self._link is None else Path(self._link)
        # What the child says on stderr is a bug's traceback: let it be seen.
        command = [sys.executable, "-m", "suta_calib.emulation.emulated_arm"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with self._process.stdout as pipe:
            messages = Connection(os.dup(pipe.fileno()), writable=False)
        self._reader = threading.Thread(target=self._listen, args=(messages,), daemon=True)
        self._reader.start()
        orders = self.emulation, self._link, self._playing, self._run
        self._process.stdin.write(pickle.dumps(orders))
        self._process.stdin.flush()
        try:
            refused = self._started.get(timeout=start_s)
        except Empty:
            refused = f"the emulated arm did not start within {start_s:g} s"
        if refused:
            raise SutaCalibError(refused)

    def _listen(self, messages: Connection) -> None:
        with messages, contextlib.suppress(EOFError):
            while True:
                what, about = messages.recv()
                if what == "event":
                    self.events.append(about)
                elif what == "played":
                    self._played = about
                else:
                    self._started.put(about)
        self._started.put("the emulated arm did not start")


def main() -> None:
    """The process: play what standard input orders until it is closed."""
    # Ctrl-C in a terminal reaches every process there; whoever started this one decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    messages = Connection(sys.stdout.fileno(), readable=False)
    emulation, link, playing, run = pickle.load(sys.stdin.buffer)
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())

    def say(what: str, about: Any) -> None:
        with contextlib.suppress(BrokenPipeError):
            messages.send((what, about))

    def stop_when_closed() -> None:
        # Not sys.stdin: its lock, held here, would keep the interpreter from ending.
        while os.read(sys.stdin.fileno(), 1):
            pass
        stop.set()

    threading.Thread(target=stop_when_closed, daemon=True).start()
    try:
        with PseudoTerminal(link) as terminal:
            say("started", "")
            player = Player(emulation, terminal, lambda text: say("event", text), **playing)
            player.run(stopped=stop.is_set, **run)
        say("played", (player.played, player.trajectory))
    except SutaCalibError as error:
        say("refused", str(error))


if __name__ == "__main__":
    main()
