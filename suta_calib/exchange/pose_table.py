"""Poses from whatever file people have, without a detour over `import`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.column_names import CLOCKS, seconds_in
from suta_calib.exchange.delimited import DELIMITED_OPTIONS, read_sheet
from suta_calib.exchange.imported import Imported, ImportedRows
from suta_calib.exchange.option import Given
from suta_calib.exchange.reader import TABLE, read_foreign, recognised
from suta_calib.exchange.table_roles import plain_name
from suta_calib.measurements.csv_table import CsvTable, csv_table, read_csv_table


def pose_table(path: str | Path, **options: str) -> tuple[CsvTable, tuple[str, ...]]:
    """The table of a poses CSV of this package, or of another program's file that is recognised.

    Args:
        path: a CSV file, or whatever `read_foreign` reads without options.
        **options: of another program's format, where it has them.

    Returns:
        The table, and what must be known of the file or was taken for granted, a sentence each.

    Raises:
        SamplesError: as `read_csv_table`.
        ForeignFileError: a file that needs options, or is of no format that is known.

    """
    path = Path(path)
    reader = recognised(path)
    if path.suffix.lower() == ".csv" and reader.name == TABLE:
        return read_csv_table(path), ()
    option_names = {option.name for option in reader.options}
    rows = read_without_options(path, **{k: v for k, v in options.items() if k in option_names})
    if not isinstance(rows, ImportedRows):
        hint = "suta-calib import SOURCE --out FILE converts it"
        raise ForeignFileError(rows.sentence, "poses", file=path, hint=hint)
    table = csv_table(path, rows.text())
    if rows.lines is not None:
        table = replace(table, lines=rows.lines)
    return table, (*rows.notes, *rows.remarks)


def read_without_options(path: Path, **options: str) -> Imported:
    """A foreign file as it is recognised, for a command that has no options of formats.

    Raises:
        ForeignFileError: as `read_foreign`; where options are needed, it names the command that has
            them.
    """
    try:
        return read_foreign(path, recognised(path).name, **options)
    except ForeignFileError as problem:
        raise with_command(problem, path) from None


def with_command(problem: ForeignFileError, path: Path) -> ForeignFileError:
    """The problem of a file that is read without options, with the command that has them."""
    if "--" not in problem.hint:
        return problem
    command = f"suta-calib import {shlex.quote(str(path))} --out poses.csv"
    return ForeignFileError(
        problem.found,
        problem.expected,
        file=problem.file,
        line=problem.line,
        where=problem.where,
        hint=f"{problem.hint}. Such options are those of {command}",
    )


def read_readings(path: Path, units: Sequence[str] = ()) -> Imported:
    """Joint readings of a foreign file, or of a table in which all numbers but times are readings.

    Args:
        path: the file.
        units: of the readings of a table; the names of its columns say them otherwise.

    Raises:
        ForeignFileError: as `read_without_options`.
    """
    if recognised(path).name != TABLE:
        return read_without_options(path)
    sheet = read_sheet(path, Given(DELIMITED_OPTIONS, {}, TABLE))
    numbers = [n for n, v in zip(sheet.names, sheet.values, strict=True) if v is not None and n]
    joints = [
        plain_name(name)[0]
        for name in numbers
        if name.lower() not in CLOCKS and not seconds_in(name)
    ]
    options: dict[str, Any] = {"joints": ",".join(joints)} if sheet.headed else {}
    return read_foreign(path, TABLE, **options, unit=tuple(units))
