"""Reading a stranger's file in a process of its own, with bounded time, memory and power.

Macro languages and model compilers do what a file tells them. So they run in a child process:
without the user's environment, with limits of the operating system on processor time, memory and
written files, and with an end after a time on the clock. The child answers with one line of JSON.
The package's own processes (`started`) need none of this.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

# Of 60 public descriptions the slowest takes 0.2 s of processor time, of 50 MuJoCo models 0.7 s. A
# small computer may be ten times slower, and the clock allows for a busy one.
PROCESSOR_SECONDS: Final = 10
# What Python itself may need to start and to find its packages; forgotten before the work begins.
_VARIABLES: Final = (
    *("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT"),
    *("PYTHONHOME", "PYTHONUSERBASE", "HOME"),
)


class ConfinedError(Exception):
    """The child did not answer: it was ended, or ended itself; the text says why."""


def run_confined(module: str, *arguments: str, seconds: float = 30.0) -> dict[str, Any]:
    """Run a module of the package as a confined process, and wait for its answer.

    Args:
        module: its full name; its ``__main__`` calls `answer`.
        arguments: of its command line.
        seconds: on the clock, after which it is ended.

    Returns:
        What the child's function returned.

    Raises:
        ConfinedError: more time or memory than allowed, or the process broke.
    """
    environment = {name: os.environ[name] for name in _VARIABLES if name in os.environ}
    environment |= {"PYTHONPATH": _paths(), "OPENBLAS_NUM_THREADS": "1"}
    try:
        run = subprocess.run(
            # -P: a file of the user's folder must not stand in for a library. -B: write nothing.
            [sys.executable, "-P", "-B", "-X", "utf8", "-m", module, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            timeout=seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ConfinedError(f"more than {seconds:g} s") from None
    if run.returncode in {-signal.SIGXCPU, -signal.SIGKILL}:
        raise ConfinedError(f"more than {PROCESSOR_SECONDS} s of processor time")
    try:
        reply = json.loads(run.stdout)
    except ValueError:
        raise ConfinedError(f"a crash (exit code {run.returncode})") from None
    if "too_much" in reply:
        raise ConfinedError(reply["too_much"])
    return dict(reply)


def answer(work: Callable[[], Mapping[str, Any]]) -> None:
    """In the child: do the work within the limits, print what it returns, and leave.

    Whatever the work needs is imported before: afterwards the process may be unable to.
    """
    _limit()
    os.environ.clear()
    try:
        result = work()
        data = json.dumps(result).encode()
        if len(data) > 64 << 20:
            result, data = {}, b""
            raise MemoryError
    except MemoryError:
        data = json.dumps({"too_much": "more memory than a description needs"}).encode()
    # Not sys.stdout: libraries may have replaced it. Nothing is cleaned up that a file has made.
    view = memoryview(data)
    while view:
        view = view[os.write(1, view) :]
    os._exit(0)


def _limit() -> None:
    if sys.platform == "win32":
        return
    import resource

    for kind, most in (
        (resource.RLIMIT_CPU, PROCESSOR_SECONDS),
        # Python with MuJoCo and NumPy maps 0.14 GB, with xacro 0.02 GB, before it reads anything.
        (resource.RLIMIT_AS, 1 << 30),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        # Where an administrator allows less, or the system knows no such limit, that stays.
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (most, most))


def started(module: str, *arguments: str) -> subprocess.Popen[bytes]:
    """A process, not confined, that runs a module of the package, with pipes to it and from it."""
    return subprocess.Popen(
        # -P: a file of the user's folder must not stand in for a library.
        [sys.executable, "-P", "-m", module, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": _paths()},
    )


def _paths() -> str:
    """Where Python finds this package, and what it finds already."""
    root = Path(__file__).resolve().parents[1]
    return os.pathsep.join([str(root), *filter(None, [os.environ.get("PYTHONPATH")])])
