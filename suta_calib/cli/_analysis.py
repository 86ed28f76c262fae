"""What the analysis commands share: where they write, what they print, the exit code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import click

from suta_calib.cli._output import folder_of, out_option, present

if TYPE_CHECKING:
    from rich.console import RenderableType

    from suta_calib.report.sections import Section

__all__ = ["finish_analysis", "folder_of", "out_option"]


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
