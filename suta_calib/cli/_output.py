"""What the commands print and where they write."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Self

import click

from suta_calib.assessment import NOT_USABLE
from suta_calib.atomic import check_folder as check_folder

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.progress import Progress

    from suta_calib.report.document import Document

# Shorter runs are over before anybody wonders.
PATIENCE_S: Final = 2.0
out_option = click.option(
    "--out", type=click.Path(path_type=Path), help="Folder to write into; results/ beside the job."
)
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object and nothing else."
)
anyway_option = click.option(
    "--anyway", is_flag=True, help="Take a result that says of itself that it must not be used."
)
verbose_option = click.option(
    "--verbose", "-v", is_flag=True, help="List the unknowns of the observations too."
)


def console(*, stderr: bool = False) -> Console:
    """A console that keeps names and numbers as they are."""
    from rich.console import Console

    return Console(stderr=stderr, highlight=False, markup=False, emoji=False)


def print_json(data: Mapping[str, Any]) -> None:
    """One JSON object on stdout; what is not a finite number becomes null."""
    click.echo(json.dumps(_finite(data), indent=2, ensure_ascii=False, allow_nan=False))


def folder_of(job: Path, out: Path | None) -> Path:
    """Where the answer on a job is written, checked before any work is done."""
    folder = job.parent / "results" if out is None else out
    check_folder(folder)
    return folder


def present(
    context: click.Context,
    answer: Mapping[str, Any],
    shown: Callable[[], RenderableType],
    folder: Path | None,
    *,
    as_json: bool,
    usable: bool,
) -> None:
    """Print an answer that is already written; exit with 1 where it must not be used.

    Args:
        context: of the command.
        answer: as JSON data; its ``files`` were written.
        shown: makes what a console shows.
        folder: written into, or None.
        as_json: print ``answer`` instead of ``shown``.
        usable: whether the answer may be used.
    """
    if as_json:
        print_json(answer)
    else:
        to = console()
        to.print(shown())
        if folder is not None:
            to.print(f"Written to {folder}: {', '.join(answer['files'])}", soft_wrap=True)
    if not usable:
        context.exit(NOT_USABLE)


def finish(
    context: click.Context,
    answer: Document,
    folder: Path | None,
    *,
    as_json: bool,
    texts: Mapping[str, str | bytes] = MappingProxyType({}),
) -> None:
    """Write an answer's files, print it, exit with 1 where it must not be used.

    Args:
        context: of the command.
        answer: what was found.
        folder: to write into; nothing is written without one.
        as_json: print JSON instead of what a console shows.
        texts: further whole files by name.
    """
    written: Mapping[str, Any] | None = None
    if folder is not None:
        from suta_calib.report.files import write_document

        written = write_document(answer, folder, texts)
    if as_json:
        print_json(answer.json() if written is None else written)
    else:
        from suta_calib.report.console import rendered

        to = console()
        to.print(rendered(answer), crop=False)
        if folder is not None and written is not None:
            files = written["files"]
            to.print(f"Written to {folder}: {', '.join(files)}", soft_wrap=True)
            if answer.written == "opening":
                to.print(f"Report: {files['report.html']}", soft_wrap=True)
    context.exit(answer.assessment.exit_code)


class LateProgress:
    """A progress bar on stderr: on a terminal only, and not before it is worth it."""

    def __init__(self, what: str) -> None:
        self._what, self._began = what, time.monotonic()
        self._console = console(stderr=True)
        self._bar: Progress | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, done: int, total: int) -> None:
        """Say how far the work has come."""
        if self._bar is None:
            late = time.monotonic() - self._began > PATIENCE_S
            if not (late and self._console.is_terminal):
                return
            from rich.progress import Progress

            self._bar = Progress(console=self._console, transient=True)
            self._bar.add_task(self._what)
            self._bar.start()
        self._bar.update(self._bar.task_ids[0], completed=done, total=total)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
