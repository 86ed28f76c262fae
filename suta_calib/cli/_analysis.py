"""What the analysis commands share: where they write, what they print, the exit code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import click

from suta_calib.cli._output import check_folder, present

if TYPE_CHECKING:
    from rich.console import RenderableType

    from suta_calib.report.sections import Section

out_option = click.option(
    "--out", type=click.Path(path_type=Path), help="Folder to write into; results/ beside the job."
)


def folder_of(job: Path, out: Path | None) -> Path:
    """Where the analysis of a job is written, checked before any work is done."""
    folder = job.parent / "results" if out is None else out
    check_folder(folder)
    return folder


def finish_analysis(
    context: click.Context,
    answer: dict[str, Any],
    shown: Callable[[], RenderableType],
    section: Callable[[], Section],
    folder: Path | None,
    *,
    as_json: bool,
    usable: bool,
    texts: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write the files, print the answer, exit with 1 where it must not be used.

    Args:
        context: of the command.
        answer: as JSON data.
        shown: makes what a console shows.
        section: makes the section of report.html, its pictures among it.
        folder: to write into; nothing is written without one.
        as_json: print ``answer`` instead of ``shown``.
        usable: whether the answer may be used.
        texts: further whole files by name.
    """
    if folder is not None:
        from suta_calib.report.sections import write_analysis

        answer = write_analysis(answer, section(), folder, texts)
    present(context, answer, shown, folder, as_json=as_json, usable=usable)
