"""URDFs that are generated: a ``.xacro`` file stands for what xacro makes of it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from suta_calib.atomic import note_input
from suta_calib.errors import UrdfError, did_you_mean
from suta_calib.inputs import XacroFile
from suta_calib.optional_packages import require
from suta_calib.sandbox import ConfinedError, run_confined

_CHILD: Final = "suta_calib.model.xacro_child"
_EXPECTED: Final = "a file that xacro can expand with only the files of its own description"
_HINT: Final = (
    "a .xacro can contain a program, so here it may only compute and read its own folder. If you "
    "trust it, expand it yourself: xacro FILE.xacro > FILE.urdf"
)
_ARGUMENT_HINT: Final = (
    "give it with --xacro-arg NAME:=VALUE; in a file, urdf: {file: FILE.xacro, args: {NAME: VALUE}}"
)


# What a file made, and the files that it was made of with their sizes and times: one command reads
# a description several times, its tree, its kinematics, and what it writes.
_expansions: dict[tuple[str, ...], tuple[bytes, dict[str, tuple[int, ...]]]] = {}


def is_xacro(path: Path) -> bool:
    """Whether a file is to be run through xacro, as its name says."""
    return path.suffix.lower() == ".xacro"


def expanded(file: Path | XacroFile) -> bytes:
    """The URDF that a xacro file makes, with default arguments where none are given.

    A ``.xacro`` is a program. It is expanded in a process of its own without power: expressions
    compute and do nothing else, files are read from the description's folder alone (the package
    that the file is in, or its folder), there is no environment, and time and memory are bounded.
    ``$(find …)`` finds that package and those beside it, without ROS.

    Raises:
        UrdfError: missing, or refused by xacro, with what it said, or beyond what it may do; or an
            argument that the description does not have.
        MissingExtraError: xacro is not installed.
    """
    path, given = (file.path, file.arguments) if isinstance(file, XacroFile) else (file, {})
    if not is_xacro(path):
        expected = "a .xacro file: other files have no arguments"
        raise UrdfError(f"a file without arguments ({', '.join(given)})", expected, file=path)
    if not path.is_file():
        problem = "a directory" if path.is_dir() else "no such file"
        raise UrdfError(problem, "a .xacro file", file=path)
    note_input(path)
    arguments = [f"{name}:={value}" for name, value in sorted(given.items())]
    key = (os.path.abspath(path), *arguments)  # noqa: PTH100 (links lead to other descriptions)
    urdf, files = _expansions.get(key, (b"", {}))
    if not files or any(_stamp(name) != stamp for name, stamp in files.items()):
        urdf, files = _expansions[key] = _expand(path, arguments)
    for name in files:
        note_input(Path(name))
    return urdf


def _expand(path: Path, arguments: Sequence[str]) -> tuple[bytes, dict[str, tuple[int, ...]]]:
    require("xacro", "formats")
    try:
        answer = run_confined(_CHILD, str(path), *arguments)
    except ConfinedError as problem:
        excess = f"a file that takes {problem} to expand"
        raise UrdfError(excess, _EXPECTED, file=path, hint=_HINT) from None
    if "refused" in answer:
        raise _refusal(path, answer)
    for name in (argument.partition(":=")[0] for argument in arguments):
        if name not in answer["arguments"]:
            raise UrdfError(
                f"the argument {name!r}, which the description does not use",
                f"one of {', '.join(answer['arguments']) or 'none: it has no arguments'}",
                file=path,
                hint=did_you_mean(name, answer["arguments"]),
            )
    return str(answer["urdf"]).encode(), {str(name): _stamp(name) for name in answer["files"]}


def _refusal(path: Path, answer: Mapping[str, Any]) -> UrdfError:
    """The error that the child found, in this file or in one that it includes."""
    longest = 200
    message, file = str(answer["refused"])[:longest], Path(str(answer["file"]))
    argument = message.startswith("ArgException: ")
    if argument:
        message = f"no value of the argument {message.removeprefix('ArgException: ')!r}"
    included = file.name if os.path.realpath(file) != os.path.realpath(path) else ""
    kind = "may not do here" if answer["forbidden"] else "refuses"
    return UrdfError(
        f"something that xacro {kind} ({message})",
        _EXPECTED,
        file=path,
        line=None if included else _line(path, str(answer["expression"])),
        where=included,
        hint=_HINT if answer["forbidden"] else _ARGUMENT_HINT if argument else "",
    )


def _stamp(file: str) -> tuple[int, ...]:
    try:
        status = os.stat(file)  # noqa: PTH116
    except OSError:
        return ()
    return status.st_size, status.st_mtime_ns


def _line(path: Path, expression: str) -> int | None:
    """The first line with an expression."""
    if not expression:
        return None
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    return next((n for n, line in enumerate(lines, 1) if expression in line), None)
