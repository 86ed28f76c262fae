"""The process of a command: its streams, its end, and an interrupt at any time."""

from __future__ import annotations

import atexit
import gc
import io
import os
import signal
import sys
import threading
from typing import Final, NoReturn

PROGRAM: Final = "suta-calib"
INTERRUPTED: Final = 130
TERMINATED: Final = 143
_terminated = threading.Event()


def leave(code: int) -> NoReturn:
    """End the process as soon as all has been written.

    To take hundreds of modules apart, object by object, and to look through them for garbage takes
    a twentieth of the time of a short command, for memory that the system is about to have back.
    """
    try:
        # What is still at work, Python waits for.
        if threading.active_count() == 1:
            atexit._run_exitfuncs()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    except OSError:
        # What cannot be written, Python complains of.
        pass
    gc.freeze()
    sys.exit(code)


class _Forgiving(io.FileIO):
    """A file that swallows what cannot be written to it."""

    def write(self, data: bytes) -> int:  # type: ignore[override]
        """Write, if it can be."""
        try:
            written = super().write(data)
        except OSError:
            written = None
        return len(data) if written is None else written


def complete_streams() -> None:
    """Have a standard input, output and error, whatever the process was started with.

    Where one is closed (``>&-``), the next file that is opened would take its number, and be
    written to by whoever prints. A message that cannot be written, the disk being full or the
    reader gone, changes nothing of how the command ends.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    if sys.stdin is None:
        sys.stdin = open(0, closefd=False)  # noqa: SIM115 (as long as the process)
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    encoding = "utf-8" if sys.stderr is None else sys.stderr.encoding
    sys.stderr = io.TextIOWrapper(
        io.BufferedWriter(_Forgiving(2, "wb", closefd=False)),
        encoding=encoding,
        errors="backslashreplace",
        line_buffering=True,
    )


def discard_stdout() -> None:
    """From now on what is printed goes nowhere: its reader went away, as ``| head`` does."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def end_by_sigterm() -> None:
    """From here on SIGTERM, as of ``timeout`` and services, ends a command as Ctrl-C does."""

    def terminate(*_: object) -> None:
        _terminated.set()
        raise KeyboardInterrupt

    # Who had it ignored keeps that.
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, terminate)


def say_interrupted() -> int:
    """What whoever interrupted a command is told; the exit code."""
    by = "interrupted by SIGTERM" if _terminated.is_set() else "interrupted"
    print(f"{PROGRAM}: {by}; no incomplete files were left", file=sys.stderr, flush=True)
    return TERMINATED if _terminated.is_set() else INTERRUPTED


def end_undisturbed() -> None:
    """From here on there is nothing left to interrupt but Python's own end."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    # Where an interrupt came while Python executed a text, as it does to make a dataclass, it ends
    # by that signal and not with our code, whoever caught it, until it executes another text.
    exec("")
