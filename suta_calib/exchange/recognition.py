"""Recognises the format of a file that a command cannot read, and the command that can."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from suta_calib.errors import (
    ArtefactError,
    BoardError,
    CameraError,
    InputError,
    SamplesError,
    SutaCalibError,
)
from suta_calib.exchange.reader import TABLE, beginning, recognised
from suta_calib.inputs import read_input

_JOB: Final = (
    *("calibrate", "observe", "study", "extend", "budget", "view", "validate", "outliers"),
    *("measure", "guide", "motors", "plan", "tip-map", "residual-map", "repeatability", "iso10360"),
)
_URDF: Final = (
    *("init", "validate", "emulate", "track", "monitor", "measure", "zero-offsets"),
    *("repeatability", "iso10360", "tip-map", "path-accuracy", "export"),
)


@dataclass(frozen=True)
class FileFormat:
    """A file format, and the commands that read it.

    Attributes:
        name: of its format, in a few words.
        command: that reads it, as it is typed.
        read_by: names of all commands that do.
        read_as: what they raise then; anything where this is empty.
        table: whether it is known by its columns, in the first line.
    """

    name: str
    command: str
    read_by: Collection[str]
    read_as: tuple[type[InputError], ...] = ()
    table: bool = False

    @property
    def hint(self) -> str:
        """What to do with such a file."""
        return f"this looks like {self.name}: {self.command}"


@dataclass(frozen=True)
class _Own:
    """A format of this package: how a file of it begins, and as of `FileFormat`."""

    begins: Callable[[str], bool]
    name: str
    command: str
    read_by: Collection[str]
    read_as: tuple[type[InputError], ...] = ()
    table: bool = False


def _has(*keys: str) -> Callable[[str], bool]:
    """A YAML file with these keys; JSON is none."""
    return lambda head: all(re.search(rf"(?m)^{key}\s*:", head) for key in keys)


def _columns(*names: str, at_most: int = 1000) -> Callable[[str], bool]:
    """A CSV file that begins with a row that has these names."""

    def begins(head: str) -> bool:
        cells = [cell.strip() for cell in head.partition("\n")[0].split(",")]
        row = "\n".join(cells)
        return len(cells) <= at_most and all(re.search(rf"(?m)^{n}$", row) for n in names)

    return begins


# They read other programs' files directly.
_POSES: Final = ("hand-eye", "pivot", "register")
# Of what has no command of its own.
_NAMED: Final = "name {{}} as the key {} of a row of a job's observations"
_ROWS: Final = (*_JOB, "simulate", "hand-eye", "detect")
# The first that fits counts.
_OWN: Final = (
    _Own(
        lambda head: "<robot" in head,
        "a URDF or a description for xacro",
        "suta-calib init {} --tip LINK starts a job for the arm",
        _URDF,
    ),
    _Own(_has("arm", "observations"), "the file of a calibration", "suta-calib calibrate {}", _JOB),
    _Own(_has("arm", "sets"), "the file of a simulation", "suta-calib simulate {}", ("simulate",)),
    _Own(
        _has("port", "joints"),
        "the file of a device",
        "suta-calib monitor --device {}",
        ("monitor", "measure", "guide", "track"),
    ),
    _Own(
        lambda head: (
            head.lstrip().startswith("{")
            and (
                all(f'"{key}"' in head for key in ("command", "verdict"))
                # As hand-eye, rig and detect begin theirs.
                or all(f'"{key}"' in head for key in ("reprojection_rms_px", "setup"))
                or all(f'"{key}"' in head for key in ("cameras", "distortion_model"))
            )
        ),
        "the answer of a command",
        "suta-calib export {} --list names what can be made of it",
        ("export", "view", "validate", "track", "tip-map", "residual-map", "certificate"),
    ),
    _Own(_has("landmarks"), "an artefact", _NAMED.format("artefact"), _ROWS, (ArtefactError,)),
    _Own(
        _has("type", "(corners|squares|markers)"),
        "a board",
        _NAMED.format("board"),
        _ROWS,
        (BoardError,),
    ),
    _Own(
        _has("camera_matrix"),
        "a camera",
        _NAMED.format("camera"),
        (*_ROWS, "export"),
        (CameraError,),
    ),
    _Own(
        _columns("a_x(_mm)?", "a_qx"),
        "pairs of poses",
        "suta-calib hand-eye {}",
        ("hand-eye", "import"),
        table=True,
    ),
    _Own(
        _columns("placement", "landmark"),
        "samples of an arm",
        _NAMED.format("samples"),
        _ROWS,
        (SamplesError,),
        table=True,
    ),
    _Own(
        _columns("feature", "landmark", "index"),
        "points of a laser tracker on an artefact",
        "suta-calib certify {} --out artefact.yaml",
        ("certify",),
        table=True,
    ),
    _Own(
        _columns("x(_mm)?", "y(_mm)?", "z(_mm)?", "qx", "qy", "qz", "qw", at_most=8),
        "poses of a tool",
        "suta-calib pivot {}",
        ("pivot", "register", "path-accuracy", "import"),
        table=True,
    ),
)


def recognised_format(path: Path) -> FileFormat | None:
    """Of which format a file is, whatever it is called; None where it is of none that is known."""
    quoted = shlex.quote(str(path))
    with suppress(SutaCalibError, OSError, ValueError):
        head = beginning(path)
        if head.lstrip().startswith("{") and b'"verdict"' in read_input(path):
            # Of an answer the verdict is at the end.
            head = '{"command", "verdict"'
        for form in _OWN:
            if form.begins(head):
                command = form.command.format(quoted)
                return FileFormat(form.name, command, form.read_by, form.read_as, form.table)
        reader = recognised(path)
        if reader.name == TABLE:
            return None
        # What its example writes.
        suffix = re.search(r"--out \S+(\.\w+)", reader.example)
        out = path.with_suffix(suffix[1] if suffix else ".csv").name
        out = out if out != path.name else f"imported_{out}"
        command = f"suta-calib import {quoted} --format {reader.name} --out {shlex.quote(out)}"
        return FileFormat(reader.summary.partition(":")[0], command, ("import", *_POSES))
    return None


def other_format(error: InputError, command: str) -> str:
    """The format of a file that this command cannot read but another command can."""
    if error.file is None:
        return ""
    found = recognised_format(error.file)
    if found is None:
        return ""
    if found.table and error.line is not None and error.line > 1:
        # Of a row: the columns are those that the command asks for.
        return ""
    right = command in found.read_by and isinstance(error, found.read_as or InputError)
    return "" if right else found.hint
