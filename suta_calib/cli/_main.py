"""Entry point of the command line."""

from __future__ import annotations

import gc
import os

from suta_calib.cli._process import (
    complete_streams,
    end_by_sigterm,
    end_undisturbed,
    leave,
    say_interrupted,
)


def main() -> None:
    """Entry point of the command ``suta-calib``: an interrupt at any time is one line and 130.

    So is SIGTERM, and 143.
    """
    # Modules are a hundred thousand objects that all live on: to look through them for garbage, as
    # often as Python does, takes a twelfth of the time of a short command.
    gc.set_threshold(200_000, 20, 20)
    complete_streams()
    try:
        end_by_sigterm()
        # OpenBLAS reads this when NumPy is imported. Matrices here are small: more threads mostly
        # wait for each other. Whoever sets another number keeps it.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # Here, for importing takes long enough to be interrupted.
        from suta_calib.cli._app import run

        code = run()
        end_undisturbed()
    except KeyboardInterrupt:
        end_undisturbed()
        code = say_interrupted()
    leave(code)
