"""A process of its own for what takes long, so that no reading waits for it.

It gets jobs on its standard input, answers on its standard output, and ends when its input is
closed: so it cannot outlive whoever started it.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from suta_calib.errors import InputError, SutaCalibError
from suta_calib.guide.calibrating import calibrated
from suta_calib.guide.determined import determined, next_place, next_posture

_TASKS: Final[dict[str, Callable[[Path], Any]]] = {
    "determined": determined,
    "next": next_place,
    "posture": next_posture,
    "calibrated": calibrated,
}


@dataclass(frozen=True)
class Unanswered:
    """Why there is no answer: as a message that names files, and what was found alone."""

    why: str
    found: str = ""


class Worker:
    """Asks the process one thing at a time; a later question takes the place of one that waits.

    Args:
        answered: called, in another thread, with what was asked and the answer, or `Unanswered`.
    """

    def __init__(self, answered: Callable[[str, Any], None]) -> None:
        self._answered = answered
        self._asked: dict[str, Path] = {}
        self._wake = threading.Condition()
        self._over = False

    def __enter__(self) -> Self:
        # By its name, so that both processes mean the same by what is pickled.
        command = [sys.executable, "-c", "from suta_calib.guide.work import main; main()"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._thread = threading.Thread(target=self._serve, name="work", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._wake:
            self._over = True
            self._wake.notify()
        self._process.kill()
        self._process.wait()
        self._thread.join(1.0)
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                assert pipe is not None
                pipe.close()

    def ask(self, what: str, job: Path) -> None:
        """Ask what a task finds about a job: ``next``, …."""
        with self._wake:
            self._asked[what] = job
            self._wake.notify()

    def _serve(self) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._asked or self._over)
                if self._over:
                    return
                what = next(iter(self._asked))
                job = self._asked.pop(what)
            try:
                pickle.dump((what, job), self._process.stdin)
                self._process.stdin.flush()
                answer = pickle.load(self._process.stdout)
            except (OSError, EOFError, ValueError, pickle.UnpicklingError):
                if not self._over:
                    self._answered(what, Unanswered("the process that computes this ended"))
                return
            self._answered(what, answer)


def main() -> None:
    """The process: answer what standard input asks until it is closed."""
    # Ctrl-C in a terminal reaches every process there; whoever started this one decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(5)
    # What anything prints must not come between the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with suppress(EOFError):
        while True:
            what, job = pickle.load(sys.stdin.buffer)
            try:
                answer = _TASKS[what](job)
            except SutaCalibError as error:
                found = f"found {error.found}" if isinstance(error, InputError) else str(error)
                answer = Unanswered(str(error), found)
            pickle.dump(answer, answers)
            answers.flush()
