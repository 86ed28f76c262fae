"""Base class of all readers of other programs' formats; ``readers/`` has a file for each."""

from __future__ import annotations

import re
import stat
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import is_folder
from suta_calib.exchange.imported import Imported
from suta_calib.exchange.option import Described, Given, formats_of, named
from suta_calib.inputs import read_input

# Endings of files that hold no rows of cells.
_NO_TABLES: Final = (".yaml", ".yml", ".json", ".xml", ".urdf")
# What is read where nothing else recognises a file.
TABLE: Final = "table"


class Reader(Described, ABC):
    """One foreign format that can be read.

    A new one is a module in ``readers/`` with a subclass, or an entry point of another package in
    the group ``suta_calib.readers``; nothing else names it.

    Attributes:
        suffixes: of files it may be, in small letters; any where none is listed.
        signature: found in the first few thousand characters of such files, and of no others.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()
    signature: ClassVar[re.Pattern[str]] = re.compile(r"(?!)")

    def recognises(self, path: Path, head: str) -> bool:
        """Whether a file, or a folder, is of this format."""
        del path
        return self.signature.search(head) is not None

    @abstractmethod
    def read(self, path: Path, given: Given) -> Imported:
        """The file as one of this package's.

        Raises:
            ForeignFileError: it is not of this format, says too little, or holds nothing.
            InputError: an option's value that cannot be used.
        """


def import_formats() -> dict[str, Reader]:
    """Every format that can be read, by name."""
    return formats_of("readers", "suta_calib.exchange.readers", Reader)


def read_foreign(path: str | Path, form: str | None = None, **options: Any) -> Imported:
    """Read a file of another program.

    Args:
        path: a file, or a folder where the format is one.
        form: name of the format; recognised from the file where it is None.
        **options: the format's own, by name, as on the command line.

    Returns:
        Rows of a samples or poses CSV in SI, or another file of this package.

    Raises:
        ForeignFileError: it is of no format that is known, or not of the one named.
        InputError: an option that the format does not take, or a value that cannot be used.
    """
    path = Path(path)
    _refuse_pipe(path)
    reader = named(import_formats(), form) if form is not None else recognised(path)
    if form is None:
        _check_options(path, reader, options)
    return reader.read(path, Given(reader.options, options, reader.name))


def _check_options(path: Path, reader: Reader, options: Mapping[str, Any]) -> None:
    """Refuse an option that only formats have which the file was not taken for."""
    offered = {option.name for option in reader.options}
    for name, value in options.items():
        if name in offered or value is None or value is False or value == ():
            continue
        takers = [
            other.name
            for other in import_formats().values()
            if any(option.name == name for option in other.options)
        ]
        if takers:
            switch = f"--{name.replace('_', '-')}"
            raise ForeignFileError(
                f"a file that was taken for {reader.name}, which has no {switch}",
                f"a file of a format that has it: {', '.join(takers)}",
                file=path,
                hint=f"if it is one of these, give --format {takers[0]}; else leave {switch} out",
            )


def recognised(path: Path) -> Reader:
    """The format of a file; a table if no other format recognises it."""
    head = beginning(path)
    if not head.strip() and not is_folder(path):
        hint = "was it recorded, and written to its end?"
        raise ForeignFileError("an empty file", "data", file=path, hint=hint)
    readers = import_formats()
    recognising = [
        reader
        for reader in readers.values()
        if reader.name != TABLE
        and (not reader.suffixes or path.suffix.lower() in reader.suffixes)
        and reader.recognises(path, head)
    ]
    if len(recognising) > 1:
        names = ", ".join(reader.name for reader in recognising)
        hint = "choose it with --format NAME"
        raise ForeignFileError(
            f"a file that could be {names}", "only one format", file=path, hint=hint
        )
    if not recognising and is_folder(path):
        problem = "a folder of an unknown format"
        hint = "suta-calib import --list shows the formats"
        raise ForeignFileError(
            problem, "a file, or the folder of a recording", file=path, hint=hint
        )
    if not recognising and path.suffix.lower() in _NO_TABLES:
        problem = f"a {path.suffix.lower()} file of an unknown format"
        expected = "a table, or a file in one of the formats"
        hint = "suta-calib import --list shows the formats; cameras, boards and arms need no import"
        raise ForeignFileError(problem, expected, file=path, hint=hint)
    return recognising[0] if recognising else readers[TABLE]


def _refuse_pipe(path: Path) -> None:
    """Refuse what cannot be read twice: its beginning says of which format it is."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return
    if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):
        hint = "write the data into a file first"
        raise ForeignFileError("a pipe", "a file", file=path, hint=hint)


def beginning(path: Path) -> str:
    """The first few thousand characters of a file; empty for a folder.

    Raises:
        ForeignFileError: it cannot be read.
    """
    head = 4096
    if is_folder(path):
        return ""
    try:
        if path.is_file():
            with path.open("rb") as file:
                data = file.read(head)
        else:
            data = read_input(path)[:head]
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        gone = isinstance(problem, FileNotFoundError)
        description = "no such file" if gone else f"an unreadable file ({reason})"
        raise ForeignFileError(description, "a readable file", file=path) from None
    utf_16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    return data.decode("utf-16" if utf_16 else "utf-8-sig", errors="replace")
