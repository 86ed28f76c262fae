"""What workers of a fleet are given in tests: functions of a module, light to import."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def doubled(number: int) -> int:
    """Twice a number; worker processes are ended by those that are not positive."""
    if number < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 0:
        os._exit(3)
    return 2 * number


def ended_once(mark: Path) -> str:
    """Ends its process the first time, as a lack of memory does that is over later."""
    if not mark.exists():
        mark.touch()
        os._exit(1)
    return mark.name


def at_work(mark: Path) -> None:
    """Says which process it is in, and works for longer than a test."""
    mark.write_text(str(os.getpid()))
    time.sleep(120)
