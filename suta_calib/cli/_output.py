"""What the commands print, where they write, and how they end."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import wraps
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self

import click
from rich.console import Console
from rich.live import Live
from rich.progress import Progress

from suta_calib.atomic import note_input
from suta_calib.cli._options import NAMED, PATH, NamedFile, json_option, verbose_option
from suta_calib.cli._process import discard_stdout
from suta_calib.errors import OutputError
from suta_calib.report.console import rendered
from suta_calib.report.files import write_document
from suta_calib.report.listing import json_text

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from suta_calib.report.document import Document


# Where a context has the hashes of a command's inputs.
_INPUTS: Final = "suta_calib.inputs"


def console(*, stderr: bool = False) -> Console:
    """A console that keeps names and numbers as they are."""

    class Plain(Console):
        def on_broken_pipe(self) -> None:
            """Rich would end the process, with a code that means a bad answer."""
            raise BrokenPipeError

    return Plain(stderr=stderr, highlight=False, markup=False, emoji=False)


@contextmanager
def printing() -> Iterator[None]:
    """Within it a reader of stdout may go away: what is printed then goes nowhere.

    The files of a command and its exit code do not depend on who reads what it prints.
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        discard_stdout()
    except OSError as error:
        raise OutputError(f"standard output: not written: {error.strerror or error}") from None


def print_json(data: Mapping[str, Any]) -> None:
    """One JSON object on stdout; what is not a finite number becomes null."""
    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    click.echo(json_text(data, indent=2, ascii_only=not unicode), nl=False)


def answer_command(command: Callable[..., Document]) -> click.Command:
    """A command that shows the answer which a function returns; with ``--json``, ``--verbose``.

    The answer's files are written to the command's folder ``out``, if it has one, and it exits
    with 1 where the answer must not be used.
    """

    @click.command()
    @click.pass_context
    @wraps(command)
    def shown(
        context: click.Context,
        /,
        *,
        out: Path | None = None,
        **options: Any,
    ) -> None:
        for shown_how in ("as_json", "verbose"):
            del options[shown_how]
        # Before anything is computed: nobody knows what a file holds by then.
        inputs = {} if out is None else _inputs(context)
        context.meta[_INPUTS] = inputs
        answer = command(**options)
        conclude(answer)
        context.exit(answer.exit_code)

    return verbose_option(json_option(shown))


def conclude(answer: Document) -> None:
    """Show the answer of the running command, and write its files if it has a folder."""
    context, written = click.get_current_context(), None
    as_json, out = context.params["as_json"], context.params.get("out")
    # Who reads need not wait for the pictures of the report.
    if not as_json:
        with printing():
            console().print(rendered(answer, verbose=context.params["verbose"]), crop=False)
    if out is not None:
        written = write_document(answer, out, context.meta[_INPUTS])
    with printing():
        if as_json:
            print_json(answer.json() if written is None else written)
        elif written is not None:
            _print_files(written["files"], out, opens=answer.written == "opening")


def _print_files(files: Mapping[str, str], out: Path | None, *, opens: bool) -> None:
    to = console()
    to.print(f"Written to {out}: {', '.join(files)}", soft_wrap=True)
    if opens:
        to.print(f"Report: {files['report.html']}", soft_wrap=True)


def _inputs(context: click.Context) -> dict[str, str]:
    """SHA-256 of the files that the command line names, in its order."""
    hashes = {}
    for option in (o for o in context.command.params if o.type in (PATH, NAMED)):
        given = context.params[str(option.name)]
        several = given if option.multiple or option.nargs != 1 else (given,)
        for one in several:
            path = one.path if isinstance(one, NamedFile) else one
            if path is not None and path.is_file():
                note_input(path)
                hashes[str(path)] = sha256(path.read_bytes()).hexdigest()
    return hashes


def results_folder() -> Path:
    """The folder ``out`` of the command that is running."""
    folder: Path = click.get_current_context().params["out"]
    return folder


class LateProgress:
    """Says on stderr that work goes on, once it is worth it: a bar on a terminal, else lines.

    Called with what is done and the total, it says how far the work has come.

    Args:
        what: is being done.
        patience: shorter runs are over before anybody wonders, s.
    """

    patience: ClassVar[float] = 2.0
    # From the first line to the second, then twice as long each time, and the most, s: a file that
    # is read afterwards need not hold more.
    between_lines: ClassVar[tuple[float, float]] = 10.0, 60.0

    def __init__(self, what: str, patience: float | None = None) -> None:
        self._told: dict[str, Any] = {"description": what, "total": None}
        self._console = console(stderr=True)
        self._bar: Progress | None = None
        self._began = time.monotonic()
        self._lock, self._over = threading.Lock(), threading.Event()
        wait = self.patience if patience is None else patience
        self._thread = threading.Thread(target=self._show, args=(wait,), daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        with self._lock:
            if self._bar is not None:
                self._bar.stop()

    def __call__(self, done: int, total: int) -> None:
        """Say how far the work has come."""
        self._tell(completed=done, total=total)

    def about(self, what: str) -> None:
        """Say what is being done."""
        self._tell(description=what)

    def _tell(self, **fields: Any) -> None:
        with self._lock:
            self._told |= fields
            if self._bar is not None:
                self._bar.update(self._bar.task_ids[0], **fields)

    def _show(self, wait: float) -> None:
        following, most = self.between_lines
        while not self._over.wait(wait):
            with self._lock:
                if self._over.is_set():
                    return
                if self._console.is_terminal:
                    self._bar = Progress(console=self._console, transient=True)
                    self._bar.add_task(**self._told)
                    self._bar.start()
                    return
                # Nobody need read it: a full disk or a closed pipe ends no work.
                with suppress(OSError):
                    self._say()
            wait, following = following, min(2.0 * following, most)

    def _say(self) -> None:
        total, done = self._told["total"], self._told.get("completed", 0)
        part = "" if total is None else f" {done} of {total},"
        passed = time.monotonic() - self._began
        self._console.print(
            f"{self._told['description']}:{part} {passed:.0f} s so far", soft_wrap=True
        )


class LiveView:
    """What goes on: on a terminal a table that renews itself, elsewhere lines; a context manager.

    Attributes:
        to: where it is printed.
        live: the table; None where there are lines, or nothing.
    """

    def __init__(self, *, quiet: bool, waiting: str = "", transient: bool = False) -> None:
        self.to, self.quiet = console(), quiet
        self.live: Live | None = None
        self._settings: dict[str, Any] = {"renderable": waiting, "transient": transient}

    def __enter__(self) -> Self:
        if self.to.is_terminal and not self.quiet:
            self.live = Live(console=self.to, auto_refresh=False, **self._settings)
            self.live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.live is not None:
            self.live.stop()
            self.live = None


@contextmanager
def noted_sigterm() -> Iterator[Callable[[], bool]]:
    """Whether this process was asked to end: then files are still written."""
    asked = threading.Event()
    with _on_sigterm(lambda *_: asked.set()):
        yield asked.is_set


@contextmanager
def noted_interrupt() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed, or this process was asked to end; a second Ctrl-C interrupts."""
    asked = threading.Event()

    def note(*_: object) -> None:
        asked.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.getsignal(signal.SIGINT)
    try:
        with _on_sigterm(note):
            if threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGINT, note)
            yield asked.is_set
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, before)


@contextmanager
def _on_sigterm(handler: Callable[..., Any]) -> Iterator[None]:
    """Only the main thread can be told."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def say_line(line: str, *, stderr: bool = False) -> None:
    """A line on the console, at once."""
    with printing():
        console(stderr=stderr).print(line, soft_wrap=True)


def open_page(url: str, *, no_open: bool, stderr: bool = False) -> None:
    """Say where a page is, and open it in a browser if there is a screen."""
    say_line(f"Open {url} in a browser; Ctrl-C ends it", stderr=stderr)
    # Without a screen, a browser in the terminal would take it.
    if not no_open and {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ}:
        webbrowser.open(url)
