"""What the commands on poses share: options, and a word while they work."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

import click

from suta_calib.cli._output import PATIENCE_S, console, json_option

if TYPE_CHECKING:
    from rich.status import Status


Command = TypeVar("Command", bound=Callable[..., Any])


def pose_options(command: Command) -> Command:
    """``--out``, ``--json``, ``--no-robust`` and ``--seed``."""
    for option in (
        click.option(
            "--seed",
            type=click.IntRange(min=0),
            default=0,
            show_default=True,
            help="Of the random samples that outliers are sought with.",
        ),
        click.option(
            "--no-robust",
            "plain",
            is_flag=True,
            help="Least squares over all rows: look for no outliers.",
        ),
        json_option,
        click.option("--out", type=click.Path(path_type=Path), help="Folder to write files into."),
    ):
        command = option(command)
    return command


class LateStatus(AbstractContextManager["LateStatus"]):
    """A word on stderr that work goes on: on a terminal only, and not before it is worth it."""

    def __init__(self, what: str) -> None:
        self._what, self._console = what, console(stderr=True)
        self._status: Status | None = None
        self._lock, self._over = threading.Lock(), False
        self._timer = threading.Timer(PATIENCE_S, self._show)
        self._timer.daemon = True

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._over = True
            self._timer.cancel()
            if self._status is not None:
                self._status.stop()

    def _show(self) -> None:
        with self._lock:
            if not self._over:
                self._status = self._console.status(f"{self._what} …")
                self._status.start()
