"""The command line, interrupted by the signal itself at a definite moment, however busy it is.

    python -m tests.support.interrupted_command MOMENT ARGUMENTS…

MOMENT is a module that is about to be imported, or ``end``: when all is done.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys

# In a text that Python executes, as it does to make a dataclass, an interrupt is special: Python
# ends itself by that signal, even where it was caught.
TEXT = "os.kill(os.getpid(), signal.SIGINT)"

# Not yet come; emptied when it has.
MOMENTS = [sys.argv.pop(1)]


def interrupt_once(event: str, arguments: tuple[object, ...]) -> None:
    if event == "import" and arguments[0] in MOMENTS:
        MOMENTS.clear()
        exec(TEXT)


if __name__ == "__main__":
    # A shell's background job ignores Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.addaudithook(interrupt_once)
    from suta_calib.cli import main

    if MOMENTS == ["end"]:
        atexit.register(os.kill, os.getpid(), signal.SIGINT)
    main()
