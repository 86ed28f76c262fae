"""A notebook's cells, run by IPython in a copy of this process.

A kernel of its own imports everything again, which takes as long as many a notebook: a copy has
what the tests have imported already, and what it changes ends with it. So do the commands that a
notebook runs.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import subprocess
import sys
import warnings
from contextlib import chdir
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import nbformat
from cli_job import spoken
from IPython.core.displayhook import CapturingDisplayHook
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from traitlets.config import Config

# Seconds after which a notebook is held to hang.
LONGEST = 900
# Smaller files for whoever stores the pictures; a third of the time that they take.
SMALLER_FILES = re.compile(r"^%config InlineBackend\.print_figure_kwargs.*$", re.M)
# Commands that keep up with a device.
REAL_TIME = ("measure", "track")
run_process = subprocess.run
# What Python does not tell of by itself.
UNTOLD = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)


@dataclass
class Computed:
    """What a notebook gave: texts of its outputs, pictures, what went to stderr, an error."""

    texts: list[str] = field(default_factory=list)
    pictures: int = 0
    warned: list[str] = field(default_factory=list)
    error: str = ""


class Shell(InteractiveShell):
    """What runs a kernel's cells, without a user."""

    def enable_gui(self, gui: str | None = None) -> None:
        """No window is opened."""


def run_notebook(notebook: nbformat.NotebookNode, folder: Path) -> Computed:
    """Run all cells with this working directory."""
    here = multiprocessing.get_context("fork")
    receiver, sender = here.Pipe(duplex=False)
    cells = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    process = here.Process(target=_run, args=(cells, folder, sender))
    with warnings.catch_warnings():
        # Of Python 3.12 on: another thread, of pytest-xdist, waits for its next task.
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    sender.close()
    try:
        if not receiver.poll(LONGEST):
            raise TimeoutError(f"found no end of the notebook after {LONGEST} s")
        found = receiver.recv()
    finally:
        process.kill()
        process.join()
    assert isinstance(found, Computed)
    return found


def _run(cells: list[str], folder: Path, sender: Connection) -> None:
    computed = Computed()
    subprocess.run = _run_here
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    _run_cells(cells, computed)
    sender.send(computed)
    # Without what tests would do at their end.
    os._exit(0)


def _run_here(command: list[str], **how: Any) -> subprocess.CompletedProcess[str]:
    """`suta-calib` in this process; in one of its own what is none, or what reads a device."""
    if command[:3] != [sys.executable, "-m", "suta_calib"] or command[3] in REAL_TIME:
        return run_process(command, **how)
    with chdir(how["cwd"]):
        code, out, err = spoken(*command[3:])
    return subprocess.CompletedProcess(command, code, out, err)


def _run_cells(cells: list[str], computed: Computed) -> None:
    shell = Shell.instance(config=Config(HistoryManager={"enabled": False}))
    with warnings.catch_warnings(record=True) as warned:
        warnings.resetwarnings()
        for category in UNTOLD:
            warnings.simplefilter("ignore", category)
        for cell in cells:
            with capture_output() as captured:
                # As in a kernel: what a cell's last line gives is displayed but for a semicolon.
                displayed = [] if cell.rstrip().endswith(";") else captured._outputs
                shell.display_trap.hook = CapturingDisplayHook(shell, displayed)
                result = shell.run_cell(SMALLER_FILES.sub("", cell))
            computed.texts.append(captured.stdout)
            computed.warned += [captured.stderr] if captured.stderr else []
            for output in captured._outputs:
                _add(output["data"], computed)
            if not result.success:
                computed.error = captured.stdout
                break
    computed.warned += [str(each.message) for each in warned]


def _add(data: dict[str, Any], computed: Computed) -> None:
    computed.pictures += "image/png" in data
    for kind, content in data.items():
        if not kind.startswith("image/"):
            computed.texts.append(content if isinstance(content, str) else json.dumps(content))
