"""An emulated arm in a process of its own, for as long as a ``with`` block lasts."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
import tempfile
import threading
from dataclasses import replace
from pathlib import Path
from queue import Empty, Queue
from typing import Any, Self

import numpy as np

from suta_calib.device.description import DeviceSpec
from suta_calib.emulation.child import Orders
from suta_calib.emulation.device import device_text
from suta_calib.emulation.player import Played, TrueTrajectory
from suta_calib.emulation.stream import Emulation
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
        self._link, self._options = link, (seconds, wait, gated, patient)
        self._messages: Queue[dict[str, Any]] = Queue()
        self._process: subprocess.Popen[bytes] | None = None
        self._played: Played | None = None
        self._trajectory: TrueTrajectory | None = None

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
        return self._played

    @property
    def trajectory(self) -> TrueTrajectory:
        """What the arm truly did; known when it has stopped."""
        assert self._trajectory is not None, "the emulated arm has not stopped"
        return self._trajectory

    def write_device(self, path: Path) -> Path:
        """Write the ``device.yaml`` of this arm; returns its path."""
        write_text(path, device_text(self.device))
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
        file = Path(self._folder.name) / "trajectory.npz"
        if file.exists():
            with np.load(file) as arrays:
                self._trajectory = TrueTrajectory(**arrays)
        self._folder.cleanup()

    def _start(self, folder: Path) -> None:
        start_s = 30.0
        self._link = folder / "port" if self._link is None else Path(self._link)
        # What the child says on stderr is a bug's traceback: let it be seen.
        command = [sys.executable, "-m", "suta_calib.emulation.child"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._reader = threading.Thread(target=self._listen, daemon=True)
        self._reader.start()
        orders = Orders(self.emulation, self._link, *self._options, folder / "trajectory.npz")
        assert self._process.stdin is not None
        self._process.stdin.write(pickle.dumps(orders))
        self._process.stdin.flush()
        try:
            message = self._messages.get(timeout=start_s)
        except Empty:
            message = {"error": f"the emulated arm did not start within {start_s:g} s"}
        if "port" not in message:
            raise SutaCalibError(message.get("error", "the emulated arm did not start"))

    def _listen(self) -> None:
        process = self._process
        assert process is not None
        assert process.stdout is not None
        for line in process.stdout:
            message = json.loads(line)
            if "event" in message:
                self.events.append(message["event"])
            elif "played" in message:
                self._played = Played(**message["played"])
            else:
                self._messages.put(message)
        self._messages.put({})
        process.stdout.close()
