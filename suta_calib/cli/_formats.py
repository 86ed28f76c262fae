"""Options of the commands that read and write other programs' files: as their formats have them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import click

from suta_calib.exchange.option import Described, options_from_file, options_of
from suta_calib.exchange.pose_table import pose_table
from suta_calib.measurements.csv_table import CsvTable

Command = TypeVar("Command", bound=Callable[..., Any])


def format_options(formats: Iterable[Described]) -> Callable[[Command], Command]:
    """Every option that any of the formats declares; whether one takes it, it says itself."""
    declared = options_of(formats)

    def decorate(command: Command) -> Command:
        for option in reversed(declared):
            # A choice is checked by the format, whose message says what it is for.
            kind: dict[str, Any] = {"is_flag": True} if option.flag else {"type": str}
            if not option.flag:
                kind["metavar"] = "|".join(option.choices[:6]) or option.metavar
                kind["multiple"] = option.several
            decorator = click.option(option.switch, option.name, help=option.help, **kind)
            command = decorator(command)
        return command

    return decorate


def with_file(options: dict[str, Any], file: Path | None) -> dict[str, Any]:
    """Options of the command line, and beneath them those of a file."""
    given = {name: value for name, value in options.items() if value not in (None, False, ())}
    return given if file is None else options_from_file(file) | given


def read_poses(path: Path, **options: str) -> CsvTable:
    """A poses CSV, or another program's file, of which stderr says what was taken for granted.

    Args:
        path: the file.
        **options: of another program's format, where it has them.
    """
    table, notes = pose_table(path, **options)
    for note in notes:
        click.echo(f"{path}: {note}", err=True)
    return table
